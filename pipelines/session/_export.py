"""Results and raw files for other programs: selection, names and formats."""

from __future__ import annotations

import json
import re
import warnings
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from labpipe import files
from labpipe.errors import InputError, UsageError
from labpipe.notebook import Shown, ShownAsTable
from labpipe.variables import described, variable
from labpipe.workflow.exclusions import exclusions
from labpipe.workflow.plan import READY, plan as make_plan
from labpipe.workflow.results import Results
from labpipe.workflow.session import FILE_NAME
from pipelines.experiments import KINDS
from pipelines.session._recognition import instrument_of
from pipelines.session._results import STAGES, derive, needed, opened, reopen_session
from pipelines.session._verdicts import stored_verdicts

if TYPE_CHECKING:
    import xarray as xr

_PARTS = {
    "csv": ("table", "results"), "nc": ("results",), "mat": ("results",), "json": ("materials", "results"),
    "xlsx": ("table",), "tex": ("table",),
} | dict.fromkeys(("abaqus", "ansys", "comsol", "lsdyna"), ("materials",))  # fmt: skip
"""What an export of a session holds: results of the steps, one table of its quantities, materials for simulation."""
FORMATS = tuple(_PARTS)
FOLDER = "export"
"""Below ``SESSION/labpipe``: files in it may be replaced."""
_SYNTHETIC = "yes: made by a virtual rig, not measured"


@dataclass(frozen=True, slots=True, repr=False)
class Exported(ShownAsTable):
    """The files that an export wrote, and the results that it left out, each with the reason."""

    paths: tuple[Path, ...]
    left_out: tuple[str, ...]

    def _shown(self) -> Shown:
        folders = dict.fromkeys(path.parent.name for path in self.paths)
        rows = [("written", path.name) for path in self.paths] + [("left out", line) for line in self.left_out]
        return Shown(f"{len(self.paths)} files in {', '.join(folders)}", ("", ""), rows)


@dataclass(slots=True)
class Writer:
    """Writes files of one format into a folder; gathers those written, and the results left out."""

    folder: Path
    format: str
    may_replace: bool
    decimal: str = "."
    paths: list[Path] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)

    def write(self, name: str, content: str | bytes | xr.Dataset) -> None:
        """Write a file, unless one of that name is there and may not be replaced."""
        path = self.folder / name
        if path.exists() and not self.may_replace:
            raise UsageError(f"{path} exists already; use --force to replace it, or another --out")
        if isinstance(content, str):
            files.write_text(path, content)
        elif isinstance(content, bytes):
            files.write_bytes(path, content)
        else:
            files.write_dataset(path, content)
        self.paths.append(path)

    def write_dataset(self, name: str, dataset: xr.Dataset, remarks: dict[str, str]) -> None:
        """Write one Dataset, as csv in one file per set of dimensions."""
        from pipelines.session import _export_formats as formats

        if self.format == "csv":
            for part, text in formats.csv_tables(dataset, remarks, self.decimal).items():
                self.write(f"{name}.{part}.csv", text)
        else:
            made: Any = {"nc": formats.cf_dataset, "mat": formats.mat_bytes, "json": formats.json_text}
            self.write(f"{name}.{self.format}", made[self.format](dataset, remarks))


