"""Results and raw files for other programs: which ones, under which names, in which format."""

from __future__ import annotations

import json
import re
import warnings
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from labpipe import files
from labpipe.errors import InputError, SourceError, UsageError
from labpipe.notebook import Shown, ShownAsTable
from labpipe.variables import described, variable
from labpipe.workflow import session as sessions
from labpipe.workflow.plan import READY, plan as make_plan
from labpipe.workflow.results import Results
from pipelines.session._verdicts import Verdict, told_verdicts

if TYPE_CHECKING:
    import xarray as xr

    from labpipe.workflow.plan import Row

Format = str
TABLES = ("xlsx", "tex")
"""One table of the whole session."""
CODES = ("abaqus", "ansys", "comsol", "lsdyna", "json")
"""Materials as input of simulation codes; json has the results of all steps beside them."""
FORMATS = ("csv", "nc", "mat", "json", *TABLES, *CODES[:-1])
FOLDER = "export"
"""Below ``SESSION/labpipe``: files in it may be replaced."""


@dataclass(frozen=True, slots=True, repr=False)
class Exported(ShownAsTable):
    """What an export wrote, and which results it left out, each with the reason."""

    paths: tuple[Path, ...]
    left_out: tuple[str, ...]

    def _shown(self) -> Shown:
        folders = dict.fromkeys(path.parent.name for path in self.paths)
        rows = [("written", path.name) for path in self.paths] + [("left out", line) for line in self.left_out]
        return Shown(f"{len(self.paths)} files in {', '.join(folders)}", ("", ""), rows)


@dataclass(frozen=True, slots=True)
class Target:
    """Where files go, in which format, and whether those of the same name are replaced."""

    folder: Path
    format: Format
    may_replace: bool

    def __post_init__(self) -> None:
        """Refuse a format that nobody writes."""
        if self.format not in FORMATS:
            raise UsageError(f'unknown format "{self.format}"; expected one of {", ".join(FORMATS)}')

    def write(self, name: str, dataset: xr.Dataset, remarks: dict[str, str]) -> list[Path]:
        """Write one Dataset under a name; return the files.

        Raises
        ------
        UsageError
            A file of that name is there and may not be replaced.
        """
        from pipelines.session import _export_formats as formats

        if self.format == "nc":
            path = self.free(f"{name}.nc")
            files.write_dataset(path, dataset.assign_attrs({**dataset.attrs, **remarks}))
            return [path]
        if self.format == "mat":
            path = self.free(f"{name}.mat")
            files.write_bytes(path, formats.mat_bytes(dataset, remarks))
            return [path]
        if self.format == "json":
            path = self.free(f"{name}.json")
            files.write_text(path, formats.json_text(dataset, remarks))
            return [path]
        tables = formats.csv_tables(dataset, remarks)
        paths = [self.free(f"{name}.{part}.csv") for part in tables]
        for path, text in zip(paths, tables.values(), strict=True):
            files.write_text(path, text)
        return paths

    def free(self, name: str) -> Path:
        """Return the path of a file that may be written.

        Raises
        ------
        UsageError
            A file of that name is there and may not be replaced.
        """
        path = self.folder / name
        if path.exists() and not self.may_replace:
            raise UsageError(f"{path} exists already; use --force to replace it, or another --out")
        return path


def export_results(results: Results, stages: Iterable[str], experiments: Iterable[str], target: Target) -> Exported:
    """Write the stored results of a session that are up to date, of some stages and experiments or of all.

    Raises
    ------
    InputError
        There is nothing to export.
    """
    plan = results.plan
    steps, names = set(stages), set(experiments)
    rows = [r for r in plan.rows if plan.tasks[r.task].stage.output == "dataset"]
    rows = [r for r in rows if (not steps or r.stage in steps) and (not names or r.experiment in names)]
    left_out = tuple(f"{row.task}: {row.reason}" for row in rows if row.state not in READY)
    ready = [row for row in rows if row.state in READY]
    if not ready:
        raise InputError(
            f"{plan.session.root}: none of {len(rows)} wanted results is there and up to date; "
            f"run: labpipe process {plan.session.root}"
        )
    paths: list[Path] = []
    verdicts = told_verdicts(results.folder)
    for row in ready:
        dataset = results.result(*row.task)
        remarks = {"experiment": row.experiment, "stage": row.stage}
        remarks |= {"recording": row.recording} if row.recording else {}
        remarks["title"] = plan.session.title
        if plan.session.synthetic:
            remarks["synthetic"] = "yes: made by a virtual rig, not measured"
        remarks["provenance"] = str(dataset.attrs.get("provenance", ""))
        if target.format == "nc":
            dataset = dataset.assign(quality_flag=_flag(verdicts.get(row.experiment)))
        paths += target.write(_name(row), dataset, remarks)
    return Exported(tuple(paths), left_out)


