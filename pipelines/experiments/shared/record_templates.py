"""Calibration records that recordings take, templates for those without one, and the first lines of a film."""

import json
import tomllib
import warnings
from collections.abc import Callable, Container
from datetime import date
from pathlib import Path

import instruments
from labpipe.errors import InputError, LabpipeError
from pipelines.experiments._kind import Found
from pipelines.experiments.shared.film_frames import recorded_on
from pipelines.experiments.shared.proposals import GAP, identifier, quoted, view

_HEAD = """\
# Written by `labpipe init`; complete it before the results are used.
version = 1
kind = "{kind}"
id = "{id}"
instrument = "{instrument}"
{view}valid_from = {first}  # the days of the recordings; widen it to the days it holds for
valid_until = {last}
who = "{gap}"  # who calibrated
when = {first}  # day of the calibration
how = "{gap}"  # by what, e.g. {how}

[values]
"""
_LASER = f"""\
inclination = "{GAP} deg"  # line of sight against the motion, e.g. "12.0 ± 0.2 deg"
# scale = "1.0000 ± 0.0005"  # true over displayed length, along the line of sight
"""
_CAMERA = f"""\
reference_length = "{GAP} mm"  # of an object in the plane of focus, e.g. "30.00 ± 0.02 mm"
pixel_length = "{GAP} px"  # what it measures in the image, e.g. "386 ± 1.5 px"
"""
_CELL = f"""\
scale = "{GAP}"  # true over displayed force, e.g. "1.0000 ± 0.0010"
# filter_delay = "15.9 ± 0.2 ms"  # of the force against the position, by an elastic reference
"""
_TEMPLATES = {
    "laser": ("micrometer steps against the reading", _LASER),
    "camera": ("a ruler in the plane of focus", _CAMERA),
    "load_cell": ("masses, displayed against true force", _CELL),
}
"""Method and values of a record, by its kind."""
_NONE = f"calibration/{GAP}.toml"


def laser_records(found: Found) -> dict[str, dict[str, str]]:
    """Propose a record for a laser whose readings came without one.

    By kind of record (``record:laser``) they are names and texts of files; nothing that would replace a file.
    """
    if not found.of("displacement") or found.of("record:laser"):
        return {}
    model, days = _about(found.folder, found.of("displacement"))
    return {"record:laser": _template(found.folder, "laser", model or "Keyence laser", days)}


def camera_records(found: Found) -> dict[str, dict[str, str]]:
    """Propose a record for each view and day that is filmed and has none, as :func:`laser_records`.

    A camera that was set up again on another day has another scale.
    """
    days_of: dict[str, list[list[date]]] = {}
    for film in found.of("film"):
        seen, days = view(film), _about(found.folder, [film])[1]
        if _fitting(found, "camera", days, seen) is None and days not in days_of.setdefault(seen, []):
            days_of[seen].append(days)
    made: dict[str, str] = {}
    for seen, days in ((seen, days) for seen, each in sorted(days_of.items()) for days in sorted(each)):
        stem = seen if len(days_of[seen]) == 1 else "_".join([seen, *map(str, days)])
        made |= _template(found.folder, "camera", "camera", days, seen, f"camera_{stem}")
    return {"record:camera": made} if made else {}


def blank_record(folder: Path, kind: str, view: str, recordings: list[str], taken: Container[str]) -> tuple[str, str]:
    """Return name and text of a new record of a laser, load cell, or view of a camera, for the days of recordings.

    It takes the place of no file, nor of one of the names ``taken``. Raises InputError for another kind.
    """
    model, days = _about(folder, recordings)
    if kind == "camera":
        seen = identifier(view)
        return next(iter(_template(folder, kind, kind, days, seen, f"camera_{seen}", taken).items()))
    if kind in _TEMPLATES:
        sensor = model or {"laser": "Keyence laser", "load_cell": "load cell"}[kind]
        return next(iter(_template(folder, kind, sensor, days, taken=taken).items()))
    raise InputError(f'a record of kind "{kind}" is written by hand: the guide says how, For the experimenter')


