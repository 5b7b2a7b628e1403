"""Calibration records: one TOML file holds the calibration of one sensor and its validity.

::

    version = 1
    kind = "laser"
    id = "laser-front-2024-05"
    instrument = "LK-G5001"
    serial = "1234567"
    valid_from = 2024-05-01
    valid_until = 2025-05-01
    who = "A. Person"
    when = 2024-05-01
    how = "height gauge, twelve steps of 1 mm"

    [values]
    inclination = "12.00 ± 0.05 deg"
    scale = "1.0000 ± 0.0002"

The number after ± is a standard uncertainty. A new kind is a structure of values, a subclass of
:class:`Record`, and a line in :data:`KINDS`. All mistakes of a file are reported at once, with
their lines.
"""

import os
import re
from collections.abc import Mapping
from datetime import date, datetime
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec

from labpipe.errors import CalibrationError, ConfigError
from labpipe.units import Quantity
from labpipe.workflow import config
from labpipe.workflow.document import parse
from labpipe.workflow.fields import POSITIVE, Angle, Dimension, Dimensionless, Force, Length, Range, Scale, Time

VERSION = 1

Text = Annotated[str, msgspec.Meta(min_length=1)]
PixelLength = Annotated[Quantity, Dimension("px", "length in pixels", "386 ± 1.5 px")]
VoltScale = Annotated[Quantity, Dimension("m/V", "length per volt", "0.5 ± 0.0005 mm/V")]

#: Beyond 80° a reading says next to nothing about the vertical motion.
_INCLINATIONS = Range(at_least=0.0, below=1.4)
#: A gain is near one; anything else is a factor of units gone wrong.
_GAINS = Range(above=0.5, below=2.0)

_UNITY = Quantity(1.0, 0.0, "1")


