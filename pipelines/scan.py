"""From a folder of instrument files to a first session.toml, commented, with gaps to fill in.

Instruments are told by content. Repeats are files whose names differ in their last number only.
A drop height in a name (``7mm``, ``h1p5``) is taken as a proposal and marked as such. What no
file tells is asked for, or written as ``FILL``; the session is refused, line by line, until it is
filled. A calibration record that is missing is proposed as a file of its own.
"""

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import instruments
from labpipe import files
from labpipe.errors import LabpipeError, UsageError
from labpipe.workflow.session import FILE_NAME, VERSION
from pipelines.gaps import GAP, MODES, Gap, filled
from pipelines.record_templates import camera_template, missing_records

_HEIGHT = re.compile(r"(?<![\d.])(\d+(?:[.p]\d+)?)\s*mm", re.IGNORECASE)
_SHORT_HEIGHT = re.compile(r"(?:^|[_-])h(\d+(?:[.p]\d+)?)(?=$|[_-])", re.IGNORECASE)
_REPEAT = re.compile(r"[_\- ]*(?:r|rep|run|repeat|test)?[_\- ]*\d+$", re.IGNORECASE)
_UNDER = re.compile(r"under|disc|contact|below", re.IGNORECASE)
_PLATE = re.compile(r"plate|vibration", re.IGNORECASE)
_DEPTH = re.compile(r"[_\- ]*\d+(?:[.p]\d+)?\s*(?:um|µm|mm)?$", re.IGNORECASE)
_SLOW = 0.1  # s between readings: no drop is seen so slowly
_MATERIALS = ("acrylic", "pmma", "peek", "nylon", "ptfe", "nbr")


@dataclass(frozen=True, slots=True)
class Scan:
    """What :func:`write_session_file` wrote: the file, its experiments, and what is to fill in.

    ``records`` are calibration records that were proposed; ``unused`` names files of a known
    instrument that no proposed experiment takes.
    """

    path: Path
    experiments: list[str]
    gaps: list[str]
    records: list[Path]
    unused: list[str]


@dataclass(frozen=True, slots=True)
class _Group:
    """Files of one experiment, relative to the session, and the name they suggest."""

    name: str
    files: list[str]


def write_session_file(
    folder: Path, replace: bool = False, ask: Callable[[Gap], str | None] | None = None
) -> Scan:
    """Scan a folder and write its session.toml.

    Parameters
    ----------
    folder : Path
        The session folder.
    replace : bool
        Replace a session.toml that is already there.
    ask : callable, optional
        Returns the answer to a question that no file answers, or None to leave it open.

    Raises
    ------
    UsageError
        There is a session.toml, or the folder holds no file of a known instrument.
    """
    path = folder / FILE_NAME
    if path.exists() and not replace:
        message = f"{path} exists already; edit it, or use --force to replace it"
        raise UsageError(message)
    found, owners = recognise(folder)
    records = dict(missing_records(folder, found).values())
    records |= _camera_records(folder, found)
    text, names = propose(folder, _with_records(found, records))
    if not names:
        raise UsageError(_nothing_proposed(folder, owners))
    begun = {n: (folder / n).read_text("utf-8") for n in _records(found)}
    texts = {FILE_NAME: text, **records, **{n: t for n, t in begun.items() if GAP in t}}
    if ask is not None:
        texts = {name: filled(content, ask, _owner(name)) for name, content in texts.items()}
    for name in reversed(texts):  # session.toml last: with it, the folder is a session
        if texts[name] != begun.get(name):
            files.write_text(folder / name, texts[name])
    gaps = [
        f"{name}:{number}: {line.strip()}"
        for name, content in texts.items()
        for number, line in enumerate(content.splitlines(), 1)
        if GAP in line and not line.lstrip().startswith("#")
    ]
    unused = [
        f"{name} ({title}): {reason}"
        for name, (title, reason) in owners.items()
        if f'"{_quoted(name)}"' not in text
    ]
    return Scan(path, names, gaps, [folder / name for name in records], unused)


