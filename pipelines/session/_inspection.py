"""Inspection of a single file: its type, content and problems, as plain values.

Readings of every instrument, films, calibration records, session.toml, results and pictures.
"""

from __future__ import annotations

import json
import warnings
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

import msgspec
import numpy as np
import xarray as xr

import instruments
from labpipe.errors import ConfigError, InputError, LabpipeError, SourceError, SourceWarning, UsageError
from labpipe.files import files_below, read_dataset, write_bytes
from labpipe.notebook import html_table
from labpipe.report import display_unit
from labpipe.units import Quantity
from labpipe.workflow.session import FILE_NAME
from pipelines.session._recognition import alike_unknown, instrument_of, recognise

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from instruments import Options
    from labpipe.frames import FrameSource

_KNOWN = (
    "instrument", "model", "serial", "head", "start", "sampling_interval", "sampling_cycle", "storage_factor",
    "averaging", "layout", "encoding", "delimiter", "decimal",
)  # fmt: skip
_SHOWN = 60  # characters of an unknown file
_IRREGULAR = 0.01
"""Of the median interval: a step that differs by more is a problem."""


class Inspected(dict[str, Any]):
    """The properties of a file: a mapping that shows itself."""

    def __repr__(self) -> str:
        return "\n".join(self.lines())

    def _repr_html_(self) -> str:
        rows = [(name.strip(), text) for name, text in self._rows()[1:]]
        return html_table(str(self["file"]), ("", ""), rows)

    def lines(self) -> list[str]:
        """Return it as lines of text."""
        rows = self._rows()
        width = max(20, *(len(name) + 2 for name, _ in rows))
        shown = [f"{name}: {text}" if name == "problem" else f"{name:{width}}{text}".rstrip() for name, text in rows]
        return shown if self["problems"] else [*shown, "problem: none found"]

    def _rows(self) -> list[tuple[str, str]]:
        """Return name and text of each property, column, file and problem."""
        of_own = ("variables", "problems", "files")
        known = [(k.replace("_", " "), v) for k, v in self.items() if k not in of_own]
        rows = [(k, f"{v:.6g}" if isinstance(v, float) else str(v)) for k, v in known]
        for column in self.get("variables", ()):
            invalid = f", {column['invalid']} invalid" if column["invalid"] else ""
            name = f" ({column['long_name']})" if column["long_name"] not in ("", column["name"]) else ""
            rows.append((f"  {column['name']}", f"{_span(column)}{invalid}{name}"))
        rows += [(f"  {part['file']}", f"{part['reader']:14}{part['holds']}") for part in self.get("files", ())]
        return rows + [("problem", line) for line in self["problems"]]


def _span(row: dict[str, Any]) -> str:
    if "values" in row:
        return ", ".join(row["values"])
    if row["min"] is None:
        return "no value"
    unit = display_unit([row["min"], row["max"]], row["units"])
    return f"{row['min'] / unit.factor:z.6g} … {row['max'] / unit.factor:z.6g} {unit.text}".rstrip()


def inspect(
    file: str | Path, *, out: str | Path | None = None, instrument: str | None = None, **options: Unpack[Options]
) -> Inspected:
    """Describe any file: its type, its content, and its problems.

    Parameters
    ----------
    file : path-like
        Readings, a film or the folder of an image stack, a calibration record, session.toml, a
        result, a picture; or a folder of such files, each of which gets a line.
    out : path-like, optional
        Draw it into this .png: frames of a film, columns of a table.
    instrument : str, optional
        The instrument that wrote the file, where it does not say so.
    **options
        Values that the file leaves unsaid, as for :func:`instruments.read`: ``cycle="50 us"``.

    Returns
    -------
    Inspected
        A mapping: ``file``, ``reader``, ``kind``, its properties, and ``problems``; of a table, ``variables``.

    Examples
    --------
    >>> inspect("my-session/laser/drop_1.csv")["reader"]  # doctest: +SKIP
    'keyence'
    """
    reading: dict[str, Any] = {**options} if instrument is None else {**options, "instrument": instrument}
    found = Inspected(describe(Path(file), reading))
    if out is not None:
        write_sheet(Path(file), Path(out), reading)
        found["picture"] = str(out)
    return found