def export(
    source: str | Path,
    format: str = "csv",  # noqa: A002
    *,
    only: Iterable[str] | None = None,
    stages: Iterable[str] = (),
    out: str | Path | None = None,
    replace: bool = False,
    reading: dict[str, Any] | None = None,
    bulk: str | None = None,
    decimal: str = ".",
) -> Exported:
    """Write stored results, or one raw file, for programs that read no netCDF.

    Parameters
    ----------
    source : path-like
        A session folder, or a file (or folder of images) of a known instrument.
    format : {"csv", "nc", "mat", "json", "xlsx", "tex", "abaqus", "ansys", "comsol", "lsdyna"}
        Csv has one table per set of dimensions, with a row of units. Of a session, ``xlsx`` and ``tex`` are one table
        with a row for each quantity (value, u, model, deviation, verdict), which csv has in addition to the curves.
        Simulation codes get the materials of the session; json has them with the results, for any other code.
    only, stages : str or iterable of str, optional
        Experiments and steps of a session; all by default.
    out : path-like, optional
        Folder; default ``SESSION/labpipe/export``, or the current one for a raw file.
    replace : bool
        Replace files of the same name; in the default folder of a session they always are.
    reading : dict, optional
        Options of the reader of a raw file, such as ``{"cycle": "50 us"}``.
    bulk : {"constant", "relaxing", "incompressible"}, optional
        Bulk modulus of a material while its shear modulus relaxes; by default Poisson's ratio is
        constant, and at ν = 0.5 the material incompressible.
    decimal : {".", ","}
        Decimal sign of csv; with a comma, semicolons separate the columns, as a German Excel reads them.

    Returns
    -------
    Exported
        The files, and the results that were left out because they are not up to date.

    Examples
    --------
    >>> export("my-session", "mat", only="acrylic_7mm", stages="bounces")  # doctest: +SKIP
    """
    place = Path(source)
    if format not in FORMATS:
        raise UsageError(f'unknown format "{format}"; expected one of {", ".join(FORMATS)}')
    if decimal not in (".", ",") or (decimal == "," and format != "csv"):
        raise UsageError(f'decimal is "." or, of csv alone, ","; found "{decimal}" with {format}')
    is_unknown = place.is_dir() and instrument_of(place) is None  # it should have been a session
    if not (place / FILE_NAME).is_file() and not is_unknown:
        writer = Writer(Path(out or "."), format, replace, decimal)
        _export_file(place, writer, dict(reading or {}))
        return Exported(tuple(writer.paths), ())
    if reading:
        raise UsageError("options of a raw file (cycle, units) do not go with a session folder")
    session = reopen_session(place)
    writer = Writer(Path(out) if out else session.folder / FOLDER, format, replace or out is None, decimal)
    # one name is a list of one, not of its letters
    names, experiments = ((given,) if isinstance(given, str) else tuple(given) for given in (stages, only or ()))
    results = Results(make_plan(session, STAGES, names or None, experiments or None, keep=None))
    parts = _PARTS[format]
    if parts == ("table",) and names:
        raise UsageError(f"{format} is one table of all steps; leave out --stage, or take csv, nc, mat or json")
    if "materials" in parts and not ("results" in parts and names):
        _export_materials(results, experiments, writer, bulk)
        if "results" not in parts and not writer.paths:
            reasons = "; ".join(writer.left_out) or "no experiment makes one, as a master curve does"
            raise InputError(f"{place}: there is no material to write: {reasons}")
    if "results" in parts:
        writer.left_out.clear()  # those of the results say more
        export_results(results, names, experiments, writer)
    if "table" in parts and not names:
        export_table(results, experiments, writer)
        writer.paths.insert(0, writer.paths.pop())
    return Exported(tuple(writer.paths), tuple(writer.left_out))


def _export_file(path: Path, writer: Writer, options: dict[str, Any]) -> None:
    """Write the readings of one raw instrument file; of a film, time, exposure and state of every frame."""
    import numpy as np
    import xarray as xr

    import instruments
    from labpipe.workflow.provenance import program

    if "results" not in _PARTS[writer.format]:
        word = "is a table" if "table" in _PARTS[writer.format] else "writes the materials"
        message = f"{writer.format} {word} of a whole session, and {path} is a file; expected csv, nc, mat or json"
        raise UsageError(message)
    frames: Any = instruments.read(path, **options)
    dataset = frames
    if not isinstance(frames, xr.Dataset):
        exposure = np.nan if frames.exposure is None else frames.exposure
        variables: dict[str, Any] = {
            "time": variable("frame", frames.time, "s", "time from the trigger"),
            "valid": variable("frame", frames.valid.astype(np.int8), "1", "1 where the frame is complete"),
            "exposure": variable("frame", np.broadcast_to(exposure, frames.time.shape), "s", "exposure time"),
        }
        dataset = xr.Dataset(variables, attrs=dict(zip(("rows", "columns"), frames.shape[1:], strict=True)))
    reader = options.get("instrument") or instruments.identify(path, fps=options.get("fps"))
    origin = {"file": path.name, "sha256": files.digest(path), "reader": reader, "program": program()}
    writer.write_dataset(path.stem, dataset, {"source": path.name, "provenance": json.dumps(origin, sort_keys=True)})