def _owner(name: str) -> str:
    """Name a calibration record in questions; session.toml's tables are named already."""
    return "" if name == FILE_NAME else f"calibration of {Path(name).stem.replace('_', ' ')}"


def _camera_records(folder: Path, found: dict[str, list[str]]) -> dict[str, str]:
    """Propose a record for every view that is filmed and has none."""
    known = found.get("record:camera", [])
    views = {_view(name): name for name in found.get("film", [])}
    return dict(
        camera_template(folder, film, view)
        for view, film in sorted(views.items())
        if not any(view in record for record in known)
    )


def _records(found: dict[str, list[str]]) -> list[str]:
    return [n for kind, names in found.items() if kind.startswith("record:") for n in names]


def _with_records(found: dict[str, list[str]], records: dict[str, str]) -> dict[str, list[str]]:
    """Add the records that will be written to those that are there."""
    lasers = [name for name in records if "laser" in name]
    cameras = [name for name in records if "camera" in name]
    return found | {
        "record:laser": found.get("record:laser", []) + lasers,
        "record:camera": found.get("record:camera", []) + cameras,
    }


def _view(film: str) -> str:
    return "under" if _UNDER.search(film) else "front"


def recognise(folder: Path) -> tuple[dict[str, list[str]], dict[str, tuple[str, str]]]:
    """Return what the files of a folder are.

    Returns
    -------
    found : dict
        Instrument (``"keyence"``, …), content of readings from which experiments may begin
        (``"displacement"``, …) and kind of calibration record (``"record:laser"``, …) to names
        relative to ``folder``.
    owners : dict
        Names of all readings to what wrote them, and why no experiment would be proposed.
    """
    found: dict[str, list[str]] = {}
    owners: dict[str, tuple[str, str]] = {}
    for path in _candidates(folder):
        name = path.relative_to(folder).as_posix()
        if path.suffix == ".toml":
            if (kind := _record_kind(path)) is not None:
                found.setdefault(kind, []).append(name)
                owners[name] = (kind.replace("_", " "), "no experiment names it")
        elif (instrument := _instrument(path)) is not None:
            found.setdefault(instrument, []).append(name)
    for each in instruments.known():
        for name in found.get(each.name, []):
            owners[name] = (each.title, each.unproposed or _UNTOLD[each.content])
            if not each.unproposed:
                found.setdefault(each.content, []).append(name)
    return found, owners


_UNTOLD: dict[instruments.Content, str] = {
    "displacement": "no kind of experiment is told by it alone; add it by hand",
    "force": "it holds neither an oscillation nor a relaxation; add it by hand",
    "film": "no kind of experiment is told by it alone; add it by hand",
    "sweep": "it holds no moduli over frequency and temperature; add it by hand",
    "displacement_field": "no kind of experiment begins from it",
}


def _nothing_proposed(folder: Path, owners: dict[str, tuple[str, str]]) -> str:
    """Say what was found and why no experiment begins from it; or that nothing is known."""
    of_reason: dict[tuple[str, str], list[str]] = {}
    for name, why in owners.items():
        of_reason.setdefault(why, []).append(name)
    for place in [folder, *sorted(p for p in folder.rglob("*") if p.is_dir())]:
        if (whole := _instrument(place)) is not None:
            each = instruments.by_name(whole)
            why = (each.title, each.unproposed or _UNTOLD[each.content])
            of_reason.setdefault(why, []).append(place.relative_to(folder).as_posix())
    if not of_reason:
        known = ", ".join(each.name for each in instruments.known())
        return (
            f"{folder}: no file of a known instrument was found; known are {known}. "
            "Is it the right folder?"
        )
    lines = [f"{folder}: no experiment is proposed"]
    for (title, reason), names in of_reason.items():
        more = f" and {len(names) - 1} more" if len(names) > 1 else ""
        lines.append(f"{names[0]}{more} ({title}): {reason}")
    return "\n  ".join(lines)