def describe(file: Path, options: dict[str, Any] | None = None) -> dict[str, Any]:
    """Return the properties of a file; ``options`` are those of :func:`inspect`, the instrument among them.

    Its ``kind`` is ``table``, ``film``, ``record``, ``session``, ``result``, ``picture`` or ``folder``. A
    table's columns are in ``variables``: name, long name, unit, range, and number of invalid readings.
    """
    from pipelines.session._results import open_session

    suffix = file.suffix.lower()
    if options or not (file.is_file() or file.is_dir()):  # of an instrument; a pipe is refused
        found = _instrument(file, options or {})
    elif file.name == FILE_NAME:
        found = {"reader": "labpipe", "kind": "session"}
        try:
            session = open_session(file.parent)
            found |= {"title": session.title, "operator": session.operator, "synthetic": session.synthetic}
            found["experiments"] = ", ".join(f"{e.name} ({e.kind})" for e in session.experiments.values())
        except ConfigError as error:
            found["problems"] = list(error.problems)
    elif suffix == ".toml":
        found = _record(file)
    elif suffix == ".nc":
        found = {"reader": "labpipe", "kind": "result"} | table(read_dataset(file))
    elif suffix == ".png" and not file.is_dir():
        import cv2

        image = cv2.imdecode(np.fromfile(file, np.uint8), cv2.IMREAD_UNCHANGED)
        if image is None:
            raise SourceError(file, "is no whole picture; it cannot be decoded", hint="Copy or save it again.")
        found = {"reader": "image", "kind": "picture", "image": f"{image.shape[1]} × {image.shape[0]} px"}
        found |= {"channels": 1 if image.ndim == 2 else image.shape[2], "depth": f"{image.dtype.itemsize * 8} bit"}
        found["levels"] = f"{int(image.min())} … {int(image.max())} seen"
    else:
        found = _instrument(file, {})
    size = sum(part.stat().st_size for part in (files_below(file) if file.is_dir() else [file]))
    problems = found.pop("problems", [])
    return {"file": str(file), "bytes": size} | found | {"problems": problems}


def _instrument(file: Path, options: dict[str, Any]) -> dict[str, Any]:
    from instruments import images

    try:
        given = "plain_table" if options.get("columns") is not None else ""
        name = options.get("instrument") or given or instruments.identify(file, fps=options.get("fps"))
    except SourceError as error:
        if file.is_dir() and (found := _folder(file)):
            return found
        if not file.is_file():
            raise
        with file.open("rb") as stream:
            head = stream.read(_SHOWN)
        look = f"It is {file.stat().st_size} bytes that begin with {head!r}."
        raise SourceError(file, error.message, hint=f"{look} {error.hint or ''}".strip()) from None
    untimed = name == "image_stack" and not options.get("fps")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        source = instruments.read(file, **options | {"instrument": name} | ({"fps": 1.0} if untimed else {}))
        is_table = isinstance(source, xr.Dataset)
        found = table(source) if isinstance(source, xr.Dataset) else film(source, is_timed=not untimed)
    # without the name of the file, which is shown next to them
    said = [w.message.message if isinstance(w.message, SourceWarning) else str(w.message) for w in caught]
    if untimed:  # everything that does not depend on it is shown all the same
        said.insert(0, f"no frame rate. {images.NEEDS_RATE}")
    problems = list(dict.fromkeys([*said, *found.pop("problems")]))
    return {"reader": name, "kind": "table" if is_table else "film", **found, "problems": problems}


