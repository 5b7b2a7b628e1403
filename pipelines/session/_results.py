"""A session from its folder, opened and checked, and its results."""

from __future__ import annotations

import inspect
from collections.abc import Iterable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from labpipe.errors import InputError, SourceError, UsageError
from labpipe.workflow import session as sessions
from labpipe.workflow.graph import arguments
from labpipe.workflow.plan import READY, page_name, plan as make_plan
from labpipe.workflow.results import Results
from labpipe.workflow.session import Experiment, Session
from pipelines.experiments import KINDS, Derived, function
from pipelines.session._stated import fill

if TYPE_CHECKING:
    import xarray as xr

SETTINGS = {name: kind.settings for name, kind in KINDS.items()}
STAGES = {name: kind.stages for name, kind in KINDS.items()}
SCHEMAS = {schema.name: schema for kind in KINDS.values() for schema in kind.schemas}
load = partial(sessions.load, kinds=SETTINGS, fill=fill)
"""Read a session.toml with our kinds, and the values that it takes from a workbook."""


def open_session(folder: str | Path, *, is_processed: bool = False) -> Session:
    """Read and check the ``session.toml`` of a folder; ConfigError lists every mistake with its line.

    In an experiment that was never processed a file that is not there is a mistake; with ``is_processed`` one that has
    a page may lack files: they have been lost, and the experiment fails and says so.
    """
    folder = Path(folder)
    path = folder / sessions.FILE_NAME
    if not path.is_file():
        raise SourceError(path, "there is no such file", hint=f"Write one with `labpipe init {folder}`.")
    pages = {page.stem for page in (folder / "labpipe").glob(page_name("*"))} if is_processed else ()
    return load(path, may_lack=pages)


reopen_session = partial(open_session, is_processed=True)
"""Open a session as :func:`open_session`, but let experiments that have a page lack files."""


def opened(folder: str | Path, only: Iterable[str] | None = None) -> Results:
    """Return the results of a session, or of some of its experiments, as they are now."""
    return Results(make_plan(reopen_session(folder), STAGES, only=only, keep=None))


def needed(session: Session, experiment: Experiment, derived: Derived) -> list[str]:
    """Return the targets behind a derived value, such as ``"acrylic/model"``; others' too."""
    found = arguments(session, STAGES, experiment, derived.inputs)
    return list(dict.fromkeys(f"{t.experiment}/{t.stage}" for a in found for t in a.tasks))


def derive(results: Results, experiment: Experiment, derived: Derived, **keywords: Any) -> Any:
    """Return a value that a kind derives from its results; the call gets those keywords that it takes."""
    found = arguments(results.plan.session, STAGES, experiment, derived.inputs)
    call = function(derived.function)
    taken = inspect.signature(call).parameters
    given = {name: value for name, value in {"settings": experiment.settings, **keywords}.items() if name in taken}
    return call(*results.values(found), **given)


def key_numbers(results: Results, name: str) -> dict[str, tuple[float, float | None, str]]:
    """Return value, standard uncertainty and SI unit of each key number of an experiment that is up to date."""
    found = {}
    for number in KINDS[results.experiments[name].kind].key_numbers:
        dataset = results.first(name, number.stage)
        if dataset is not None and (own := number.within(dataset)) is not None:
            found[own[0]] = (*own[1:], number.unit)
    return found


def result(folder: str | Path, experiment: str, stage: str | None = None, recording: str | None = None) -> xr.Dataset:
    """Return one stored result of a processed session.

    Parameters
    ----------
    folder : path-like
        The session folder.
    experiment, stage, recording : str
        Names, for example ``"acrylic_1p5mm"`` and ``"bounces"``; the file, for stages that run once per recording.

    Returns
    -------
    Dataset
        In SI; ``u_x`` is the standard uncertainty of ``x``.

    Examples
    --------
    >>> result("my-session", "acrylic_7mm", "repeats")["restitution"]  # doctest: +SKIP
    """
    session = reopen_session(folder)
    if stage is None and experiment in session.experiments:
        stages = STAGES[session.experiments[experiment].kind]
        known = ", ".join(one.name for one in stages if one.output == "dataset")
        raise UsageError(f"name a stage of {experiment}: {known}; results({str(folder)!r}, {experiment!r}) has all")
    made = make_plan(session, STAGES, [f"{experiment}/{stage or ''}"], [experiment], keep=None)
    return Results(made).result(experiment, stage or "", recording)


def results(folder: str | Path, experiment: str | None = None) -> xr.DataTree:
    """Return all results of an experiment, or of a whole session, that are up to date, as one tree.

    Parameters
    ----------
    folder : path-like
        The session folder.
    experiment : str, optional
        Its name; by default all, each a node.

    Returns
    -------
    DataTree
        One node per stage; below it one per recording, by the stem of the file (its whole name where two share it).

    Examples
    --------
    >>> results("my-session", "acrylic_7mm")["repeats"]  # doctest: +SKIP
    """
    import xarray as xr

    known = opened(folder, None if experiment is None else [experiment])
    found: dict[str, xr.Dataset] = {}
    for row in known.plan.rows:
        is_wanted = experiment in (None, row.experiment) and row.state in READY
        if is_wanted and known.plan.tasks[row.task].stage.output == "dataset":
            node = f"/{row.stage}" if experiment is not None else f"/{row.experiment}/{row.stage}"
            if row.recording is not None:
                stem = Path(row.recording).stem
                is_taken = f"{node}/{stem}" in found
                node += f"/{row.recording.replace('/', '_') if is_taken else stem}"
            found[node] = known.result(*row.task)
    if not found:
        only = "" if experiment is None else f" --only {experiment}"
        raise InputError(
            f"{experiment or 'the session'} has no result that is up to date; run: labpipe process {folder}{only}"
        )
    return xr.DataTree.from_dict(found, name=experiment)