def _candidates(folder: Path) -> Iterator[Path]:
    for path in files.files_below(folder):
        parts = path.relative_to(folder).parts
        hidden = any(part.startswith(".") for part in parts)
        if not hidden and parts[0] not in {"labpipe", "truth", FILE_NAME}:
            yield path


def _instrument(path: Path) -> str | None:
    try:
        return instruments.identify(path)
    except LabpipeError:
        return None


def _record_kind(path: Path) -> str | None:
    """Name the kind that a record claims; an incomplete one is a record that has gaps."""
    from calibration import KINDS
    from labpipe.workflow.document import parse

    try:
        kind = parse(path).tree.get("kind")
    except LabpipeError:
        return None
    return f"record:{kind}" if isinstance(kind, str) and kind in KINDS else None


def propose(folder: Path, found: dict[str, list[str]]) -> tuple[str, list[str]]:
    """Return the text of session.toml and the names of the proposed experiments."""
    names: list[str] = []
    sections = [
        f"labpipe = {VERSION}  # version of this file's format",
        "",
        "[session]",
        f'title = "{_quoted(folder.resolve().name)}"',
        'operator = ""',
        'notes = ""',
    ]
    for content, proposal in PROPOSALS.items():
        for each in (i for i in instruments.known() if i.content == content and not i.unproposed):
            for group in _grouped(found.get(each.name, []), content in REPEATED):
                name = _unused(_experiment_name(folder, group, content), names)
                text = proposal(folder, name, group.files, found)
                if text is not None:
                    names.append(name)
                    sections += ["", text]
    return "\n".join(sections) + "\n", names


def _experiment_name(folder: Path, group: _Group, content: str) -> str:
    """Name an experiment; relaxations to several depths are one, which no depth names."""
    if content == "force" and _relaxes(folder, group.files[0]):
        return _identifier(_depthless(group.files[0]))
    return group.name


def _grouped(names: list[str], is_repeated: bool) -> list[_Group]:
    groups: dict[str, list[str]] = {}
    for name in names:
        stem = Path(name).with_suffix("").as_posix()
        stem = (_REPEAT.sub("", stem) or stem) if is_repeated else stem
        groups.setdefault(stem, []).append(name)
    return [_Group(_identifier(stem), sorted(group)) for stem, group in sorted(groups.items())]


def _identifier(stem: str) -> str:
    return re.sub(r"[^A-Za-z0-9_-]+", "_", stem.rsplit("/", 1)[-1]).strip("_") or "experiment"


def _unused(name: str, names: list[str]) -> str:
    number, wanted = 2, name
    while name in names:
        name, number = f"{wanted}_{number}", number + 1
    return name


def _quoted(text: str) -> str:
    return text.replace("\\", "\\\\").replace('"', '\\"')


def _list(names: list[str]) -> str:
    return "[\n" + "".join(f'  "{_quoted(name)}",\n' for name in names) + "]"


def _material_word(name: str) -> str | None:
    return next((m for m in _MATERIALS if m in name.lower()), None)


def _material(name: str) -> str:
    known = _material_word(name)
    if known is None:
        return f'material = "{GAP}"  # acrylic, peek, nylon, ptfe, nbr, or use material_file'
    return f'material = "{known.replace("pmma", "acrylic")}"  # proposed from the file name'


def _mode(name: str) -> str:
    known = next((m for m in MODES if m in name.lower()), None)
    if known is None:
        return f'mode = "{GAP}"  # {", ".join(MODES[:-1])} or {MODES[-1]}; the file does not say it'
    return f'mode = "{known}"  # proposed from the file name'


def _height(name: str) -> str:
    match = _HEIGHT.search(name) or _SHORT_HEIGHT.search(name)
    if match is None:
        return f'height = "{GAP} mm"  # fall from release to first touch, e.g. "1.500 ± 0.005 mm"'
    return f'height = "{match[1].replace("p", ".")} mm"  # proposed from the file name; add ± u'


