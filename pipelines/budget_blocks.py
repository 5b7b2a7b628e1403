"""How budgets are drawn, on the page of an experiment and on that of the sensitivities."""

from collections.abc import Iterable, Mapping
from math import isfinite, isinf
from typing import Any

from labpipe.propagation import MonteCarlo, agrees, linear, monte_carlo
from labpipe.report import (
    Block,
    Column,
    Details,
    Paragraph,
    Section,
    Table,
    quantity,
    value_with_uncertainty,
)
from labpipe.uncertainty import Budget
from pipelines import pages
from pipelines.experiments.budgets import Quantity

_DRAWS = 2000  # on the page of an experiment: the ends of an interval to 5 % of u


def section(experiment: str, quantities: Iterable[Quantity]) -> tuple[Section, ...]:
    """Return the budgets of an experiment's main quantities, one line each and each folded away.

    Parameters
    ----------
    experiment : str
        Its name.
    quantities : iterable of Quantity
        Those without a finite value are left out.

    Returns
    -------
    tuple of Section
        Empty when there is nothing to show.
    """
    rows, folded = [], []
    for each in quantities:
        budget = linear(each.model, each.inputs)
        if not (isfinite(budget.value) and isfinite(budget.u)):
            continue
        drawn = monte_carlo(each.model, each.inputs, draws=_DRAWS)
        largest = budget.rows[0]
        rows.append((
            each.name, value_with_uncertainty(budget.value, budget.u, each.unit),
            quantity(budget.expanded(), each.unit), coverage_factor(budget),
            _number(budget.degrees_of_freedom), "agree" if agrees(budget, drawn) else "differ",
            f"{largest['source'].replace('_', ' ')}, {100.0 * largest['share']:.0f} %",
        ))  # fmt: skip
        folded.append(Details(each.name, blocks=blocks(each, budget, drawn)))
    if not rows:
        return ()
    table = Table(
        (
            Column("quantity"), Column("value"), Column("expanded uncertainty, 95 %"),
            Column("coverage factor", digits=3), Column("degrees of freedom"),
            Column("linear and Monte Carlo"), Column("largest source"),
        ),
        rows, sortable=False,
        caption="After the GUM; repeats count as type A with Student's quantile. Which input "
        f"should be measured better: labpipe sensitivity SESSION {experiment}.",
    )  # fmt: skip
    return (Section("Uncertainty budgets", (table, *folded)),)


def blocks(
    found: Quantity,
    budget: Budget,
    drawn: MonteCarlo,
    columns: Mapping[str, Mapping[str, Any]] | None = None,
) -> tuple[Block, ...]:
    """Return one budget as text, table and bars.

    Parameters
    ----------
    found : Quantity
    budget : Budget
    drawn : MonteCarlo
    columns : mapping of str to mapping of str to float, optional
        Further columns by title and source.
    """
    more = {"degrees of freedom": {n: _number(g.degrees_of_freedom)
                                   for n, g in found.inputs.items()}}  # fmt: skip
    more |= {title: dict(values) for title, values in (columns or {}).items()}
    rows = [
        dict(row) | {"source": row["source"].replace("_", " ")}
        | {title: values.get(row["source"]) for title, values in more.items()}
        for row in budget.rows
    ]  # fmt: skip
    half, unit = budget.expanded(), found.unit
    ends = [
        f"{quantity(low, unit, 5)} to {quantity(high, unit, 5)}"
        for low, high in ((budget.value - half, budget.value + half), (drawn.low, drawn.high))
    ]
    text = (
        f"{value_with_uncertainty(budget.value, budget.u, unit)}; expanded uncertainty "
        f"{quantity(half, unit)} with k = {coverage_factor(budget):.3g} "
        f"({_number(budget.degrees_of_freedom)} degrees of freedom), 95 %. "
        f"Linear: {ends[0]}; Monte Carlo: {ends[1]}: they "
        f"{'agree' if agrees(budget, drawn) else 'differ'}."
    )
    return Paragraph(text), *pages.budget_table(rows, found.name, unit)


def coverage_factor(budget: Budget) -> float:
    """Return expanded over standard uncertainty, for 95 %; not a number without uncertainty."""
    return budget.expanded() / budget.u if budget.u else float("nan")


def _number(freedom: float) -> str:
    return "∞" if isinf(freedom) else f"{freedom:.3g}"
