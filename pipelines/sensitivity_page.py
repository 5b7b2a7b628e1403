"""The page of budgets and sensitivities of one kind of experiment; its blocks fit other pages."""

from collections.abc import Sequence
from math import isinf

from labpipe.propagation import to_halve
from labpipe.report import (
    Block,
    Column,
    Document,
    Paragraph,
    Section,
    Table,
    quantity,
    value_with_uncertainty,
)
from labpipe.workflow.session import Session
from pipelines import budget_blocks as budget_drawing
from pipelines.overview import PAGE
from pipelines.pages import SYNTHETIC, synthetic_notice
from pipelines.sensitivity import Examined

_BEST = 20.0  # factor beyond which "better" means "exactly"


def render(session: Session, kind: str, found: Sequence[Examined]) -> str:
    """Return the page of one kind as HTML text.

    Parameters
    ----------
    session : Session
    kind : str
        Of the experiments.
    found : sequence of Examined
        Their quantities.
    """
    head: tuple[Block, ...] = (synthetic_notice(),) if session.synthetic else ()
    sections = [Section("Summary", (*head, *summary(found)))]
    sections += [
        Section(f"{e.experiment}: {e.quantity.name}", budget_blocks(e)) for e in found
    ]  # fmt: skip
    return Document(
        title=f"Uncertainty and sensitivity: {kind}",
        subtitle=session.title,
        badge=SYNTHETIC if session.synthetic else "",
        home=PAGE,
        sections=tuple(sections),
    ).render()


def advice(found: Examined) -> str:
    """Say what to measure better to halve the uncertainty."""
    if found.budget.u == 0.0:
        return "no input is uncertain"
    shares = {name: i.total for name, i in found.indices.items()}
    total = sum(shares.values()) or 1.0
    names, factor = to_halve({name: share / total for name, share in shares.items()})
    text = " and ".join(n.replace("_", " ") for n in names)
    if isinf(factor) or factor > _BEST:
        return f"know {text} exactly"
    return f"know {text} {factor:.2g} times better"


def summary(found: Sequence[Examined]) -> tuple[Block, ...]:
    """Return all quantities as one table."""
    rows = [
        (
            e.experiment, e.quantity.name,
            value_with_uncertainty(e.budget.value, e.budget.u, e.quantity.unit),
            quantity(e.budget.expanded(), e.quantity.unit), e.coverage_factor,
            "agree" if e.is_linear else "differ: take the drawn interval", advice(e),
        )
        for e in found
    ]  # fmt: skip
    table = Table(
        (
            Column("experiment"), Column("quantity"), Column("value"),
            Column("expanded uncertainty, 95 %"), Column("coverage factor", digits=3),
            Column("linear and Monte Carlo"), Column("to halve the uncertainty"),
        ),
        rows,
    )  # fmt: skip
    return (table,)


def budget_blocks(found: Examined) -> tuple[Block, ...]:
    """Return budget, bars, and how linear, Monte Carlo and Sobol compare, for any page."""
    columns = {
        "Sobol, alone": {name: i.first for name, i in found.indices.items()},
        "Sobol, in all": {name: i.total for name, i in found.indices.items()},
    }
    shown = budget_drawing.blocks(found.quantity, found.budget, found.drawn, columns)
    return *shown, Paragraph(f"To halve the uncertainty: {advice(found)}.")