def _laser(folder: Path, name: str, names: list[str], found: dict[str, list[str]]) -> str:
    """Propose what a laser saw: slow readings are a static loading, the plate is told by its name.

    A person knows better.
    """
    if _PLATE.search(names[0]):
        return _plate_vibration(name, names, found)
    if _interval(folder / names[0]) >= _SLOW:
        return _static_loading(name, names, found)
    return _ball_drop(name, names, found)


def _interval(path: Path) -> float:
    """Return the time between two readings in s; 0 when the file does not say it."""
    try:
        found = instruments.read(path)
    except LabpipeError:
        return 0.0
    return float(getattr(found, "attrs", {}).get("sampling_interval", 0.0))


def _static_loading(name: str, names: list[str], found: dict[str, list[str]]) -> str:
    record = next(iter(found.get("record:laser", [])), f"calibration/{GAP}.toml")
    return f"""[experiments.{name}]
kind = "static_loading"  # proposed because the readings are slow
laser = "{_quoted(names[0])}"
calibration = "{record}"  # inclination of the sensor, with its uncertainty

[experiments.{name}.sphere]
radius = "{GAP} mm"  # of the sphere, e.g. "9.525 ± 0.005 mm"
{_material(name)}

[[experiments.{name}.loads]]  # on from the beginning
mass = "{GAP} kg"  # all that rests on the disc, holder included

[[experiments.{name}.loads]]  # one such table for each further load
mass = "{GAP} kg"  # all that rests on the disc then
# time = "2.55 min"  # when it was put on; without it the record is searched"""


def _plate_vibration(name: str, names: list[str], found: dict[str, list[str]]) -> str:
    records = found.get("record:laser", [])
    record = next((r for r in records if _PLATE.search(r)), f"calibration/{GAP}.toml")
    return f"""[experiments.{name}]
kind = "plate_vibration"  # proposed from the file name
calibration = "{record}"  # inclination of the sensor in its place over the plate

[experiments.{name}.sphere]  # for the modal mass; without it frequency and damping alone
radius = "{GAP} mm"
mass = "{GAP} g"  # of all that moves: sphere and holder

[[experiments.{name}.drops]]  # one such table for each material and height
{_material(name)}
{_height(name)}
laser = {_list(names)}"""


def _ball_drop(name: str, names: list[str], found: dict[str, list[str]]) -> str:
    record = next(iter(found.get("record:laser", [])), f"calibration/{GAP}.toml")
    return f"""[experiments.{name}]
kind = "ball_drop"
laser = {_list(names)}
calibration = "{record}"  # inclination of the sensor, with its uncertainty
{_height(name)}

[experiments.{name}.sphere]
radius = "{GAP} mm"  # of the sphere, e.g. "9.525 ± 0.005 mm"
mass = "{GAP} g"  # of all that moves: sphere and holder
{_material(name)}"""


def _indentation(
    folder: Path, name: str, names: list[str], found: dict[str, list[str]]
) -> str | None:
    """Propose what the blocks of a file are made for; relaxations to several depths are one."""
    if _oscillates(folder, names[0]):
        head = f'kind = "harmonic"\nmach1 = "{_quoted(names[0])}"'
    elif _relaxes(folder, names[0]):
        same = [n for n in found["force"] if _depthless(n) == _depthless(names[0])]
        tests = [n for n in sorted(same) if _relaxes(folder, n)]
        if names[0] != tests[0]:
            return None  # it is in the experiment of the first
        listed = _list(tests) if len(tests) > 1 else f'["{_quoted(tests[0])}"]'
        head = f'kind = "relaxation"\nmach1 = {listed}'
    else:
        return None
    record = next(iter(found.get("record:load_cell", [])), None)
    cell = "" if record is None else f'\n[experiments.{name}.load_cell]\nrecord = "{record}"'
    return f"""[experiments.{name}]
{head}
# For the simulation beside the measurement, say what was pressed into what:
# [experiments.{name}.punch]
# radius = "2 mm"      # of a cylindrical tip
# period = "8 mm"      # distance of neighbouring tips
# depth = "6 mm"       # length of one tip
# tips = 3
# [experiments.{name}.substrate]
# material = "nbr"{cell}\
"""


