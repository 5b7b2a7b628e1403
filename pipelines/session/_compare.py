"""The verb compare: measurement against model over all experiments of a session.

The comparisons of an experiment are in its own results; here the rows of all kinds are collected.
A curve gives its normalised root-mean-square error and bias, an event (a restitution, a largest
radius, the work of a cycle) its two values and their difference with its uncertainty.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from labpipe import files
from pipelines.experiments import JUDGEMENT, KINDS
from pipelines.experiments.shared.comparison_rows import Row
from pipelines.experiments.shared.judgements import compared
from pipelines.session._compare_page import render
from pipelines.session._comparison import Comparison, labelled, side_by_side
from pipelines.session._overview import COMPARISON_PAGE, write_overview
from pipelines.session._processing import process
from pipelines.session._results import STAGES, derive, needed, opened, reopen_session
from pipelines.session._verdicts import stored_verdicts

if TYPE_CHECKING:
    from labpipe.workflow.results import Event


def compare(
    folder: str | Path, *, jobs: int = 1, keep: bool | None = None, progress: Callable[[Event], None] | None = None
) -> Comparison:
    """Compare measurement and model of every experiment of a session, on one page.

    Missing results are processed first. The page is ``FOLDER/labpipe/compare.html``.

    Parameters
    ----------
    folder : path-like
        The session folder.
    jobs : int
        Experiments processed side by side.
    keep : bool or None
        Take results of earlier code as they are; by default those that an earlier run took.
    progress : callable, optional
        Called with every event of the processing.

    Returns
    -------
    Comparison
        Rows with the measured and the simulated value of each quantity, and the page.

    Raises
    ------
    ConfigError, SourceError
        The session cannot be opened.

    Examples
    --------
    >>> for row in compare("my-session").rows:  # doctest: +SKIP
    ...     print(row.experiment, row.quantity, row.measured, row.model)
    """
    session = reopen_session(folder)
    able = {n: made for n, e in session.experiments.items() if (made := KINDS[e.kind].rows) is not None}
    judged = [n for n in able if any(s.name == JUDGEMENT for s in KINDS[session.experiments[n].kind].stages)]
    wanted = [target for name, made in able.items() for target in needed(session, session.experiments[name], made)]
    wanted += [f"{name}/{JUDGEMENT}" for name in judged]
    failed: dict[str, str] = {}
    if wanted:
        names = {target.split("/")[0] for target in wanted}
        run = process(folder, wanted, names, jobs=jobs, keep=keep, progress=progress)
        for outcome in run.failures:
            name = outcome.task.experiment
            failed.setdefault(name, f"{str(outcome.task).removeprefix(f'{name}/')}: {outcome.message}")
    results = opened(folder)
    verdicts = stored_verdicts(results)
    for name in failed:
        if name in verdicts and (cause := verdicts[name].cause):
            failed[name] += f". Likely: {cause}"
    rows: list[Row] = []
    absent: dict[str, str] = {}
    for name, experiment in session.experiments.items():
        if name in failed:
            continue
        if name not in able:
            absent[name] = f"the kind {experiment.kind} holds no comparison with a model"
            continue
        own = [labelled(row, experiment, session) for row in derive(results, experiment, able[name])]
        tasks = [task for task in results.plan.tasks if task.experiment == name]
        kept = tuple(dict.fromkeys(f"{n.experiment}/{n.stage}" for n in results.plan.kept(*tasks)))
        rows += [replace(row, kept=kept) for row in own]
        if not own:
            absent[name] = "it has no model: session.toml names nothing to simulate"
    whole = [
        {"believable": verdicts[name].believable, "cause": verdicts[name].cause, "experiment": name}
        | compared(results.result(name, JUDGEMENT))
        for name in judged
        if name not in failed
    ]
    page = session.folder / COMPARISON_PAGE
    variants = tuple(side_by_side(session, one.base, name, rows) for name, one in session.variants.items())
    found = Comparison(tuple(rows), failed, absent, page, tuple(whole), variants)
    files.write_text(found.page, render(session, found))
    write_overview(session, STAGES)
    return found