def _flag(verdict: Verdict | None) -> xr.Variable:
    """Return the verdict on an experiment as a flag of the CF conventions, with QARTOD's numbers.

    Unknown where the experiment was not judged, or not with what is there now.
    """
    import numpy as np
    import xarray as xr

    from labpipe.judging import FLAGS

    word = "unknown" if verdict is None else verdict.believable
    attrs = {
        "long_name": "whether the record can be believed",
        "standard_name": "quality_flag",
        "units": "1",
        "flag_values": np.array(list(FLAGS.values()), np.int8),
        "flag_meanings": " ".join(FLAGS),
    }
    return xr.Variable((), np.int8(FLAGS[word]), attrs)


def export_table(results: Results, experiments: Iterable[str], target: Target) -> Exported:
    """Write one table of the quantities of some experiments, or of all, as ``xlsx``, ``tex`` or ``csv``.

    Raises
    ------
    InputError
        No quantity is up to date.
    """
    from labpipe.workflow.provenance import program
    from pipelines.session import _summary_table as summary

    session = results.plan.session
    found = summary.lines(results, experiments)
    if not found:
        raise InputError(f"{session.root}: no quantity is there and up to date; run: labpipe process {session.root}")
    named = {line.row.experiment for line in found}
    wanted = set(experiments) or set(session.experiments)
    left_out = [f"{name}: no quantity is up to date" for name in session.experiments if name in wanted - named]
    remarks = {"title": session.title}
    if session.synthetic:
        remarks["synthetic"] = "yes: made by a virtual rig, not measured"
    remarks |= {"units": "SI; u is a standard uncertainty (k = 1)", "program": json.dumps(program(), sort_keys=True)}
    path = target.free(f"quantities.{target.format}")
    if target.format == "xlsx":
        files.write_bytes(path, summary.xlsx_bytes(results, found, remarks))
    else:
        files.write_text(path, (summary.tex_text if target.format == "tex" else summary.csv_text)(found, remarks))
    return Exported((path,), tuple(left_out))


def export_materials(
    results: Results, experiments: Iterable[str], target: Target, bulk: str | None
) -> tuple[Exported, tuple[str, ...]]:
    """Write the materials of some experiments, or of all, for the simulation code that the target names as its format.

    Returns the files, and the warnings that stand in them.
    """
    from labpipe import materials
    from pipelines.experiments import KINDS
    from pipelines.session._results import derive, needed

    session = results.plan.session
    states = {str(row.task.experiment) + "/" + row.stage: row for row in results.plan.rows}
    names = set(experiments)
    paths, left_out, warned = [], [], []
    for experiment in session.experiments.values():
        hook = KINDS[experiment.kind].material
        if names and experiment.name not in names:
            continue
        if hook is None:
            left_out += [f"{experiment.name}: it makes no material"] if names else []
            continue
        waiting = [states[key] for key in needed(session, experiment, hook) if states[key].state not in READY]
        if waiting:
            left_out += [f"{row.task}: {row.reason}" for row in waiting]
            continue
        deck = derive(results, experiment, hook, name=experiment.name, bulk=bulk)
        warned += [f"{experiment.name}: {text}" for text in deck.warnings]
        path = target.free(f"{experiment.name}.material{materials.CODES[target.format]}")
        files.write_text(path, materials.deck_text(deck, target.format))
        paths.append(path)
    return Exported(tuple(paths), tuple(left_out)), tuple(warned)


def _name(row: Row) -> str:
    parts = [row.experiment, row.stage]
    if row.recording is not None:
        parts.append(re.sub(r"[^\w.-]+", "_", Path(row.recording).with_suffix("").as_posix()))
    return ".".join(parts)


def export_file(path: Path, target: Target, options: dict[str, Any]) -> Exported:
    """Write the readings of one raw instrument file; of a film, the times of its frames.

    Raises
    ------
    SourceError
        The file is not known or cannot be read.
    UsageError
        The target lies where the raw file is.
    """
    import xarray as xr

    import instruments
    from labpipe.workflow.provenance import program

    source = instruments.read(path, **options)
    dataset = source if isinstance(source, xr.Dataset) else _frame_times(source)
    reader = options.get("instrument") or instruments.identify(path, fps=options.get("fps"))
    origin = {"file": path.name, "sha256": files.digest(path), "reader": reader, "program": program()}
    remarks = {"source": path.name, "provenance": json.dumps(origin, sort_keys=True)}
    return Exported(tuple(target.write(path.stem, dataset, remarks)), ())


