"""Templates of calibration records, for readings without one."""

import warnings
from datetime import date
from pathlib import Path

import instruments
from labpipe.errors import LabpipeError
from pipelines.experiments._kind import Found
from pipelines.experiments.shared.film_frames import recorded_on
from pipelines.experiments.shared.proposals import GAP, view

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


def laser_records(found: Found) -> dict[str, dict[str, str]]:
    """Propose a record for a laser whose readings came without one.

    Parameters
    ----------
    found : Found

    Returns
    -------
    dict
        Kind of record (``record:laser``) to names and texts of files; nothing that would replace
        a file.
    """
    if not found.of("displacement") or found.of("record:laser"):
        return {}
    name = _free(found.folder, "laser")
    model, days = _about(found.folder, found.of("displacement"))
    how = "micrometer steps against the reading"
    head = _head("laser", model or "Keyence laser", days, "", how)
    return {"record:laser": {name: head + _LASER}}


def camera_records(found: Found) -> dict[str, dict[str, str]]:
    """Propose a record for every view that is filmed and has none, as :func:`laser_records`."""
    known = found.of("record:camera")
    films = {view(name): name for name in found.of("film")}
    made = {}
    for seen, film in sorted(films.items()):
        if not any(seen in record for record in known):
            _, days = _about(found.folder, [film])
            head = _head("camera", "camera", days, seen, "a ruler in the plane of focus")
            made[_free(found.folder, f"camera_{seen}")] = head + _CAMERA
    return {"record:camera": made} if made else {}


def _head(kind: str, instrument: str, days: list[date], view: str, how: str) -> str:
    first, last = (min(days), max(days)) if days else (f'"{GAP}"', f'"{GAP}"')
    return _HEAD.format(
        kind=kind,
        id="-".join(filter(None, (kind, view, str(first) if days else ""))),
        instrument=instrument,
        view=f'view = "{view}"\n' if view else "",
        first=first,
        last=last,
        gap=GAP,
        how=how,
    )


def _free(folder: Path, stem: str) -> str:
    """Return a name that no file has."""
    name, number = f"calibration/{stem}.toml", 2
    while (folder / name).exists():
        name, number = f"calibration/{stem}_{number}.toml", number + 1
    return name


def _about(folder: Path, names: list[str]) -> tuple[str, list[date]]:
    """Model of the sensor and days of the recordings, as far as the files tell."""
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
