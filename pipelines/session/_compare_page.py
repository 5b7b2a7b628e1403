"""The pages of comparisons: all of a session, and two experiments side by side."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from labpipe import files
from labpipe.errors import InputError, UsageError
from labpipe.judging import LIKELY
from labpipe.report import (
    SURE,
    Block,
    Column,
    Details,
    Deviations,
    DisplayUnit,
    KeyValues,
    LineChart,
    Link,
    Notice,
    Paragraph,
    Role,
    Section,
    Series,
    Table,
    display_unit,
)
from labpipe.workflow.plan import page_name
from labpipe.workflow.results import Results
from labpipe.workflow.session import Session
from pipelines.experiments import KINDS
from pipelines.experiments.shared.comparison_rows import Row
from pipelines.experiments.shared.judgements import probability
from pipelines.experiments.shared.pages import counted, session_document, synthetic_notice
from pipelines.session._comparison import Comparison, SideBySide, compared, comparison_text, side_by_side
from pipelines.session._overview import AND, BESIDE, PAGE, curve, write_overview
from pipelines.session._results import STAGES, opened
from pipelines.session._verdict_notices import agreement, each
from pipelines.session._verdicts import stored_verdicts

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
    variants = [Section(f"{one.name}, variant of {one.base}", tuple(_pairs(one))) for one in found.variants]
    sections = [Section("Answer", (*_summary(once), *synthetic_notice(session))), *variants, *parts(once)]
    return session_document(session, "Measurement against model", sections)


def beside(folder: str | Path, first: str, second: str) -> Path:
    """Write the page of two experiments side by side, from the results that are there.

    Parameters
    ----------
    folder : path-like
        The session folder.
    first, second : str
        Names of two experiments.

    Returns
    -------
    Path
        ``FOLDER/labpipe/beside-FIRST--SECOND.html``.

    Raises
    ------
    UsageError
        There is no such experiment, or it is one and the same.
    InputError
        One of them has no results that are up to date.

    Examples
    --------
    >>> beside("my-session", "acrylic_7mm", "acrylic_10mm")  # doctest: +SKIP
    """
    results = opened(folder)
    session = results.plan.session
    for name in (first, second):
        if name not in session.experiments:
            raise UsageError(f'there is no experiment "{name}" that is complete')
    if first == second:
        raise UsageError(f'name two experiments; "{first}" was named twice')
    verdicts = stored_verdicts(results)
    rows = {name: compared(results, name) for name in (first, second)}
    for name, own in rows.items():
        if own is None and name not in verdicts:
            raise InputError(f"{name} has no results that are up to date; run: labpipe process {folder} --only {name}")
    pair = next((n for n in ((first, second), (second, first)) if session.experiments[n[1]].base == n[0]), None)
    base, name = pair or (first, second)
    one = side_by_side(session, base, name, [*(rows[base] or []), *(rows[name] or [])])
    said = f"{name} is a variant of {base}: {one.changes}." if pair else _apart(one)
    found = Comparison((*(rows[first] or []), *(rows[second] or [])), {}, {}, session.folder / PAGE)
    against = {r.experiment: r.against for r in sorted(found.rows, key=lambda r: r.against == "model")}
    answer = (*each((first, second), verdicts, against), Notice("info", said), *_curves_of(results, (first, second)))
    links = [Link(n, page_name(n), KINDS[session.experiments[n].kind].title) for n in (first, second)]
    links = [link for link in links if (session.folder / link.href).is_file()]
    sections = [Section("Answer", answer)]
    sections += [Section("Difference", (*_pairs(one), *links, *synthetic_notice(session))), *parts(found)]
    path = _page(session, first, second)
    files.write_text(path, session_document(session, f"{first} beside {second}", sections))
    write_overview(session, STAGES)
    return path


def write_variants(session: Session, done: Collection[str]) -> None:
    """Write the page of each variant beside its base, of which something was computed and all is up to date."""
    for name, one in session.variants.items():
        if {name, one.base} & set(done) or not _page(session, one.base, name).is_file():
            with contextlib.suppress(InputError):  # the page of the one that failed says why
                beside(session.root, one.base, name)


def _page(session: Session, first: str, second: str) -> Path:
    names = (re.sub(r"[^\w.-]+", "_", name) for name in (first, second))
    return session.folder / f"{BESIDE}{AND.join(names)}.html"


def _apart(one: SideBySide) -> str:
    """Say in how many quantities two experiments differ."""
    gaps = [gap for old, new in one.rows if (gap := _gap(old, new)) is not None]
    if not gaps:
        return "No quantity is measured in both: the comparisons of each follow below."
    apart, n = sum(abs(gap) >= SURE for gap in gaps), len(gaps)
    verb = "differs" if apart == 1 else "differ"
    text = f"{apart} of {counted(n, 'quantity', 'quantities')} measured in both {verb} by more than"
    return f"{text} the 95 % interval of the difference."


def _gap(old: Row, new: Row) -> float | None:
    """Return the difference of two measured values in units of its standard uncertainty; None where it has none."""
    u = float(np.hypot(old.u_measured or 0.0, new.u_measured or 0.0))
    return None if old.measured is None or new.measured is None or not u else (old.measured - new.measured) / u


def _pairs(one: SideBySide) -> Iterator[Block]:
    """Show two experiments next to each other: every comparison of both, and the settings in which a variant differs.

    The measurement of a variant is that of its base; of others the measured values are compared, the largest
    difference first.
    """
    if one.changed:
        settings = [(name, *values) for name, values in one.changed.items()]
        yield Table(tuple(map(Column, ("setting", one.base, one.name))), settings)
    rows = [(_gap(old, new), what(old), comparison_text(old), comparison_text(new)) for old, new in one.rows]
    names = tuple(map(Column, ("quantity", one.base, one.name)))
    caption = "Measured against expected"
    if one.changed and rows:
        caption += "; what the settings do not touch is equal on both sides."
        yield Table(names, [tuple(cells) for _, *cells in rows], caption=caption)
    elif rows:
        caption += ". What both share, such as the calibration of one sensor, counts in each: where they share much, "
        caption += "the difference is known better than is said here."
        rows.sort(key=lambda cells: -abs(cells[0] or 0.0))
        yield Table((Column(f"{one.base} minus {one.name}", "u", digits=2), *names), rows, caption=caption)


def _curves_of(results: Results, names: tuple[str, str]) -> Iterator[Block]:
    """Lay the main curve of each experiment over the other's, where both are of one kind."""
    kinds = {results.experiments[name].kind for name in names}
    source = KINDS[next(iter(kinds))].picture if len(kinds) == 1 else None
    if source is None:
        return
    found = [results.first(name, source.stage) for name in names]
    sides = [side for one in found if (side := curve(one, source)) is not None]
    if found[0] is None or len(sides) < 2:
        return
    shown = []
    for variable, values in zip((source.x, source.y), zip(*sides, strict=True), strict=True):
        every = np.concatenate(values)
        shown.append(display_unit(every[np.isfinite(every)], str(found[0][variable].attrs.get("units", "1"))))
    names_of = zip((source.x, source.y), shown, strict=True)
    x_label, y_label = (f"{v.replace('_', ' ')} / {unit.text}" for v, unit in names_of)
    roles: tuple[Role, Role] = ("measured", "reference")
    series = [
        Series(name, x / shown[0].factor, y / shown[1].factor, role=role)
        for name, (x, y), role in zip(names, sides, roles, strict=True)
    ]
    title, scale = source.y.replace("_", " ").capitalize(), source.scale
    yield LineChart(title, x_label, y_label, series, x_scale=scale, y_scale=scale)  # type: ignore[arg-type]


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