def _frame_times(frames: Any) -> xr.Dataset:
    """Return what a film says beside its pixels: time, exposure and state of every frame."""
    import numpy as np
    import xarray as xr

    variables: dict[str, Any] = {
        "time": variable("frame", frames.time, "s", "time from the trigger"),
        "valid": variable("frame", frames.valid.astype(np.int8), "1", "1 where the frame is complete"),
    }
    if frames.exposure is not None:
        attrs = described("s", "exposure time")
        values = np.broadcast_to(np.asarray(frames.exposure, float), frames.time.shape)
        variables["exposure"] = ("frame", values, attrs)
    rows, columns = frames.shape[1:]
    return xr.Dataset(variables, attrs={"rows": int(rows), "columns": int(columns)})


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
) -> Exported:
    """Write stored results, or one raw file, for programs that read no netCDF.

    Parameters
    ----------
    source : path-like
        A session folder, or a file (or folder of images) of a known instrument.
    format : {"csv", "nc", "mat", "json", "xlsx", "tex", "abaqus", "ansys", "comsol", "lsdyna"}
        Of the files; csv has one table per set of dimensions, with a row of units. Of a session,
        ``xlsx`` and ``tex`` are one table with a row for each quantity (value, u, model, deviation,
        verdict), which csv has beside the others; ``xlsx`` has the curves on further sheets. The
        names of simulation codes write the materials of the session as their input; json has them
        beside the results, for any other code.
    only, stages : str or iterable of str, optional
        Experiments and steps of a session; all by default.
    out : path-like, optional
        Folder; default ``SESSION/labpipe/export``, or the current one for a raw file.
    replace : bool
        Replace files of the same name; in the default folder of a session they always are.
    reading : dict, optional
        What a raw file leaves unsaid, such as ``{"cycle": "50 us"}``.
    bulk : {"constant", "relaxing", "incompressible"}, optional
        What the bulk modulus of a material does while its shear modulus relaxes; by default
        Poisson's ratio is constant, and at ν = 0.5 the material incompressible.

    Returns
    -------
    Exported
        The files, and the results that were left out because they are not up to date.

    Raises
    ------
    InputError
        No wanted result is up to date.
    UsageError
        A name is unknown, or a file is there and may not be replaced.

    Examples
    --------
    >>> export("my-session", "mat", only="acrylic_7mm", stages="bounces")  # doctest: +SKIP
    """
    from pipelines.session._opening import STAGES, reopen_session

    place = Path(source)
    if not (place / sessions.FILE_NAME).is_file() and not _is_unknown_folder(place):
        options = dict(reading or {})
        if format in (*TABLES, *CODES[:-1]):
            what = "is a table" if format in TABLES else "writes the materials"
            message = f"{format} {what} of a whole session, and {place} is a file; expected csv, nc, mat or json"
            raise UsageError(message)
        return export_file(place, Target(Path(out or "."), format, replace), options)
    if reading:
        raise UsageError("options of a raw file (cycle, units) do not go with a session folder")
    session = reopen_session(place)
    ours = session.folder / FOLDER
    target = Target(Path(out) if out else ours, format, replace or out is None)
    names, experiments = _names(stages), _names(only or ())
    made = make_plan(session, STAGES, names or None, experiments or None, keep=None)
    if format in TABLES:
        if names:
            raise UsageError(f"{format} is one table of all steps; leave out --stage, or take csv, nc, mat or json")
        return export_table(Results(made), experiments, target)
    if format in CODES and not names:
        written, warned = export_materials(Results(made), experiments, target, bulk)
        for text in warned:
            warnings.warn(text, stacklevel=2)
        if format != "json" and not written.paths:
            reasons = "; ".join(written.left_out) or "no experiment makes one, as a master curve does"
            raise InputError(f"{place}: there is no material to write: {reasons}")
        if format != "json":
            return written
        done = export_results(Results(made), names, experiments, target)
        return Exported((*written.paths, *done.paths), done.left_out)
    done = export_results(Results(made), names, experiments, target)
    if format != "csv" or names:
        return done
    table = export_table(Results(made), experiments, target)
    return Exported((*table.paths, *done.paths), done.left_out)


def _names(given: str | Iterable[str]) -> tuple[str, ...]:
    """Take one name for a list of one, not for its letters."""
    return (given,) if isinstance(given, str) else tuple(given)


def _is_unknown_folder(place: Path) -> bool:
    """Tell a folder that should have been a session from one that holds a film."""
    import instruments

    if not place.is_dir():
        return False
    try:
        instruments.identify(place)
    except SourceError:
        return True
    return False