def export_results(results: Results, stages: Sequence[str], experiments: Sequence[str], writer: Writer) -> None:
    """Write the stored results of a session that are up to date, of some stages and experiments or of all."""
    import numpy as np

    from labpipe.judging import FLAGS

    plan, session = results.plan, results.plan.session
    rows = [r for r in plan.rows if plan.tasks[r.task].stage.output == "dataset"]
    rows = [r for r in rows if r.stage in (stages or (r.stage,)) and r.experiment in (experiments or (r.experiment,))]
    writer.left_out += [f"{row.task}: {row.reason}" for row in rows if row.state not in READY]
    ready = [row for row in rows if row.state in READY]
    if not ready:
        raise InputError(
            f"{session.root}: none of {len(rows)} wanted results is there and up to date; "
            f"run: labpipe process {session.root}"
        )
    verdicts = stored_verdicts(opened(results.plan.session.root))
    for row in ready:
        dataset = results.result(*row.task)
        excluded = "; ".join(map(str, exclusions(session.experiments[row.experiment].settings)))
        remarks: dict[str, Any] = {"experiment": row.experiment, "stage": row.stage, "recording": row.recording}
        remarks |= {"title": session.title, "synthetic": _SYNTHETIC * session.synthetic, "excluded": excluded}
        remarks = {key: text for key, text in remarks.items() if text}
        remarks["provenance"] = str(dataset.attrs.get("provenance", ""))
        if writer.format == "nc":
            # the verdict as a flag of the CF conventions, with QARTOD's numbers
            word = verdicts[row.experiment].believable if row.experiment in verdicts else "unknown"
            values = np.array(list(FLAGS.values()), np.int8)
            attrs = {"standard_name": "quality_flag", "flag_values": values, "flag_meanings": " ".join(FLAGS)}
            about = described("1", "whether the record can be believed", **attrs)
            dataset = dataset.assign(quality_flag=((), np.int8(FLAGS[word]), about))
        parts = [row.experiment, row.stage]
        if row.recording is not None:
            parts.append(re.sub(r"[^\w.-]+", "_", Path(row.recording).with_suffix("").as_posix()))
        writer.write_dataset(".".join(parts), dataset, remarks)


def export_table(results: Results, experiments: Sequence[str], writer: Writer) -> None:
    """Write one table of the quantities of some experiments, or of all, as ``xlsx``, ``tex`` or ``csv``."""
    from labpipe.workflow.provenance import program
    from pipelines.session import _export_formats as formats

    session = results.plan.session
    rows = formats.rows_of(results, experiments)
    if not rows:
        raise InputError(f"{session.root}: no quantity is there and up to date; run: labpipe process {session.root}")
    named = {row.experiment for row in rows}
    absent = [name for name in experiments or session.experiments if name not in named]
    writer.left_out = writer.left_out or [f"{name}: no quantity is up to date" for name in absent]
    remarks = {"title": session.title} | ({"synthetic": _SYNTHETIC} if session.synthetic else {})
    remarks |= {"units": "SI; u is a standard uncertainty (k = 1)", "program": json.dumps(program(), sort_keys=True)}
    for name in sorted(named):
        settings = session.experiments[name].settings
        notes = [f"{one.on} {one.who}: {one.text}" for one in getattr(settings, "notes", ())]
        for title, texts in (("excluded", list(map(str, exclusions(settings)))), ("notes", notes)):
            remarks |= {f"{name}, {title}": "; ".join(texts)} if texts else {}
    table = formats.frame(results, rows)
    name, content = f"quantities.{writer.format}", formats.csv_text(table, remarks, decimal=writer.decimal)
    content = formats.tex_text(rows, table, remarks) if writer.format == "tex" else content
    writer.write(name, formats.xlsx_bytes(table, remarks) if writer.format == "xlsx" else content)


def _export_materials(results: Results, experiments: Sequence[str], writer: Writer, bulk: str | None) -> None:
    """Write the materials of some experiments, or of all, for the simulation code that is the writer's format.

    The warnings in the files are given too.
    """
    from labpipe import materials

    session = results.plan.session
    states = {f"{row.task.experiment}/{row.stage}": row for row in results.plan.rows}
    for name in experiments or session.experiments:
        experiment = session.experiments[name]
        if (hook := KINDS[experiment.kind].material) is None:
            writer.left_out += [f"{name}: it makes no material"] if experiments else []
            continue
        waiting = [states[key] for key in needed(session, experiment, hook) if states[key].state not in READY]
        writer.left_out += [f"{row.task}: {row.reason}" for row in waiting]
        if waiting:
            continue
        deck = derive(results, experiment, hook, name=name, bulk=bulk)
        for text in deck.warnings:
            warnings.warn(f"{name}: {text}", stacklevel=3)
        writer.write(f"{name}.material{materials.CODES[writer.format]}", materials.deck_text(deck, writer.format))