def _folder(folder: Path) -> dict[str, Any]:
    """List the files in a folder, and in those within it, a line each; {} where none of them is known."""
    found = recognise(folder)
    rows: list[dict[str, str]] = []
    problems: dict[str, list[str]] = {}
    for name in sorted(found.owners):
        place = folder / name
        try:
            one = describe(place)
            holds, said = _briefly(one), one["problems"]
        except (LabpipeError, OSError) as error:
            one, holds, said = {}, "cannot be read", [getattr(error, "message", "") or str(error)]
            inner = Path(getattr(error, "path", place))
            place = inner if inner.is_relative_to(place) else place  # an image of a film
        reader = one.get("reader") or instrument_of(folder / name) or "calibration"
        rows.append({"file": name, "reader": reader, "holds": holds})
        for problem in said:
            problems.setdefault(problem, []).append(place.relative_to(folder).as_posix())
    for (*_, why), (first, *more) in alike_unknown(found).items():
        others = f" and {len(more)} more beside it" if more else ""
        rows.append({"file": f"{first}{others}", "reader": "", "holds": why})
    rows.sort(key=lambda row: row["file"])
    lines = [f"{', '.join(names)}: {text}" for text, names in problems.items()]
    return {"reader": "labpipe", "kind": "folder", "files": rows, "problems": lines} if found.owners else {}


def _briefly(found: dict[str, Any]) -> str:
    """Return a line on the content of a file that was described."""
    spans = {row["name"]: row for row in found.get("variables", ()) if row.get("min") is not None}
    said, sizes, rate = [found["kind"]], found.get("sizes", ""), found.get("rate")
    if sizes and found["kind"] == "table":
        said = [f"{max(int(size.rpartition(' ')[2]) for size in sizes.split(', ')):,} readings"]
    if said[0] != "film" and rate is not None:
        unit = display_unit([hertz := float(rate.removesuffix(" Hz"))], "Hz")
        said[0] += f" at {hertz / unit.factor:.4g} {unit.text}"
        said.append(f"{float(format(float(found['duration'].removesuffix(' s')), '.3g')):g} s")
    said += [_span(spans[n]) for n in ("temperature", "frequency") if n in spans]
    count = len(found["problems"])
    return ", ".join([*said, *([f"{count} problem{'s' * (count > 1)}"] if count else [])])


def table(dataset: xr.Dataset) -> dict[str, Any]:
    """Describe readings: header, sampling, and every column with unit and range."""
    columns: list[dict[str, Any]] = []
    for name, variable in dataset.variables.items():
        row: dict[str, Any] = {"name": str(name)} | {k: str(variable.attrs.get(k, "")) for k in ("long_name", "units")}
        row |= {"min": None, "max": None, "invalid": 0}
        if variable.dtype.kind not in "fiub":
            row["values"] = sorted({str(v) for v in variable.values.ravel().tolist()})[:8]
        elif variable.size:
            values = np.asarray(variable.values, float)
            finite = values[np.isfinite(values)]
            row["invalid"] = int(values.size - finite.size)
            row |= {"min": float(finite.min()), "max": float(finite.max())} if finite.size else {}
        columns += [row] if variable.size else []
    known = {k: dataset.attrs[k] for k in _KNOWN if dataset.attrs.get(k) not in (None, "")}
    sampling, problems = _sampling(dataset)
    sizes = ", ".join(f"{k} {v}" for k, v in dataset.sizes.items())
    states = json.loads(dataset.attrs.get("status_counts", "{}"))
    ends = np.cumsum([part["rows"] for part in json.loads(dataset.attrs.get("tests", "[]"))])[:-1].astype(int)
    longest = max(dataset.sizes.values(), default=0)
    for row in (row for row in columns if row["invalid"] and dataset[row["name"]].size == longest):  # no header
        lost = np.split(np.isnan(dataset[row["name"]].values), ends)
        if any(part.any() and not part.all() for part in lost):  # tables in the file may lack a column
            states_of = states.get(row["name"].replace("out", "status"), {})
            why = ", ".join(f"{n} {s}" for s, n in states_of.items() if s != "VALID")
            text = f"{row['name']}: {row['invalid']} of {longest} readings are invalid"
            problems.append(text + (f" ({why})" if why else ""))
    if dataset.attrs.get("incomplete"):
        problems.append("the file is incomplete: it ends before its end mark")
    return {**known, "sizes": sizes, **sampling, "variables": columns, "problems": problems}