class Table(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A table of a record; an unknown key is a mistake."""


class LaserValues(Table, frozen=True):
    """Calibration values of a displacement sensor in its mount.

    Attributes
    ----------
    inclination : Quantity [rad]
        Angle between the line of sight and the motion.
    scale : Quantity [1]
        True length over displayed length, along the line of sight.
    linearity : Quantity [m], optional
        Only its uncertainty counts: the standard deviation of the sensor's own curve.
    volt_scale : Quantity [m/V], optional
        For outputs that were recorded as a voltage.
    measuring_range : Quantity [m], optional
        Readings beyond ± this value are not valid.
    time_base : Quantity [1], optional
        Relative deviation of the true sampling interval from the stated one.
    """

    inclination: Annotated[Angle, _INCLINATIONS]
    scale: Annotated[Dimensionless, _GAINS] = _UNITY
    linearity: Length | None = None
    volt_scale: VoltScale | None = None
    measuring_range: Annotated[Length, POSITIVE] | None = None
    time_base: Dimensionless | None = None

    def __post_init__(self) -> None:
        """Refuse an inclination without uncertainty: it would look exact in every budget."""
        if self.inclination.u == 0:
            raise ValueError('inclination has no uncertainty; write it as "12.00 ± 0.05 deg"')


class LoadCellValues(Table, frozen=True):
    """Calibration values of a load cell.

    Attributes
    ----------
    scale : Quantity [1]
        True force over displayed force.
    linearity : Quantity [N], optional
        Only its uncertainty counts.
    capacity : Quantity [N], optional
        Readings beyond ± this value are not valid.
    filter_delay : Quantity [s], optional
        Delay of force against position, measured with an elastic reference.
    """

    scale: Annotated[Dimensionless, _GAINS]
    linearity: Force | None = None
    capacity: Annotated[Force, POSITIVE] | None = None
    filter_delay: Time | None = None

    def __post_init__(self) -> None:
        """Refuse a scale without uncertainty."""
        if self.scale.u == 0:
            raise ValueError('scale has no uncertainty; write it as "1.000 ± 0.002"')


class CameraValues(Table, frozen=True):
    """Image scale of one camera view.

    Either ``scale``, or a length and the number of pixels that it spans.

    Attributes
    ----------
    reference_length : Quantity [m], optional
        Of an object in the plane of focus.
    pixel_length : Quantity [px], optional
        Its length in the image; the uncertainty of pointing at both ends.
    scale : Quantity [m/px], optional
        Length of one pixel.
    tilt : Quantity [rad], optional
        Of the reference line against the image axis; reported, not corrected.
    out_of_plane : Quantity [1], optional
        Only its uncertainty counts: relative change of scale between the planes of reference
        and measurement.
    """

    reference_length: Annotated[Length, POSITIVE] | None = None
    pixel_length: Annotated[PixelLength, POSITIVE] | None = None
    scale: Annotated[Scale, POSITIVE] | None = None
    tilt: Angle | None = None
    out_of_plane: Dimensionless | None = None

    def __post_init__(self) -> None:
        """Refuse a scale without uncertainty, and any but one way to state it."""
        has_pair = self.reference_length is not None and self.pixel_length is not None
        has_half = (self.reference_length is None) != (self.pixel_length is None)
        if has_half or has_pair == (self.scale is not None):
            raise ValueError("give either reference_length and pixel_length, or scale")
        stated = self.pixel_length if has_pair else self.scale
        if stated is not None and stated.u == 0:
            raise ValueError('the scale has no uncertainty; write it as "386 ± 1.5 px" (or "um/px")')


class Record(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Entries of every record; the subclass of each kind adds ``values``.

    Attributes
    ----------
    version : int
        Of this format.
    kind, id : str
        Kind of sensor, and the name under which results quote the record.
    instrument, serial : str
        Of the sensor; ``serial`` may be left out.
    view : str, optional
        Camera view that the record belongs to.
    valid_from, valid_until : date
        Both days included.
    who, how : str
        Person who calibrated, and the method.
    when : date
        When.
    """

    version: Literal[1]
    kind: str
    id: Text
    instrument: Text
    serial: str = ""
    view: str | None = None
    valid_from: date
    valid_until: date
    who: Text
    when: date
    how: Text

    def __post_init__(self) -> None:
        """Refuse a period that ends before it begins."""
        if self.valid_until < self.valid_from:
            raise ValueError(f"valid_until ({self.valid_until}) is before valid_from ({self.valid_from})")


class LaserRecord(Record, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Calibration of a displacement sensor."""

    kind: Literal["laser"]
    values: LaserValues


class LoadCellRecord(Record, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Calibration of a load cell."""

    kind: Literal["load_cell"]
    values: LoadCellValues


class CameraRecord(Record, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Calibration of one view of a camera."""

    kind: Literal["camera"]
    view: Text
    values: CameraValues


#: Why no day is known: the file holds none, as images and videos do, and nobody states one; or the clock of the
#: instrument was never set, or runs ahead.
UNDATED, WRONG_CLOCK = "no day", "wrong clock"
_CLOCKS_SET = date(2001, 1, 1)  # clocks that lose their battery begin at 1970, 1980 or 2000

#: Every kind of record.
KINDS: dict[str, type[Record]] = {"camera": CameraRecord, "laser": LaserRecord, "load_cell": LoadCellRecord}


def load_record(path: str | os.PathLike[str]) -> Record:
    """Read a calibration record, of the class of its kind, from its TOML file.

    Raises
    ------
    SourceError
        The file cannot be read or is no TOML.
    ConfigError
        It holds mistakes; all of them are listed, with their lines.
    CalibrationError
        It was written by a newer version.
    """
    path = Path(path)
    document = parse(path)
    version, kind = document.tree.get("version"), document.tree.get("kind")
    if isinstance(version, int) and version > VERSION:
        raise CalibrationError(
            f"{path}: the record has version {version}, this labpipe knows {VERSION}; "
            "update labpipe (pip install --upgrade labpipe)"
        )
    if not isinstance(kind, str) or kind not in KINDS:
        known, found = ", ".join(f'"{name}"' for name in KINDS), "nothing" if kind is None else f'"{kind}"'
        raise ConfigError([f"{path}:{document.lines.get(('kind',), 1)}: kind: expected one of {known}, found {found}"])
    return config.read(path, KINDS[kind])


def require(
    record: Record, kind: str, attrs: Mapping[str, Any], *, measured: str | date | None = None, view: str | None = None
) -> dict[str, Any]:
    """Refuse a record that does not belong to a measurement; else list the checks.

    Parameters
    ----------
    record, kind : Record, str
        The calibration, and the kind that is needed.
    attrs : mapping
        Attributes of the readings: ``start``, ``model``, ``serial``, ``sensor`` where known.
    measured : date or ISO text, optional
        Day of the measurement, as a date where a person states it, as text where a clock does; by
        default ``start`` of the readings. A clock before 2001 or beyond today gives no day; where none is
        known, the result says that the validity was not checked.
    view : str, optional
        Camera view.

    Returns
    -------
    dict
        For the attributes of the result: the record, and the checks that were possible.

    Raises
    ------
    CalibrationError
        Wrong kind, other sensor, other view, or not valid on that day.
    """
    if record.kind != kind:
        raise CalibrationError(
            f'record "{record.id}" calibrates a {record.kind.replace("_", " ")}, expected a record '
            f"of a {kind.replace('_', ' ')}; name that file instead"
        )
    if view is not None and record.view != view:
        own = f'the view "{record.view}"' if record.view else "no view"
        raise CalibrationError(
            f'record "{record.id}" belongs to {own}, the measurement to the view "{view}"; take the record of that view'
        )
    validity, no_day = _check_validity(record, attrs, measured)
    start, fields = _day(str(attrs.get("start", ""))), ("id", "kind", "instrument", "serial", "who", "how")
    dates = {name: getattr(record, name).isoformat() for name in ("valid_from", "valid_until", "when")}
    return (
        {name: getattr(record, name) for name in fields}
        | dates
        | {
            "sensor_check": _check_sensor(record, attrs),
            "validity_check": validity,
            "no_day": no_day,
            "stated_day": measured.isoformat() if isinstance(measured, date) else "",
            # the day that the readings themselves say, "" where they have none or their clock cannot be right
            "recorded_day": start.isoformat() if start and _CLOCKS_SET <= start <= date.today() else "",
        }
    )


def _check_sensor(record: Record, attrs: Mapping[str, Any]) -> str:
    """Compare the sensor that the readings name with that of the record."""

    def plain(text: str) -> str:
        return re.sub(r"[^a-z0-9]", "", text.lower())

    serial, sensor = str(attrs.get("serial", "")), str(attrs.get("sensor", "") or attrs.get("model", ""))
    if serial and record.serial:
        if plain(serial) == plain(record.serial):
            return f"serial number {serial} agrees"
        found, expected = f"serial number {serial}", record.serial
    elif not sensor:
        return "not possible: the readings name no sensor"
    elif record.serial and plain(record.serial) in plain(sensor):
        return f"serial number in {sensor} agrees"
    elif plain(record.instrument) in plain(sensor) or plain(sensor) in plain(record.instrument):
        return f"name {sensor} agrees"
    else:
        found, expected = sensor, f"{record.instrument} {record.serial}".strip()
    text = f'record "{record.id}" calibrates {expected}, the readings come from {found}; take the record of that sensor'
    raise CalibrationError(text)


def _check_validity(record: Record, attrs: Mapping[str, Any], measured: str | date | None) -> tuple[str, str]:
    """Compare the period of a record with the day of a measurement; return the result, and the reason if unknown."""
    day = _day(measured if measured is not None else str(attrs.get("start", "")))
    if day is None:
        return "not known: the recording holds no day, and none is stated", UNDATED
    if record.valid_from <= day <= record.valid_until:
        return f"valid on {day}", ""
    if not isinstance(measured, date) and not _CLOCKS_SET <= day <= date.today():
        return f"not known: the clock of the instrument says {day}", WRONG_CLOCK
    word = "expired" if day > record.valid_until else "was not yet valid"
    raise CalibrationError(
        f'record "{record.id}" is valid from {record.valid_from} until {record.valid_until}; it '
        f"{word} on {day}, the day of the measurement; take the record of that time, calibrate "
        "again, or, if it is known to hold on that day too, widen the days in the record"
    )


def _day(text: str | date) -> date | None:
    if isinstance(text, date):  # or a time of a day
        return text.date() if isinstance(text, datetime) else text
    try:
        return datetime.fromisoformat(text).date() if text else None
    except ValueError:
        raise CalibrationError(f'the day of the measurement must read like "2024-05-14", found "{text}"') from None