def _oscillates(folder: Path, name: str) -> bool:
    return b"<Sinusoid>" in (folder / name).read_bytes()


def _relaxes(folder: Path, name: str) -> bool:
    """Tell whether a file holds a relaxation and no oscillation after it."""
    data = (folder / name).read_bytes()
    return b"<Stress Relaxation>" in data and b"<Sinusoid>" not in data


def _depthless(name: str) -> str:
    """Return a file's name without the depth or number at its end."""
    stem = Path(name).with_suffix("").as_posix()
    return _DEPTH.sub("", stem) or stem


def _dma(folder: Path, name: str, names: list[str], found: dict[str, list[str]]) -> str | None:
    try:
        readings = instruments.read(folder / names[0])
    except LabpipeError:
        return None  # the layout of a table window, or an export that is damaged
    if not {"storage_modulus", "temperature", "frequency"} <= set(
        getattr(readings, "data_vars", ())
    ):
        return None
    return f"""[experiments.{name}]
kind = "dma"
rheometer = {_list(names)}
{_mode(name)}
nu = "{GAP}"  # Poisson's ratio, e.g. "0.35 ± 0.02"
# T_ref = "20 degC"  # of the master curve; by default the middle temperature\
{_published(folder, found)}"""


def _published(folder: Path, found: dict[str, list[str]]) -> str:
    """Propose the comparison with a table of shift factors, if there is exactly one."""
    tables = [n for n in found.get("plain_table", []) if _holds_shifts(folder / n)]
    if len(tables) != 1:
        return ""
    return f'''
published = {{ shifts = "{_quoted(tables[0])}", source = "" }}  # to compare with'''


def _holds_shifts(path: Path) -> bool:
    try:
        return "log10_aT" in getattr(instruments.read(path), "data_vars", ())
    except LabpipeError:
        return False


def _film(folder: Path, name: str, names: list[str], found: dict[str, list[str]]) -> str:
    """Propose what a film shows by its name; a person knows better."""
    word = _view(names[0])
    is_under = word == "under"
    records = found.get("record:camera", [])
    record = next((r for r in records if word in r), f"calibration/{GAP}.toml")
    head = f"""[experiments.{name}]
kind = "{"contact_area" if is_under else "dic_validation"}"  # proposed from the file name
film = "{_quoted(names[0])}"
camera = "{record}"  # image scale of this view, with its uncertainty
view = "{word}"  # as the record says"""
    if not is_under:
        return f"""{head}
{_laser_beside(folder, names[0], found)}
# tracking = {{ body = [x, y], body_subset = 101 }}  # px in the first image, on the holder"""
    return f"""{head}
wavelength = "{GAP} nm"  # of the light; "none" for white light
{_height(name)}

[experiments.{name}.sphere]
radius = "{GAP} mm"  # of the sphere, e.g. "9.525 ± 0.005 mm"
mass = "{GAP} g"  # of all that moves: sphere and holder
{_material(name)}"""


def _laser_beside(folder: Path, film: str, found: dict[str, list[str]]) -> str:
    """Propose the one drop of the film's material as what the laser saw of the same motion."""
    word = _material_word(film)
    drops = [
        group.name
        for group in _grouped(found.get("displacement", []), is_repeated=True)
        if word is not None
        and word == _material_word(group.files[0])
        and not _PLATE.search(group.files[0])
        and _interval(folder / group.files[0]) < _SLOW
    ]
    if len(drops) == 1:
        return f'laser_experiment = "{drops[0]}"  # proposed: the only drop of this material'
    return '# laser_experiment = "NAME"  # the ball drop whose laser saw the same motion'


REPEATED = {"displacement"}
"""Contents whose files come as repeats of one experiment; others hold one experiment each."""

PROPOSALS: dict[str, Callable[[Path, str, list[str], dict[str, list[str]]], str | None]] = {
    "displacement": _laser,
    "force": _indentation,
    "film": _film,
    "sweep": _dma,
}