def _sampling(dataset: xr.Dataset) -> tuple[dict[str, Any], list[str]]:
    """Describe the time axis: interval, rate, duration, and where it is uneven."""
    if "time" not in dataset.variables or dataset["time"].ndim != 1 or dataset["time"].size < 2:
        return {}, []
    time = np.asarray(dataset["time"].values, float)
    steps = np.diff(time)
    forward = steps[steps > 0]
    if not forward.size:
        return {}, ["the time does not advance"]
    interval = float(np.median(forward))
    duration = f"{float(time.max() - time.min()):.6g} s"
    found = {"interval": f"{interval:.6g} s", "rate": f"{1.0 / interval:.6g} Hz", "duration": duration}
    restarts = int((steps <= 0).sum())
    uneven = int((np.abs(forward - interval) > _IRREGULAR * interval).sum())
    of_rheometer = "interval" in dataset.variables  # which samples as it likes
    if uneven > len(forward) // 2 or (uneven and of_rheometer):
        return {"interval": "uneven", "duration": duration}, []
    problems = []
    if restarts and "block" not in dataset.variables and not of_rheometer:
        problems.append(f"the time goes back {'once' if restarts == 1 else f'{restarts} times'}, so no rate is known")
        found = {"interval": "unknown"}
    if uneven:
        worst = float(forward.max())
        problems.append(f"{uneven} of {len(forward)} steps in time are uneven, up to {worst:.4g} s")
    return found, problems


def film(frames: FrameSource, *, is_timed: bool = True) -> dict[str, Any]:
    """Describe a film: size, times where they are known, exposure, levels, damaged frames."""
    count, rows, columns = frames.shape
    time, valid = frames.time, frames.valid
    axis = getattr(frames, "time_axis", None)
    problems = list(getattr(axis, "warnings", ()))
    if not valid.all():
        problems.append(f"{int((~valid).sum())} of {count} frames are damaged")
    steps = np.diff(time)
    interval = float(np.nanmedian(steps)) if count > 1 else None
    if is_timed and interval is not None and (np.abs(steps - interval) > 0.5 * interval).any():
        problems.append(f"frames are missing: the longest step is {np.nanmax(steps):.4g} s")
    exposure = frames.exposure
    origin = "trigger" if hasattr(frames, "header") else "first image"
    found: dict[str, Any] = {"frames": count, "image": f"{columns} × {rows} px"}
    if is_timed:
        found["interval"] = "unknown" if interval is None else f"{interval:.6g} s"
        found["rate"] = "unknown" if interval is None else f"{1.0 / interval:.6g} Hz"
        found["time"] = f"{time[0]:.6g} … {time[-1]:.6g} s from the {origin}"
    found["exposure"] = "unknown" if exposure is None else f"{np.nanmedian(exposure):.3g} s"
    found["levels"] = f"{frames.levels[0]:g} black, {frames.levels[1]:g} white"
    return found | {"problems": problems}


def _record(file: Path) -> dict[str, Any]:
    """Describe a calibration record, or a material, whichever the file is."""
    from calibration import load_record
    from labpipe.workflow.document import parse

    tree = parse(file).tree
    if "kind" not in tree:
        return {"reader": "labpipe", "kind": "toml", "keys": ", ".join(tree)}
    head: dict[str, Any] = {"reader": "calibration", "kind": "record"}
    try:
        record: Any = load_record(file)
    except LabpipeError as error:
        return head | {"problems": str(error).splitlines()}
    names = ("id", "instrument", "serial", "valid_from", "valid_until", "who", "how")
    stated = {name: str(getattr(record, name)) for name in names if getattr(record, name, None)}
    values = msgspec.structs.asdict(record.values)
    return head | {"of": record.kind} | stated | {n: str(v) for n, v in values.items() if isinstance(v, Quantity)}


