"""Calibration records to fill in, for readings that came without one."""

import warnings
from collections.abc import Mapping
from datetime import date
from pathlib import Path

import instruments
from labpipe.errors import LabpipeError
from pipelines.gaps import GAP

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


def missing_records(folder: Path, found: Mapping[str, list[str]]) -> dict[str, tuple[str, str]]:
    """Propose a record for every sensor whose readings came without one.

    Parameters
    ----------
    folder : Path
        The session folder.
    found : mapping
        Readings by content, and records by ``record:KIND``.

    Returns
    -------
    dict
        Kind (``record:laser``, ``record:camera``) to name of the file and its text; nothing that
        would replace a file.
    """
    proposals: dict[str, tuple[str, str]] = {}
    if found.get("displacement") and not found.get("record:laser"):
        name = _free(folder, "laser")
        model, days = _about(folder, found["displacement"])
        how = "micrometer steps against the reading"
        head = _head("laser", model or "Keyence laser", days, "", how)
        proposals["record:laser"] = (name, head + _LASER)
    return proposals


def camera_template(folder: Path, film: str, view: str) -> tuple[str, str]:
    """Return name and text of a record for one view of a camera."""
    _, days = _about(folder, [film])
    how = "a ruler in the plane of focus"
    head = _head("camera", "camera", days, view, how)
    return _free(folder, f"camera_{view}"), head + _CAMERA


def _head(kind: str, instrument: str, days: list[date], view: str, how: str) -> str:
    first, last = (min(days), max(days)) if days else (f'"{GAP}"', f'"{GAP}"')
    return _HEAD.format(
        kind=kind, id="-".join(filter(None, (kind, view, str(first) if days else ""))),
        instrument=instrument, view=f'view = "{view}"\n' if view else "",
        first=first, last=last, gap=GAP, how=how,
    )  # fmt: skip


def _free(folder: Path, stem: str) -> str:
    """Return a name that no file has."""
    name, number = f"calibration/{stem}.toml", 2
    while (folder / name).exists():
        name, number = f"calibration/{stem}_{number}.toml", number + 1
    return name


def _about(folder: Path, names: list[str]) -> tuple[str, list[date]]:
    """Model of the sensor and days of the recordings, as far as the files tell."""
    from pipelines.experiments.film_frames import recorded_on

    models, days = [], []
    for name in names:
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                found = instruments.read(folder / name)
        except LabpipeError:
            continue  # `plan` and `process` say what is wrong with it
        attrs = getattr(found, "attrs", {})
        models.append(str(attrs.get("model", "")))
        day = str(attrs.get("start", ""))[:10] or recorded_on(found)
        if day:
            days.append(date.fromisoformat(day))
    return next(filter(None, models), ""), days
