"""The page of all comparisons of a session."""

from collections.abc import Sequence

from labpipe.report import (
    Bars,
    Block,
    Column,
    DisplayUnit,
    Document,
    KeyValues,
    Notice,
    Paragraph,
    Section,
    Table,
    display_unit,
)
from labpipe.workflow.session import Session
from pipelines.experiments.shared.comparison_rows import Row
from pipelines.experiments.shared.pages import SYNTHETIC, synthetic_notice
from pipelines.session._comparison import Comparison
from pipelines.session._overview import PAGE

GOOD = 0.03
"""nRMSE that is called good: the aim for data made with the right material."""

_TIED = "\N{NO-BREAK SPACE}"  # a number stays with its unit
_SURE = 1.96  # standard uncertainties within which 95 % of the differences lie


def render(session: Session, found: Comparison) -> str:
    """Return the page as HTML text.

    Parameters
    ----------
    session : Session
    found : Comparison
    """
    curves = [row for row in found.rows if row.is_curve]
    events = [row for row in found.rows if not row.is_curve]
    head: tuple[Block, ...] = (synthetic_notice(),) if session.synthetic else ()
    sections = [
        Section("Summary", (*head, *summary(curves, events, found))),
        Section("Curves", _curves(curves)),
        Section("Events", _events(events)),
    ]
    return Document(
        title="Measurement against model",
        subtitle=session.title,
        badge=SYNTHETIC if session.synthetic else "",
        home=PAGE,
        sections=tuple(section for section in sections if section.blocks),
    ).render()


def summary(curves: Sequence[Row], events: Sequence[Row], found: Comparison) -> tuple[Block, ...]:
    """Say how many comparisons there are and how many are good."""
    rows = []
    if curves:
        good = sum(1 for row in curves if row.nrmse is not None and row.nrmse < GOOD)
        rows.append(("curves", f"{good} of {len(curves)}", f"with an nRMSE below {GOOD:.0%}"))
    known = [row.deviation for row in events if row.deviation is not None]
    if known:
        inside = sum(1 for d in known if abs(d) < _SURE)
        rows.append(("events", f"{inside} of {len(known)}", "differ by less than the 95 % interval of the difference"))
    blocks: list[Block] = [KeyValues(rows)] if rows else []
    blocks += [Notice("error", f"{name}: {why}") for name, why in found.failed.items()]
    kept = {row.experiment: row.kept for row in found.rows if row.kept}
    for name, stages in kept.items():
        text = f"{name}: of results that earlier code made and that were kept: {', '.join(stages)}"
        blocks.append(Notice("warning", text))
    for why in dict.fromkeys(found.absent.values()):
        names = ", ".join(name for name, text in found.absent.items() if text == why)
        blocks.append(Notice("info", f"{names}: {why}"))
    return tuple(blocks)


def _curves(rows: Sequence[Row]) -> tuple[Block, ...]:
    if not rows:
        return ()
    worst: dict[str, float] = {}
    for row in rows:
        worst[row.experiment] = max(worst.get(row.experiment, 0.0), row.nrmse or 0.0)
    largest = max(worst.values()) or 1.0
    columns = (
        Column("experiment"),
        Column("kind"),
        Column("of"),
        Column("curve"),
        Column("n"),
        Column("nRMSE", "%", digits=2),
        Column("bias", digits=3, u=7),
        Column("u"),
        Column("in"),
    )
    body = []
    for r in rows:
        shown = display_unit(_known(r.difference), r.unit)
        body.append(
            (
                r.experiment,
                r.kind,
                _of(r),
                _what(r),
                r.n,
                100 * (r.nrmse or 0.0),
                *_scaled((r.difference, r.u_difference), shown),
                shown.text,
            )
        )
    text = (
        "Root mean square of measured minus model over the range of the measurement, and its mean. "
        "The bias has an uncertainty where the scale of the calibration contributes to it; n "
        "counts "
        "repeats, or the points of a single curve."
    )
    bars = Bars(
        "Largest nRMSE of each experiment, the worst as the full bar",
        [(name, value / largest, f"{value * 100:.2f} %") for name, value in worst.items()],
    )
    return Paragraph(text), bars, Table(columns, body)


def _events(rows: Sequence[Row]) -> tuple[Block, ...]:
    if not rows:
        return ()
    columns = (
        Column("experiment"),
        Column("of"),
        Column("quantity"),
        Column("n"),
        Column("measured", u=5),
        Column("u"),
        Column("model", u=7),
        Column("u"),
        Column("difference", u=9),
        Column("u"),
        Column("in"),
        Column("over u", digits=2),
    )
    body = []
    for r in rows:
        shown = display_unit(_known(r.measured, r.model), r.unit)
        values = (r.measured, r.u_measured, r.model, r.u_model, r.difference, r.u_difference)
        body.append((r.experiment, _of(r), _what(r), r.n, *_scaled(values, shown), shown.text, r.deviation))
    text = (
        "Single values with standard uncertainties. The uncertainty of the model includes "
        "height, radius, mass and plate, not the material: a difference of many u means that one "
        "of the stated inputs, or the material, is wrong. The last column is the difference in "
        "units of its uncertainty."
    )
    return Paragraph(text), Table(columns, body)


def _of(row: Row) -> str:
    """Material and condition in one cell, so that the table fits a page."""
    parts = [*row.material.split(", "), *row.condition.split(", ")]
    return ", ".join(part.replace(" ", _TIED) for part in parts if part)


def _what(row: Row) -> str:
    return row.quantity if row.against == "model" else f"{row.quantity} ({row.against})"


def _known(*values: float | None) -> list[float]:
    return [value for value in values if value is not None]


def _scaled(values: Sequence[float | None], shown: DisplayUnit) -> list[float | None]:
    """Numbers of one row in the unit that suits this row: metres and newtons share a column."""
    return [None if value is None else value / shown.factor for value in values]
