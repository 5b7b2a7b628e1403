"""Calibration records that recordings take, templates for those without one, and the first lines of a film."""

import json
import tomllib
import warnings
from collections.abc import Callable, Container, Sequence
from dataclasses import replace
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
    "laser": ("Keyence laser", "micrometer steps against the reading", _LASER),
    "camera": ("camera", "a ruler in the plane of focus", _CAMERA),
    "load_cell": ("load cell", "masses, displayed against true force", _CELL),
}
"""Instrument, method and values of a record, by its kind."""
_NONE = f"calibration/{GAP}.toml"


def with_missing_records(found: Found) -> Found:
    """Return a scan with records for a laser whose readings came without one, and for each view that is filmed so.

    They are ``texts`` by names that replace no file, valid on the days of the recordings.
    """
    wanted = {("laser", ""): found.of("displacement")} if not found.of("record:laser") else {}
    for film in found.of("film"):
        seen = view(film)
        if _fitting(found, found.of("record:camera"), _about(found.folder, [film])[1], seen) is None:
            wanted.setdefault(("camera", seen), []).append(film)
    names, texts = dict(found.names), dict[str, str]()
    for (kind, seen), recordings in sorted(wanted.items()):
        if recordings:
            name, text = blank_record(found.folder, kind, seen, recordings, texts)
            texts[name] = text
            names[f"record:{kind}"] = [*names.get(f"record:{kind}", []), name]
    return replace(found, names=names, texts=texts)


def blank_record(folder: Path, kind: str, view: str, recordings: list[str], taken: Container[str]) -> tuple[str, str]:
    """Return name and text of a new record of a laser, load cell, or view of a camera, for the days of recordings.

    It takes the place of no file, nor of one of the names ``taken``. Raises InputError for another kind.
    """
    if kind not in _TEMPLATES:
        raise InputError(f'a record of kind "{kind}" is written by hand: the guide says how, For the experimenter')
    (usual, how, values), (model, days) = _TEMPLATES[kind], _about(folder, recordings)
    seen = identifier(view) if kind == "camera" else ""
    stem = name = "_".join(filter(None, (f"calibration/{kind}", seen)))
    number = 2
    while (folder / f"{name}.toml").exists() or f"{name}.toml" in taken:
        name, number = f"{stem}_{number}", number + 1
    first, last = (min(days), max(days)) if days else (f'"{GAP}"', f'"{GAP}"')
    text = _HEAD.format(
        kind=kind,
        id="-".join(filter(None, (kind, seen, str(first) if days else ""))),
        instrument=usual if kind == "camera" else model or usual,
        view=f'view = "{seen}"\n' if seen else "",
        first=first,
        last=last,
        gap=GAP,
        how=how,
    )
    return f"{name}.toml", text + values


def laser_record(found: Found, recording: str, fits: Callable[[str], bool] = lambda name: True) -> str:
    """Return the laser record that is valid on the day of a recording; ``fits`` decides by its name whether it may be.

    Where none is valid on that day it is the first one, which is then refused with its days; the gap for a record
    where there is none.
    """
    names = [name for name in found.of("record:laser") if fits(name)]
    days = _about(found.folder, [recording])[1] if len(names) > 1 else []
    return _fitting(found, names, days) or next(iter(names), _NONE)


def head(found: Found, film: str, kind: str, name: str, why: str = "proposed from the file name") -> str:
    """Return the first lines of an experiment with a film; a person knows its view better."""
    seen = view(film)
    record = _fitting(found, found.of("record:camera"), _about(found.folder, [film])[1], seen) or _NONE
    rate = f'\nframe_rate = "{GAP} Hz"  # of the camera: images hold no time' * is_exported(found, film)
    return f"""[experiments.{name}]
kind = "{kind}"  # {why}
film = "{quoted(film)}"
camera = "{record}"  # image scale of this view, with its uncertainty
view = "{seen}"  # as the record says{rate}"""


def is_exported(found: Found, film: str) -> bool:
    """Return whether a film was exported as images, which may be pictures of anything."""
    return film in found.of("image_stack")


def _fitting(found: Found, names: Sequence[str], days: Sequence[date], seen: str | None = None) -> str | None:
    """Return the first record of a view that is valid on some days; days still to be stated fit all."""
    for name in names:
        try:
            values = tomllib.loads(found.texts.get(name) or found.path(name).read_text("utf-8"))
        except (OSError, ValueError):
            continue
        first, last = values.get("valid_from"), values.get("valid_until")
        is_valid = True
        if isinstance(first, date) and isinstance(last, date):
            is_valid = all(first <= day <= last for day in days)
        if is_valid and seen in (None, values.get("view")):
            return name
    return None


def _about(folder: Path, names: list[str]) -> tuple[str, list[date]]:
    """Return the model of the sensor, or name of the load cell, and the days of recordings that the files hold."""
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
        if day := str(attrs.get("start", ""))[:10] or recorded_on(found):
            days.append(date.fromisoformat(day))
    return next(filter(None, models), ""), days
