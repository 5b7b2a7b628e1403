"""Results of a processed session: one, all of an experiment, or values derived from them."""

from __future__ import annotations

import inspect
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from labpipe.errors import InputError, UsageError
from labpipe.workflow.plan import READY, plan as make_plan
from labpipe.workflow.results import Results, open_result
from labpipe.workflow.session import Experiment, Session
from labpipe.workflow.tasks import arguments
from pipelines.experiments import Derived, function
from pipelines.session._opening import STAGES, reopen_session

if TYPE_CHECKING:
    import xarray as xr


def opened(folder: str | Path, only: Iterable[str] | None = None) -> Results:
    """Return the results of a session, or of some of its experiments, as they are now."""
    return Results(make_plan(reopen_session(folder), STAGES, only=only, keep=None))


def needed(session: Session, experiment: Experiment, derived: Derived) -> list[str]:
    """Return the targets behind what is derived, such as ``"acrylic/model"``; others' too."""
    found = arguments(session, STAGES, experiment, derived.inputs)
    return list(dict.fromkeys(f"{t.experiment}/{t.stage}" for a in found for t in a.tasks))


def derive(results: Results, experiment: Experiment, derived: Derived, **keywords: Any) -> Any:
    """Call what a kind derives from its results, with those keywords that it takes."""
    found = arguments(results.plan.session, STAGES, experiment, derived.inputs)
    call = function(derived.function)
    taken = inspect.signature(call).parameters
    given = {name: value for name, value in {"settings": experiment.settings, **keywords}.items() if name in taken}
    return call(*results.values(found), **given)


def result(folder: str | Path, experiment: str, stage: str | None = None, recording: str | None = None) -> xr.Dataset:
    """Return one stored result of a processed session.

    Parameters
    ----------
    folder : path-like
        The session folder.
    experiment, stage : str
        Names, for example ``"acrylic_1p5mm"`` and ``"bounces"``.
    recording : str, optional
        The file, for stages that run once per recording.

    Returns
    -------
    Dataset
        In SI; ``u_x`` is the standard uncertainty of ``x``.

    Raises
    ------
    UsageError
        There is no such experiment or stage, or no stage was named; the message names the nearest, or all.
    InputError
        The result is missing or out of date, or there is one for each recording: the message
        names them.

    Examples
    --------
    >>> result("my-session", "acrylic_7mm", "repeats")["restitution"]  # doctest: +SKIP
    """
    session = reopen_session(folder)
    if stage is None and experiment in session.experiments:
        stages = STAGES[session.experiments[experiment].kind]
        known = ", ".join(one.name for one in stages if one.output == "dataset")
        raise UsageError(f"name a stage of {experiment}: {known}; results({str(folder)!r}, {experiment!r}) has all")
    return open_result(session, STAGES, experiment, stage or "", recording)


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
        One node per stage; below it one per recording for stages that run per recording, by the
        stem of the file (by its whole name where two have the same).

    Raises
    ------
    InputError
        There is none.
    UsageError
        There is no such experiment.

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
