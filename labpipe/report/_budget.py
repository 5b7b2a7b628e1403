"""An uncertainty budget on a page: a table, and bars of the shares."""

from collections.abc import Mapping, Sequence
from typing import Any

from labpipe.report._blocks import Bars, Block
from labpipe.report._tables import Column, Table, quantity


def budget_table(
    rows: Sequence[Mapping[str, Any]], caption: str, unit: str, columns: Mapping[str, Mapping[str, Any]] | None = None
) -> tuple[Block, ...]:
    """Show the rows of a budget as a table, and their shares of the variance as bars; nothing without a row.

    ``rows``: as :func:`labpipe.uncertainty.budget_rows` makes them; ``unit``: SI unit of the result; ``columns``:
    further cells by column and source.
    """
    if not rows:
        return ()
    kinds = {"kind": {r["source"]: r["kind"] for r in rows}} if any(r["kind"] for r in rows) else {}
    more = kinds | dict(columns or {})
    cells = [
        (
            shown_source(r["source"]),
            quantity(r["value"], r["unit"], 5) if r["value"] else "0",
            quantity(r["u"], difference_unit(r["unit"]), 2) if r["u"] else "0",
            r["sensitivity"],
            r["contribution"],
            *(values.get(r["source"]) for values in more.values()),
        )
        for r in rows
    ]
    sensitivity = Column("sensitivity, SI", digits=3)
    contribution = Column("contribution", unit=difference_unit(unit), digits=2)
    names = map(Column, ("source", "value", "standard uncertainty"))
    heads = (*names, sensitivity, contribution, *map(Column, more))
    return Table(heads, cells, caption=caption, sortable=False), share_bars(rows)


def share_bars(rows: Sequence[Mapping[str, Any]], title: str = "Share of the variance") -> Bars:
    """Draw the share of every row of a budget in the variance."""
    return Bars(title, [(shown_source(r["source"]), r["share"], "") for r in rows])


def difference_unit(unit: str) -> str:
    """Return the unit in which two values of a unit differ: kelvin for degrees Celsius."""
    return "K" if unit == "degC" else unit


def shown_source(source: str) -> str:
    """Return the name of an input for a reader: the quantity, and in brackets its owner."""
    text = source if " " in source else source.replace("_", " ")
    what, _, of = text.partition(", ")  # behind it may stand the name of an experiment, as it is
    what = what.replace("_", " ")
    return f"{what} ({of})" if of else what
