"""The verb sensitivity: budgets of the main quantities, and the inputs to measure better.

The quantities are formulas of their inputs (:attr:`pipelines.experiments.Kind.budget`), propagated
linearly, by Monte Carlo and by Sobol indices (:mod:`labpipe.uncertainty`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import isinf
from pathlib import Path
from typing import Any

import pandas as pd

from labpipe import files
from labpipe.errors import UsageError
from labpipe.notebook import Shown, ShownAsTable
from labpipe.report import Block, Column, Paragraph, Section, Table, shown_source, value_with_uncertainty
from labpipe.uncertainty import (
    Budget,
    Indices,
    MonteCarlo,
    inputs_to_halve,
    intervals_agree,
    linear_budget,
    monte_carlo,
    sobol,
)
from pipelines.experiments import KINDS
from pipelines.experiments.shared import budget_blocks
from pipelines.experiments.shared.budget_quantity import Quantity
from pipelines.experiments.shared.pages import session_document, synthetic_notice
from pipelines.session._processing import processed_for
from pipelines.session._results import derive, reopen_session

_SAME = 0.05  # of the variance: shares that differ by less are equal


@dataclass(frozen=True, eq=False)
class Examined:
    """A quantity of an experiment with its linear budget, Monte Carlo draws and, by input, Sobol's indices."""

    experiment: str
    quantity: Quantity
    budget: Budget
    drawn: MonteCarlo
    indices: dict[str, Indices]

    @property
    def shares(self) -> dict[str, float]:
        """Sobol's total indices, scaled to a sum of one."""
        total = sum(i.total for i in self.indices.values()) or 1.0
        return {name: i.total / total for name, i in self.indices.items()}

    @property
    def advice(self) -> str:
        """The inputs to measure better to halve the uncertainty."""
        return _reduction(self.shares) if self.budget.u else "no input is uncertain"


@dataclass(frozen=True, eq=False, repr=False)
class Sensitivity(ShownAsTable):
    """The examined quantities of a session, and a page for each kind of experiment."""

    quantities: tuple[Examined, ...]
    pages: tuple[Path, ...]

    def __iter__(self) -> Iterator[Examined]:
        return iter(self.quantities)

    def _shown(self) -> Shown:
        caption = f"{len(self.quantities)} quantities; pages: {', '.join(map(str, self.pages))}"
        budgets = [(e, e.budget) for e in self.quantities]
        values = [value_with_uncertainty(budget.value, budget.u, e.quantity.unit) for e, budget in budgets]
        rows = [(e.experiment, e.quantity.name, v, e.advice) for (e, _), v in zip(budgets, values, strict=True)]
        return Shown(caption, ("experiment", "quantity", "value", "to halve the uncertainty"), rows)

    def documents(self) -> list[dict[str, Any]]:
        """Return plain values of every quantity, for JSON."""
        return [
            {
                "experiment": e.experiment, "quantity": e.quantity.name, "unit": e.quantity.unit,
                "value": e.budget.value, "u": e.budget.u, "expanded": e.budget.expanded(),
                "coverage_factor": budget_blocks.coverage_factor(e.budget),
                "monte_carlo_agrees": intervals_agree(e.budget, e.drawn),
                "total_indices": {name: i.total for name, i in e.indices.items()},
                "to_halve": e.advice,
            }
            for e in self.quantities
        ]  # fmt: skip