def write_sheet(
    source: Path, target: Path, options: dict[str, Any] | None = None, *, frames: int = 8, columns: int = 6
) -> None:
    """Draw some frames of a film, or columns of a table, of a known instrument into a .png.

    Options are those of :func:`instruments.read`.
    """
    if target.suffix.lower() != ".png":
        raise UsageError(f"{target}: the picture is written as .png; name it so")
    if target.resolve() == source.resolve():
        raise UsageError(f"{target} is the file itself, which is never written; name another picture")
    found = instruments.read(source, **options or {})
    stream = BytesIO()
    figure = _curves(found, columns) if isinstance(found, xr.Dataset) else _frames(found, frames)
    figure.savefig(stream, format="png", dpi=100, metadata={"Software": None})
    write_bytes(target, stream.getvalue())


def _frames(film: FrameSource, most: int, across: float = 9.0) -> Figure:
    """Draw the first sound frame, ``across`` inches, with its pixels along the sides, and below it others evenly."""
    from matplotlib.figure import Figure

    sound = np.flatnonzero(film.valid)
    if not sound.size:
        raise InputError("no frame of the film can be decoded")
    count, rows, columns = film.shape
    chosen = np.unique(np.linspace(0, count - 1, min(most, count)).round().astype(int)).tolist()
    high, low = across * min(rows / columns, 1.0), across / len(chosen) * rows / columns
    figure = Figure(figsize=(across + 1.0, high + low + 1.2), layout="constrained")
    top, below = figure.subfigures(2, 1, height_ratios=(high + 1.0, low), squeeze=False)[:, 0]
    black, white = film.levels
    first = top.subplots()
    first.imshow(film[int(sound[0])], cmap="gray", vmin=black, vmax=white, interpolation="nearest")
    first.set(xlabel="x / px", ylabel="y / px", title=f"frame {sound[0]}")
    first.minorticks_on()
    first.grid(color="tab:orange", linewidth=0.5, alpha=0.6)
    for axes, index in zip(below.subplots(1, len(chosen), squeeze=False)[0], chosen, strict=True):
        axes.set_axis_off()
        if film.valid[index]:  # a smaller picture is smoothed before, so that no pattern is invented
            axes.imshow(film[index], cmap="gray", vmin=black, vmax=white)
    return figure


def _curves(dataset: xr.Dataset, most: int) -> Figure:
    """Draw the numeric columns of a table over its first long axis, one below the other."""
    from matplotlib.figure import Figure

    longest = max(dataset.sizes.values(), default=0)
    columns = [v for v in dataset.data_vars.values() if v.shape == (longest,) and v.dtype.kind == "f"]
    columns = [v for v in columns if np.isfinite(v.values).any()][:most]
    if not columns:
        raise InputError("the file holds no column of numbers to draw")
    x, title = np.arange(longest), str(columns[0].dims[0])
    # a clock that starts again in every block would lay the blocks over each other
    if "time" in dataset.variables and dataset["time"].size == longest and (np.diff(dataset["time"]) > 0).all():
        x, title = dataset["time"].values, "time / s"
    figure = Figure(figsize=(7.0, 1.5 * len(columns) + 0.4), layout="constrained")
    for axes, variable in zip(figure.subplots(len(columns), 1, squeeze=False)[:, 0], columns, strict=True):
        axes.plot(x, variable.values, linewidth=0.7)
        axes.set_ylabel(f"{variable.name} / {variable.attrs.get('units', '')}")
    axes.set_xlabel(title)
    return figure
