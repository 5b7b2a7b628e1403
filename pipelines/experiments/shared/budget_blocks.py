"""Uncertainty budgets as blocks of a page: on reports and on the sensitivity page."""

from collections.abc import Iterable, Sequence
from math import isfinite

from labpipe.report import (
    Column,
    Details,
    Section,
    Table,
    budget_table,
    difference_unit,
    display_unit,
    number,
    quantity,
    shown_source,
    value_with_uncertainty,
)
from labpipe.uncertainty import Budget, MonteCarlo, intervals_agree, linear_budget, monte_carlo
from pipelines.experiments.shared.budget_quantity import Quantity

Propagated = tuple[Quantity, Budget, MonteCarlo]


def budgets(quantities: Iterable[Quantity], experiment: str) -> Section:
    """Show the budgets of the main quantities of an experiment: one line each, and each folded away.

    Those without a finite value are left out; without any the section is empty.
    """
    linear = ((each, linear_budget(each.model, each.inputs)) for each in quantities)
    known = [(each, budget) for each, budget in linear if isfinite(budget.value) and isfinite(budget.u)]
    # so many draws give the ends of an interval to 5 % of u
    found = [(each, budget, monte_carlo(each.model, each.inputs, draws=2000)) for each, budget in known]
    shares = [f"{shown_source(b.rows[0]['source'])}, {100.0 * b.rows[0]['share']:.0f} %" for _, b in known]
    caption = "After the GUM; repeats are type A with Student's quantile. To see which input to measure better: "
    caption += f"labpipe sensitivity SESSION {experiment}."
    if any("mode_" in name for each, _ in known for name in each.inputs):
        caption += " Modes of a DMA are independent combinations of the errors of its spectrum, each of size 1."
    lines = overview(found, "largest source", shares, caption)
    tables = [(each, [row for row in budget.rows if row["u"] > 0.0]) for each, budget in known]
    folded = [Details(each.name, budget_table(rows, each.name, each.unit)) for each, rows in tables]
    return Section("Uncertainty budgets", [lines, *folded] if known else [])


def overview(found: Sequence[Propagated], last: str, texts: Sequence[str], caption: str = "") -> Table:
    """Return one line for each quantity, which ends with a text under a heading of its own.

    The linear interval agrees with that of Monte Carlo, or the latter is given and is then the one to use. Few repeats
    make the linear one too narrow, as effective degrees of freedom only approximate Student's distribution of one
    input; else the result is not linear within the uncertainty.
    """
    rows = []
    for (each, budget, drawn), text in zip(found, texts, strict=True):
        why, checked = "few repeats" if isfinite(budget.degrees_of_freedom) else "not linear", "agree"
        if not intervals_agree(budget, drawn):
            unit = difference_unit(each.unit)
            low, high = (quantity(end - budget.value, unit, 2) for end in (drawn.low, drawn.high))
            checked = f"differ ({why}): {low} to {high} about the value by Monte Carlo"
        value, half = value_with_uncertainty(budget.value, budget.u, each.unit), half_width(budget, each.unit)
        freedom = number(budget.degrees_of_freedom, 3)
        rows.append((each.name, value, half, coverage_factor(budget), freedom, checked, text))
    names, k = map(Column, ("quantity", "value", "expanded uncertainty, 95 %")), Column("coverage factor", digits=3)
    columns = (*names, k, *map(Column, ("degrees of freedom", "linear and Monte Carlo", last)))
    return Table(columns, rows, caption=caption, sortable=False)


def half_width(budget: Budget, unit: str) -> str:
    """Write the expanded uncertainty, for 95 %, in the unit of its value; of a temperature it is a difference."""
    half = budget.expanded()
    shown = display_unit([max(abs(budget.value), half)], difference_unit(unit))
    return f"{number(half / shown.factor, 2)} {shown.text}".rstrip()


def coverage_factor(budget: Budget) -> float:
    """Return expanded over standard uncertainty, for 95 %; not a number without uncertainty."""
    return budget.expanded() / budget.u if budget.u else float("nan")
