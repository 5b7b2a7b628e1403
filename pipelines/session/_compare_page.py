"""The page of all comparisons of a session."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from labpipe.judging import LIKELY
from labpipe.report import (
    SURE,
    Block,
    Column,
    Details,
    Deviations,
    DisplayUnit,
    KeyValues,
    Notice,
    Paragraph,
    Section,
    Table,
    display_unit,
)
from labpipe.workflow.session import Session
from pipelines.experiments.shared.comparison_rows import Row
from pipelines.experiments.shared.judgements import probability
from pipelines.experiments.shared.pages import session_document, synthetic_notice
from pipelines.session._comparison import Comparison, SideBySide, comparison_text
from pipelines.session._verdict_notices import agreement

GOOD = 0.03
"""nRMSE that is called good: the aim for data made with the right material."""

_REASONS = 5  # why more models differ stands on their own pages

_TIED = "\N{NO-BREAK SPACE}"  # a number stays with its unit


def render(session: Session, found: Comparison) -> str:
    """Return the page as HTML text."""
    once = replace(
        found,
        rows=tuple(row for row in found.rows if row.experiment not in session.variants),
        experiments=tuple(one for one in found.experiments if one["experiment"] not in session.variants),
    )
    variants = [Section(f"{one.name}, variant of {one.base}", beside_base(one)) for one in found.variants]
    sections = [Section("Answer", (*_summary(once), *synthetic_notice(session))), *variants, *parts(once)]
    return session_document(session, "Measurement against model", sections)


def beside_base(one: SideBySide) -> tuple[Block, ...]:
    """Show a variant next to its base: the settings that differ, and every comparison of both."""
    settings = [(name, *values) for name, values in one.changed.items()]
    blocks: list[Block] = [Table(tuple(map(Column, ("setting", one.base, one.name))), settings)]
    rows = [(what(old), comparison_text(old), comparison_text(new)) for old, new in one.rows]
    if rows:
        caption = "Measured against expected; what the settings do not touch is equal on both sides."
        blocks.append(Table(tuple(map(Column, ("quantity", one.base, one.name))), rows, caption=caption))
    return tuple(blocks)


def parts(found: Comparison) -> list[Section]:
    """Return the charts and tables of a comparison."""
    curves = [row for row in found.rows if row.is_curve]
    # The largest deviation is read first; a value without uncertainty cannot be judged and comes last.
    events = sorted((row for row in found.rows if not row.is_curve), key=lambda row: -abs(row.deviation or 0.0))
    answer = [Section("Deviations", _deviations(found.rows)), Section("Experiments", _experiments(found))]
    return [*answer, Section("Values", _events(events)), Section("Curves", _curves(curves))]


def _summary(found: Comparison) -> tuple[Block, ...]:
    """Say in how many experiments the model agrees, and how many comparisons that rests on."""
    curves, blocks = [row for row in found.rows if row.is_curve], list[Block]()
    said = agreement({document["experiment"]: document["model"] for document in found.experiments})
    blocks += [said] if said else []
    reasons = [reason for document in found.experiments if (reason := _reason(document))]
    blocks += reasons[:_REASONS]
    if len(reasons) > _REASONS:
        blocks.append(Paragraph(f"{len(reasons) - _REASONS} more say on their own pages why they may differ."))
    rows = []
    known = [row.deviation for row in found.rows if not row.is_curve and row.deviation is not None]
    if known:
        inside = sum(1 for d in known if abs(d) < SURE)
        rows.append(("values", f"{inside} of {len(known)}", "differ by less than the 95 % interval of the difference"))
    if curves:
        good = sum(1 for row in curves if row.nrmse is not None and row.nrmse < GOOD)
        rows.append(("curves", f"{good} of {len(curves)}", f"with an nRMSE below {100 * GOOD:g} %"))
        p = [row.p for row in curves if row.p is not None]
        likely = sum(1 for one in p if one > LIKELY)
        rows += [("", f"{likely} of {len(p)}", f"with p above {LIKELY:g} along the curve")] if p else []
    blocks += [KeyValues(rows)] if rows else []
    blocks += [Notice("error", f"{name}: {why}") for name, why in found.failed.items()]
    if kept := {row.experiment: row.kept for row in found.rows if row.kept}:
        n = len(kept)
        table = KeyValues([(name, ", ".join(stages), "") for name, stages in kept.items()])
        text = f"{n} experiment{'s' * (n != 1)} with results that earlier code made and that were kept."
        blocks += [Notice("warning", text), Details("Results of earlier code", blocks=(table,))]
    for why in dict.fromkeys(found.absent.values()):
        names = ", ".join(name for name, text in found.absent.items() if text == why)
        blocks.append(Notice("info", f"{names}: {why}"))
    return tuple(blocks)


def _reason(document: Mapping[str, Any]) -> Notice | None:
    """Say why a model may differ: a record that cannot be believed first, else what inputs would explain it."""
    name, believable = document["experiment"], document["believable"]
    if believable in ("doubtful", "impossible"):
        cause = f": {document['cause']}" if document["cause"] else ""
        return Notice(
            "error" if believable == "impossible" else "warning", f"{name}: the record is {believable}{cause}."
        )
    return Notice("warning", f"{name}: {'; '.join(document['suspects'])}.") if document["suspects"] else None


def _experiments(found: Comparison) -> tuple[Block, ...]:
    """One line for each experiment that is judged as a whole, the largest deviation first."""
    if not found.experiments:
        return ()
    largest, chi_square = Column("largest deviation", "u", digits=2), Column("chi square", digits=3)
    names = (Column("experiment"), Column("model"))
    columns = (*names, largest, Column("of"), chi_square, Column("degrees of freedom", digits=2), Column("p"))
    body: list[tuple[Any, ...]] = []
    for document in found.experiments:
        own = [r for r in found.rows if r.experiment == document["experiment"] and r.deviation is not None]
        worst = max(own, key=lambda row: abs(row.deviation or 0.0), default=None)
        most = (worst.deviation, worst.quantity) if worst is not None else (None, "")
        freedom = document["degrees_of_freedom"] or None
        p = None if document["p"] is None else probability(document["p"])
        chi2 = document["chi2"] if freedom else None
        body.append((document["experiment"], document["model"], *most, chi2, freedom, p))
    body.sort(key=lambda cells: -abs(cells[2] or 0.0))
    return (Table(columns, body),)


def _deviations(rows: Sequence[Row]) -> tuple[Block, ...]:
    points: dict[str, list[tuple[float, str]]] = {}
    for row in rows:
        if row.deviation is not None:
            points.setdefault(what(row), []).append((row.deviation, f"{row.experiment}, {row.condition}".rstrip(", ")))
    if not points:
        return ()
    caption = (
        "Each mark is one experiment, in standard uncertainties of its difference, measured minus model; the shaded "
        "band holds 95 % of them when model and uncertainties are right. Filled diamonds lie outside, "
        "triangles at the edge farther out."
    )
    return (Deviations("Difference over its uncertainty", list(points.items()), caption),)


def _curves(rows: Sequence[Row]) -> tuple[Block, ...]:
    if not rows:
        return ()
    names, nrmse = map(Column, ("experiment", "of", "curve")), Column("nRMSE", "%", digits=2)
    judged = (Column("chi square", digits=3), Column("degrees of freedom", digits=2), Column("p", digits=2))
    columns = (*names, nrmse, Column("bias", digits=3, u=5), *map(Column, ("u", "in", "n")), *judged)
    body = []
    for r in sorted(rows, key=lambda row: -(row.nrmse or 0.0)):
        shown = display_unit(_known(r.difference), r.unit)
        bias = _scaled((r.difference, r.u_difference), shown)
        of_curve = (r.chi2, r.degrees_of_freedom, r.p)
        body.append((r.experiment, _of(r), what(r), 100 * (r.nrmse or 0.0), *bias, shown.text, r.n, *of_curve))
    text = (
        "Root mean square of measured minus model over the range of the model, and its mean. "
        "The bias has an uncertainty where the scale of the calibration contributes to it; n "
        "counts repeats, or the points of a single curve. Chi square lays the curve against the model in a "
        "few stretches, with what they share; p is the probability of a larger one."
    )
    return Paragraph(text), Table(columns, body)


def _events(rows: Sequence[Row]) -> tuple[Block, ...]:
    if not rows:
        return ()
    deviation, names = Column("deviation", "u", digits=2), map(Column, ("quantity", "experiment", "of"))
    sides = (Column("measured", u=5), Column("u"), Column("model", u=7), Column("u"))
    columns = (deviation, *names, *sides, Column("in"), Column("n"))
    body = []
    for r in rows:
        shown = display_unit(_known(r.measured, r.model), r.unit)
        values = _scaled((r.measured, r.u_measured, r.model, r.u_model), shown)
        body.append((r.deviation, what(r), r.experiment, _of(r), *values, shown.text, r.n))
    text = (
        "The largest deviation first: measured minus model in units of the difference's standard uncertainty. The "
        "uncertainty of the model includes that of every input that is stated with one, and of the DMA from which a "
        "material is taken; a material of the library or of a file counts as exact. A difference of many u means "
        "that one of the inputs, or the material, is wrong."
    )
    return Paragraph(text), Table(columns, body)


def _of(row: Row) -> str:
    """Material and condition in one cell, so that the table fits a page."""
    parts = [*row.material.split(", "), *row.condition.split(", ")]
    return ", ".join(part.replace(" ", _TIED) for part in parts if part)


def what(row: Row) -> str:
    """Name what a row compares, and with what where that is no model."""
    return row.quantity if row.against == "model" else f"{row.quantity} ({row.against})"


def _known(*values: float | None) -> list[float]:
    return [value for value in values if value is not None]


def _scaled(values: Sequence[float | None], shown: DisplayUnit) -> list[float | None]:
    """Numbers of one row in the unit that suits this row: metres and newtons share a column."""
    return [None if value is None else value / shown.factor for value in values]