def camera_record(found: Found, film: str) -> str:
    """Return the camera record of a film's view that is valid on its day, or the gap for one."""
    return _fitting(found, "camera", _about(found.folder, [film])[1], view(film)) or _NONE


def laser_record(found: Found, recording: str, fits: Callable[[str], bool] = lambda name: True) -> str:
    """Return the laser record that is valid on the day of a recording; ``fits`` decides by its name whether it may be.

    Where none is valid on that day it is the first one, which is then refused with its days; the gap for a record
    where there is none.
    """
    names = [name for name in found.of("record:laser") if fits(name)]
    days = _about(found.folder, [recording])[1] if len(names) > 1 else []
    return _fitting(found, "laser", days, names=names) or next(iter(names), _NONE)


def head(found: Found, film: str, kind: str, name: str, why: str = "proposed from the file name") -> str:
    """Return the first lines of an experiment with a film; a person knows its view better."""
    seen = view(film)
    record = camera_record(found, film)
    rate = f'\nframe_rate = "{GAP} Hz"  # of the camera: images hold no time' * is_exported(found, film)
    return f"""[experiments.{name}]
kind = "{kind}"  # {why}
film = "{quoted(film)}"
camera = "{record}"  # image scale of this view, with its uncertainty
view = "{seen}"  # as the record says{rate}"""


def is_exported(found: Found, film: str) -> bool:
    """Return whether a film was exported as images, which may be pictures of anything."""
    return film in found.of("image_stack")


def _fitting(
    found: Found, kind: str, days: list[date], seen: str | None = None, names: list[str] | None = None
) -> str | None:
    """Return the first record of a kind, a view, and the days of a recording; days still to be stated fit all."""
    for name in found.of(f"record:{kind}") if names is None else names:
        try:
            values = tomllib.loads(found.texts.get(name) or found.path(name).read_text("utf-8"))
        except (OSError, ValueError):
            continue
        first, last = values.get("valid_from"), values.get("valid_until")
        fits = True
        if isinstance(first, date) and isinstance(last, date):
            fits = all(first <= day <= last for day in days)
        if fits and seen in (None, values.get("view")):
            return name
    return None


def _template(
    folder: Path,
    kind: str,
    instrument: str,
    days: list[date],
    view: str = "",
    stem: str = "",
    taken: Container[str] = (),
) -> dict[str, str]:
    """Return text and name of a record, one that no file has and that is not ``taken``."""
    stem, (how, values) = stem or kind, _TEMPLATES[kind]
    name, number = f"calibration/{stem}.toml", 2
    while (folder / name).exists() or name in taken:
        name, number = f"calibration/{stem}_{number}.toml", number + 1
    first, last = (min(days), max(days)) if days else (f'"{GAP}"', f'"{GAP}"')
    text = _HEAD.format(
        kind=kind,
        id="-".join(filter(None, (kind, view, str(first) if days else ""))),
        instrument=instrument,
        view=f'view = "{view}"\n' if view else "",
        first=first,
        last=last,
        gap=GAP,
        how=how,
    )
    return {name: text + values}


def _about(folder: Path, names: list[str]) -> tuple[str, list[date]]:
    """Model of the sensor, or name of the load cell, and days of the recordings, as far as the files hold them."""
    models, days = [], []
    for name in names:
        try:
            with warnings.catch_warnings(action="ignore"):
                found = instruments.read(folder / name)
        except LabpipeError:
            continue  # `plan` and `process` say what is wrong with it
        attrs = getattr(found, "attrs", {})
        blocks = json.loads(attrs.get("blocks", "[]"))  # each may name its load cell
        cells = (str((block.get("load_cell") or {}).get("name") or "") for block in blocks)
        models.append(next(filter(None, cells), "") or str(attrs.get("model", "")))
        day = str(attrs.get("start", ""))[:10] or recorded_on(found)
        if day:
            days.append(date.fromisoformat(day))
    return next(filter(None, models), ""), days
