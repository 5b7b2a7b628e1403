"""The verb compare: measurement against model over all experiments of a session.

The comparisons of an experiment are in its own results; here the rows of all kinds are collected.
A curve gives its normalised root-mean-square error and bias, an event (a restitution, a largest
radius, the work of a cycle) its two values and their difference with its uncertainty.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from labpipe import files
from labpipe.errors import LabpipeError
from labpipe.notebook import Shown, ShownAsTable
from labpipe.workflow.fields import REFERENCE
from labpipe.workflow.graph import OTHER
from labpipe.workflow.results import Results
from labpipe.workflow.session import Experiment, Session
from labpipe.workflow.tasks import field_value
from pipelines.experiments import JUDGEMENT, KINDS
from pipelines.experiments.shared import judgements
from pipelines.experiments.shared.comparison_rows import Row
from pipelines.session._overview import COMPARISON_PAGE, write_overview
from pipelines.session._processing import process
from pipelines.session._results import STAGES, derive, needed, opened, reopen_session
from pipelines.session._verdicts import stored_verdicts

if TYPE_CHECKING:
    from labpipe.workflow.run_result import Event


@dataclass(frozen=True, slots=True, repr=False)
class Comparison(ShownAsTable):
    """All rows of a session, and the experiments that failed or compare nothing, with reasons.

    ``page`` is the HTML file. ``experiments`` holds, for each that is judged as a whole, its chi
    square, and the smallest error of each input that it would have shown.
    """

    rows: tuple[Row, ...]
    failed: dict[str, str]
    absent: dict[str, str]
    page: Path
    experiments: tuple[dict[str, Any], ...] = ()

    def _shown(self) -> Shown:
        rows = [(r.experiment, r.condition, r.quantity, comparison_text(r)) for r in self.rows]
        rows += [(name, "", why, "") for name, why in (self.failed | self.absent).items()]
        titles = ("experiment", "condition", "quantity", "measured against model")
        return Shown(f"{len(self.rows)} comparisons, {self.page}", titles, rows)


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
    from pipelines.session._compare_page import render

    session = reopen_session(folder)
    able = {n: made for n, e in session.experiments.items() if (made := KINDS[e.kind].rows) is not None}
    judged = [n for n in able if any(s.name == JUDGEMENT for s in KINDS[session.experiments[n].kind].stages)]
    wanted = [target for name, made in able.items() for target in needed(session, session.experiments[name], made)]
    wanted += [f"{name}/{JUDGEMENT}" for name in judged]
    names = {target.split("/")[0] for target in wanted}
    run = process(folder, wanted, names, jobs=jobs, keep=keep, progress=progress) if wanted else None
    results = opened(folder)
    verdicts = stored_verdicts(results)
    failed: dict[str, str] = {}
    for outcome in run.failures if run else ():
        name = outcome.task.experiment
        likely = verdicts[name].cause if name in verdicts else ""
        cause = f". Likely: {likely}" if likely else ""
        failed.setdefault(name, f"{str(outcome.task).removeprefix(f'{name}/')}: {outcome.message}{cause}")
    rows: list[Row] = []
    absent: dict[str, str] = {}
    for name, experiment in session.experiments.items():
        if name not in able:
            absent[name] = f"the kind {experiment.kind} holds no comparison with a model"
        elif name not in failed:
            tasks = [task for task in results.plan.tasks if task.experiment == name]
            kept = tuple(dict.fromkeys(f"{n.experiment}/{n.stage}" for n in results.plan.kept(*tasks)))
            own = [replace(row, kept=kept) for row in compared(results, name) or []]
            rows += own
            if not own:
                absent[name] = "it has no model: session.toml names nothing to simulate"
    whole = [
        {"believable": verdicts[name].believable, "cause": verdicts[name].cause, "experiment": name}
        | judgements.compared(results.result(name, JUDGEMENT))
        for name in judged
        if name not in failed
    ]
    found = Comparison(tuple(rows), failed, absent, session.folder / COMPARISON_PAGE, tuple(whole))
    files.write_text(found.page, render(session, found))
    write_overview(session, STAGES)
    return found


def sides(row: Row) -> tuple[str, str, str]:
    """Write the measured value of an event, the one that it is compared with, and the unit of both; "" for none."""
    from labpipe.report import display_unit, number, plus_minus

    shown = display_unit([value for value in (row.measured, row.model, row.difference) if value is not None], row.unit)
    texts = [
        "" if value is None else plus_minus(value / shown.factor, u / shown.factor) if u
        else number(value / shown.factor, 5)
        for value, u in ((row.measured, row.u_measured), (row.model, row.u_model))
    ]  # fmt: skip
    return texts[0], texts[1], shown.text


def comparison_text(row: Row) -> str:
    """Write the values of a row: nRMSE and bias of a curve, both sides and the deviation of an event."""
    from labpipe.report import quantity

    if row.nrmse is not None:
        bias = "" if row.difference is None else f", bias {quantity(row.difference, row.unit, 3)}"
        return f"nRMSE {100 * row.nrmse:.2f} %{bias}"
    measured, model, unit = sides(row)
    deviation = "" if row.deviation is None else f", {row.deviation:+z.1f} u"
    return f"{measured} against {model}{unit and f' {unit}'}{deviation}"


def labelled(row: Row, experiment: Experiment, session: Session) -> Row:
    """Return a row with the names of its experiment and kind and, where it has none, its material and condition."""
    body = getattr(experiment.settings, KINDS[experiment.kind].body, None)
    height, temperature = getattr(experiment.settings, "height", None), getattr(body, "temperature", None)
    parts = [] if height is None else [f"{height.value * 1e3:g} mm"]
    parts += [] if temperature is None else [f"{temperature.value:g} °C"]
    material, condition = row.material or _material(experiment, session), row.condition or ", ".join(parts)
    return replace(row, experiment=experiment.name, kind=experiment.kind, material=material, condition=condition)


def compared(results: Results, name: str) -> list[Row] | None:
    """Return the comparisons of an experiment by its results; None where these are not there."""
    session = results.plan.session
    experiment = session.experiments[name]
    derived = KINDS[experiment.kind].rows
    if derived is None:
        return []
    try:
        return [labelled(row, experiment, session) for row in derive(results, experiment, derived)]
    except LabpipeError:
        return None


def _material(experiment: Experiment, session: Session) -> str:
    """Return the material of a body; of a film that names none, that of the drops it is compared with."""
    kind = KINDS[experiment.kind]
    body = getattr(experiment.settings, kind.body, None)
    texts = (getattr(body, n, None) for n in ("material", "material_from", "material_file"))
    if own := next((text.removeprefix(REFERENCE) for text in texts if isinstance(text, str)), ""):
        return own
    inputs = {name.removeprefix(OTHER) for s in kind.stages for name in s.inputs if name.startswith(OTHER)}
    for field in sorted({name.split("/")[0] for name in inputs}):
        named = field_value(experiment.settings, field)
        other = session.experiments.get(named.removeprefix(REFERENCE)) if isinstance(named, str) else None
        if other is not None and other.name != experiment.name and (found := _material(other, session)):
            return found
    return ""