def sensitivity(folder: str | Path, which: str | None = None) -> Sensitivity:
    """Show which inputs limit the uncertainty of the main quantities of a session.

    Parameters
    ----------
    folder : path-like
        The session folder; missing results are processed first.
    which : str, optional
        Only experiments of this kind, or of this name.

    Returns
    -------
    Sensitivity
        Linear budget, Monte Carlo and Sobol indices of every quantity, and the pages
        ``FOLDER/labpipe/sensitivity_KIND.html``.

    Examples
    --------
    >>> sensitivity("my-session", "acrylic_7mm")  # doctest: +SKIP
    """
    session = reopen_session(folder)
    budgets = {name: kind.budget for name, kind in KINDS.items() if kind.budget is not None}
    able = (e for e in session.experiments.values() if e.kind in budgets)
    chosen = [e for e in able if which == e.name or (which in (None, e.kind) and not e.base)]
    if not chosen:
        known = ", ".join(budgets)
        raise UsageError(f'nothing to examine for "{which or "this session"}"; kinds with budgets: {known}')
    results = processed_for(folder, [(e, budgets[e.kind]) for e in chosen])
    found = [examined(e.name, quantity) for e in chosen for quantity in derive(results, e, budgets[e.kind])]
    pages = []
    for kind in dict.fromkeys(e.kind for e in chosen):
        own = [e for e in found if session.experiments[e.experiment].kind == kind]
        sections = [Section("What to measure better", (*answer(own), *synthetic_notice(session)))]
        for name in dict.fromkeys(e.experiment for e in own):
            of_name = [e for e in own if e.experiment == name]
            propagated = [(e.quantity, e.budget, e.drawn) for e in of_name]
            table = budget_blocks.overview(propagated, "to halve the uncertainty", [e.advice for e in of_name])
            sections.append(Section(name, (table,)))
        pages.append(session.folder / f"sensitivity_{kind}.html")
        title = f"Uncertainty and sensitivity: {KINDS[kind].title}"
        files.write_text(pages[-1], session_document(session, title, sections))
    return Sensitivity(tuple(found), tuple(pages))


def examined(experiment: str, quantity: Quantity) -> Examined:
    """Propagate one quantity in all three ways."""
    model, inputs = quantity.model, quantity.inputs
    return Examined(
        experiment, quantity, linear_budget(model, inputs), monte_carlo(model, inputs), sobol(model, inputs)
    )


def _reduction(shares: dict[str, float]) -> str:
    """Say by how much the uncertainty of which inputs, of these shares of the variance, has to fall to halve it."""
    names, factor = inputs_to_halve(shares)
    *others, last = map(shown_source, names)
    text = f"{', '.join(others)} and {last}" if others else last
    size = "to nothing" if isinf(factor) else f"{factor:.2g} times"
    return f"reduce the uncertainty of {text} {size}"


def answer(found: Sequence[Examined]) -> tuple[Block, ...]:
    """List the limits of quantities of one sense, in all experiments and impacts, and the inputs to know better.

    The shares of the inputs are means over the results. Below, whether linear shares and Sobol indices agree.
    """
    uncertain = [e for e in found if e.budget.u > 0.0]
    if not uncertain:
        return (Paragraph("Nothing is uncertain."),)
    groups: dict[str, list[Examined]] = {}
    for each in uncertain:
        groups.setdefault(each.quantity.family, []).append(each)
    rows = []
    for name, group in groups.items():
        shares = pd.DataFrame([e.shares for e in group]).fillna(0.0).mean().sort_values(ascending=False)
        mean = {str(name): float(share) for name, share in shares.items()}
        shown = (f"{shown_source(n)} {100.0 * share:.0f} %" for n, share in list(mean.items())[:3] if share >= 0.01)
        widths = sorted((e.budget for e in group), key=lambda budget: budget.expanded())
        ends = dict.fromkeys(budget_blocks.half_width(widths[i], group[0].quantity.unit) for i in (0, -1))
        rows.append((name, len(group), " to ".join(ends), ", ".join(shown), _reduction(mean)))
    titles = ("quantity", "results", "expanded uncertainty, 95 %", "limiting inputs, mean share of the variance")
    table = Table(tuple(map(Column, (*titles, "to halve it"))), rows, sortable=False)
    gaps = {e: max(abs(r["share"] - e.shares.get(r["source"], 0.0)) for r in e.budget.rows) for e in uncertain}
    apart = [f"{e.experiment}, {e.quantity.name} ({100 * gap:.0f} %)" for e, gap in gaps.items() if gap > _SAME]
    text = f"agree within {100.0 * max(gaps.values()):.1g} % of the variance."
    if apart:
        text = "differ where the result is nonlinear within the uncertainty of an input"
        text += f": {', '.join(apart)}. Use Sobol's there."
    return table, Paragraph(f"Linear shares of the variance and Sobol's total indices (which are shown) {text}")
