"""Uncertainty budgets as blocks of a page: on reports and on the sensitivity page."""

from collections.abc import Iterable, Mapping, Sequence
from math import ceil, isfinite, isinf, log10
from typing import Any

from labpipe.report import (
    Block,
    Column,
    Details,
    Paragraph,
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
from labpipe.uncertainty import Budget, MonteCarlo, interval_difference, intervals_agree, linear_budget, monte_carlo
from pipelines.experiments.shared.budget_quantity import MEASURED, Quantity

_MANY = 1000.0  # degrees of freedom: beyond, Student's law is the normal one
_DRAWS = 2000  # on the page of an experiment: the ends of an interval to 5 % of u

Propagated = tuple[Quantity, Budget, MonteCarlo]


def section(experiment: str, quantities: Iterable[Quantity]) -> tuple[Section, ...]:
    """Return the budgets of an experiment's main quantities, one line each and each folded away.

    Those without a finite value are left out; without any there is no section.
    """
    linear = [(each, linear_budget(each.model, each.inputs)) for each in quantities]
    known = [(each, budget) for each, budget in linear if isfinite(budget.value) and isfinite(budget.u)]
    if not known:
        return ()
    found = [(each, budget, monte_carlo(each.model, each.inputs, draws=_DRAWS)) for each, budget in known]
    largest = (budget.rows[0] for _, budget in known)
    caption = "After the GUM; repeats are type A with Student's quantile. To see which input to measure better: "
    caption += f"labpipe sensitivity SESSION {experiment}."
    shares = [f"{shown_source(r['source'])}, {100.0 * r['share']:.0f} %" for r in largest]
    folded = (Details(each[0].name, blocks=blocks(*each)) for each in found)
    return (Section("Uncertainty budgets", (overview(found, "largest source", shares, caption), *folded)),)


def overview(found: Sequence[Propagated], last: str, texts: Sequence[str], caption: str = "") -> Table:
    """Return one line for each quantity, which ends with a text under a heading of its own."""
    rows = [
        (
            each.name,
            value_with_uncertainty(budget.value, budget.u, each.unit),
            half_width(budget, each.unit),
            coverage_factor(budget),
            _number(budget.degrees_of_freedom),
            compared(budget, drawn),
            text,
        )
        for (each, budget, drawn), text in zip(found, texts, strict=True)
    ]
    names, k = map(Column, ("quantity", "value", "expanded uncertainty, 95 %")), Column("coverage factor", digits=3)
    columns = (*names, k, *map(Column, ("degrees of freedom", "linear and Monte Carlo", last)))
    return Table(columns, rows, caption=caption, sortable=False)


def blocks(
    found: Quantity, budget: Budget, drawn: MonteCarlo, columns: Mapping[str, Mapping[str, Any]] | None = None
) -> tuple[Block, ...]:
    """Return one budget as text, table and bars, below a line of :func:`overview`.

    ``columns`` are further ones of the table by title and source.
    """
    half = budget.expanded()
    # two digits of the half width
    digits = 2 + max(ceil(log10(abs(budget.value) / half)), 1) if budget.value and half else 5
    bounds = (budget.value - half, budget.value + half, drawn.low, drawn.high)
    text = "Interval of 95 %, linear: {} to {}; Monte Carlo: {} to {}.".format(
        *(quantity(end, found.unit, digits) for end in bounds)
    )
    rows, more = [row for row in budget.rows if row["u"] > 0.0], dict(columns or {})
    if any(isfinite(g.degrees_of_freedom) for g in found.inputs.values()):
        more = {"degrees of freedom": {n: _number(g.degrees_of_freedom) for n, g in found.inputs.items()}} | more
    exact = [shown_source(n) for n, g in found.inputs.items() if g.u == 0.0 and n != MEASURED]
    others = [Paragraph(f"Without a stated or estimated uncertainty: {', '.join(exact)}.")] if exact else []
    return Paragraph(text), *budget_table(rows, found.name, found.unit, more), *others


def half_width(budget: Budget, unit: str) -> str:
    """Write the expanded uncertainty, for 95 %, in the unit of its value; of a temperature it is a difference."""
    half = budget.expanded()
    shown = display_unit([max(abs(budget.value), half)], difference_unit(unit))
    return f"{number(half / shown.factor, 2)} {shown.text}".rstrip()


def compared(budget: Budget, drawn: MonteCarlo) -> str:
    """Say whether the linear interval agrees with that of Monte Carlo, or by which share of its half width it differs.

    Few repeats make it too narrow, as effective degrees of freedom only approximate Student's distribution of one
    input; else the result is not linear within the uncertainty. Then that of Monte Carlo is the one to use.
    """
    if intervals_agree(budget, drawn):
        return "agree"
    why = "few repeats" if isfinite(budget.degrees_of_freedom) else "not linear"
    return f"differ by {100.0 * interval_difference(budget, drawn) / budget.expanded():.0f} % ({why})"


def coverage_factor(budget: Budget) -> float:
    """Return expanded over standard uncertainty, for 95 %; not a number without uncertainty."""
    return budget.expanded() / budget.u if budget.u else float("nan")


def _number(freedom: float) -> str:
    if freedom >= _MANY:
        return "∞" if isinf(freedom) else f"> {_MANY:.0f}"
    return f"{freedom:.3g}"
