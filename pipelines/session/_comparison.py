"""Measurement against model over all experiments of a session, and two experiments side by side, with their pages.

The comparisons of an experiment are in its own results; here the rows of all kinds are collected.
A curve gives its normalised root-mean-square error and bias, an event (a restitution, a largest
radius, the work of a cycle) its two values and their difference with its uncertainty.
"""

from __future__ import annotations

import contextlib
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from labpipe import files
from labpipe.errors import InputError, LabpipeError, UsageError
from labpipe.judging import LIKELY
from labpipe.notebook import Shown, ShownAsTable
from labpipe.report import (
    SURE,
    Block,
    Deviations,
    KeyValues,
    LineChart,
    Link,
    Listed,
    Notice,
    Paragraph,
    Role,
    Section,
    Series,
    display_unit,
    listed,
    number,
    plus_minus,
    quantity,
)
from labpipe.workflow.context import settings_in_words
from labpipe.workflow.fields import REFERENCE
from labpipe.workflow.graph import OTHER, field_value
from labpipe.workflow.plan import page_name
from labpipe.workflow.results import Results
from labpipe.workflow.session import Experiment, Session
from pipelines.experiments import KINDS
from pipelines.experiments.shared.comparison_rows import Row
from pipelines.experiments.shared.pages import counted, session_document, synthetic_notice
from pipelines.session._overview import AND, BESIDE, curve, pages_together, write_overview
from pipelines.session._results import STAGES, derive, opened
from pipelines.session._session_checks import NAMED
from pipelines.session._verdict_notices import agreement, each
from pipelines.session._verdicts import Verdict, stored_verdicts

GOOD = 0.03
"""nRMSE that is called good: the aim for data made with the right material."""


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


def sides(row: Row) -> tuple[str, str, str, str]:
    """Write the measured value, the one it is compared with, the difference, and the unit of all; "" for none."""
    pairs = ((row.measured, row.u_measured), (row.model, row.u_model), (row.difference, row.u_difference))
    known = [value for value, _ in pairs[:2] if value]
    shown = display_unit(known or [value for value, _ in pairs if value is not None], row.unit)
    texts = [
        "" if value is None else plus_minus(value / shown.factor, u / shown.factor) if u
        else number(value / shown.factor, 5)
        for value, u in pairs
    ]  # fmt: skip
    return texts[0], texts[1], texts[2], shown.text


def comparison_text(row: Row) -> str:
    """Write the values of a row: nRMSE and bias of a curve, both sides and the deviation of an event."""
    if row.nrmse is not None:
        bias = "" if row.difference is None else f", bias {quantity(row.difference, row.unit, 3)}"
        return f"nRMSE {100 * row.nrmse:.2f} %{bias}"
    measured, model, _, unit = sides(row)
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
    if own := getattr(body, "source", ""):
        return str(own)
    inputs = {name.removeprefix(OTHER) for s in kind.stages for name in s.inputs if name.startswith(OTHER)}
    for field in sorted({name.split("/")[0] for name in inputs}):
        named = field_value(experiment.settings, field)
        other = session.experiments.get(named.removeprefix(REFERENCE)) if isinstance(named, str) else None
        if other is not None and other.name != experiment.name and (found := _material(other, session)):
            return found
    return ""


def write_comparison(session: Session, found: Comparison, verdicts: Mapping[str, Verdict]) -> None:
    """Write the page of all comparisons of a session; a variant is on the page of its base and itself."""
    rows = [row for row in found.rows if row.experiment not in session.variants]
    judged = [one for one in found.experiments if one["experiment"] not in session.variants]
    links = [Link(text, name) for text, name in pages_together(session.folder)]
    points: dict[str, list[tuple[float, str]]] = {}
    for row in (row for row in rows if row.deviation is not None):
        points.setdefault(_what(row), []).append(
            (row.deviation or 0.0, f"{row.experiment}, {row.condition}".rstrip(", "))
        )
    caption = (
        "Each mark is one experiment, in standard uncertainties of its difference, measured minus model; the shaded "
        "band holds 95 % of them when model and uncertainties are right. Filled diamonds lie outside, "
        "triangles at the edge farther out."
    )
    chart = [Deviations("Difference over its uncertainty", list(points.items()), caption)] if points else []
    # values by their deviation, then curves by their error
    rows.sort(key=lambda r: (r.is_curve, -abs(r.deviation or 0.0), -(r.nrmse or 0.0)))
    measured, model, difference, units = zip(*map(sides, rows), strict=True) if rows else [()] * 4
    parts = ([*row.material.split(", "), *row.condition.split(", ")] for row in rows)
    text = (
        "The largest deviation first: measured minus model in units of the difference's standard uncertainty, which "
        "includes that of every input that is stated with one, and of the DMA from which a material is taken; a "
        "material of the library or of a file counts as exact. Of a curve, nRMSE is the root mean square of the "
        "difference over the range of the model, and the difference its mean; n counts repeats or points."
    )
    table = listed([
        Listed("deviation", [r.deviation for r in rows], "u", digits=2),
        Listed("quantity", [_what(r) for r in rows]),
        Listed("experiment", [r.experiment for r in rows]),
        # in one cell, so that the table fits a page
        Listed("of", [", ".join(p.replace(" ", "\N{NO-BREAK SPACE}") for p in own if p) for own in parts]),
        Listed("measured", measured), Listed("model", model), Listed("difference", difference), Listed("in", units),
        Listed("nRMSE", [None if r.nrmse is None else 100 * r.nrmse for r in rows], "%", digits=2),
        Listed("p", [r.p for r in rows], digits=2), Listed("n", [r.n for r in rows]),
    ])  # fmt: skip
    sections = [
        Section("Answer", (*_summary(found, rows, judged, verdicts), *links, *synthetic_notice(session))),
        Section("Deviations", chart),
        Section("Comparisons", (Paragraph(text), table) if rows else ()),
    ]
    files.write_text(found.page, session_document(session, "Measurement against model", sections))
    write_overview(session, STAGES)


def _summary(
    found: Comparison, rows: Sequence[Row], judged: Sequence[Mapping[str, Any]], verdicts: Mapping[str, Verdict]
) -> Iterator[Block]:
    """Say in how many experiments the model agrees, and how many comparisons that rests on."""
    if said := agreement({one["experiment"]: one["model"] for one in judged}):
        yield said
    # records that cannot be believed, or inputs that would explain the difference
    names = [one["experiment"] for one in judged if one["believable"] != "yes" or one["suspects"]]
    yield from each(names[:NAMED], verdicts)
    curves = [row for row in rows if row.is_curve]
    known, p = ([v for v in values if v is not None] for values in ([r.deviation for r in rows], [r.p for r in curves]))
    within = "differ by less than the 95 % interval of the difference"
    counts = [
        ("values", sum(abs(d) < SURE for d in known), len(known), within),
        ("curves", sum((r.nrmse or 0.0) < GOOD for r in curves), len(curves), f"with an nRMSE below {100 * GOOD:g} %"),
        ("", sum(one > LIKELY for one in p), len(p), f"with p above {LIKELY:g} along the curve"),
    ]
    if of_any := [(title, f"{n} of {of}", text) for title, n, of, text in counts if of]:
        yield KeyValues(of_any)
    yield from (Notice("error", f"{name}: {why}") for name, why in found.failed.items())
    if kept := list(dict.fromkeys(row.experiment for row in found.rows if row.kept)):
        yield Notice("warning", f"Results that earlier code made and that were kept: {', '.join(kept)}.")
    for why in dict.fromkeys(found.absent.values()):
        without = ", ".join(name for name, text in found.absent.items() if text == why)
        yield Notice("info", f"{without}: {why}")


def _what(row: Row) -> str:
    """Name the quantity of a row, and the reference where that is no model."""
    return row.quantity if row.against == "model" else f"{row.quantity} ({row.against})"


def beside(folder: str | Path, first: str, second: str) -> Path:
    """Write ``FOLDER/labpipe/beside-FIRST--SECOND.html``, two experiments side by side, from the results there are."""
    results = opened(folder)
    session, names = results.plan.session, (first, second)
    if first == second:
        raise UsageError(f'name two experiments; "{first}" was named twice')
    verdicts, rows = stored_verdicts(results), dict[str, list[Row]]()
    for name in names:
        if name not in session.experiments:
            raise UsageError(f'there is no experiment "{name}" that is complete')
        if (own := compared(results, name)) is None and name not in verdicts:
            raise InputError(f"{name} has no results that are up to date; run: labpipe process {folder} --only {name}")
        rows[name] = own or []
    base, name = names if session.experiments[first].base != second else (second, first)
    said, table = _difference(session, base, name, rows)
    links = [Link(n, page_name(n), KINDS[session.experiments[n].kind].title) for n in names]
    links = [link for link in links if (session.folder / link.href).is_file()]
    answer = (*each(names, verdicts), Notice("info", said), *_curves_of(results, names))
    sections = [Section("Answer", answer), Section("Difference", (*table, *links, *synthetic_notice(session)))]
    path = _page(session, first, second)
    files.write_text(path, session_document(session, f"{first} beside {second}", sections))
    write_overview(session, STAGES)
    return path


def write_variants(session: Session, done: Collection[str]) -> None:
    """Write the page of each variant and its base, of which something was computed and all is up to date."""
    for name, one in session.variants.items():
        if {name, one.base} & set(done) or not _page(session, one.base, name).is_file():
            with contextlib.suppress(InputError):  # the page of the one that failed says why
                beside(session.root, one.base, name)


def _page(session: Session, first: str, second: str) -> Path:
    names = (re.sub(r"[^\w.-]+", "_", name) for name in (first, second))
    return session.folder / f"{BESIDE}{AND.join(names)}.html"


def _difference(session: Session, base: str, name: str, rows: Mapping[str, list[Row]]) -> tuple[str, list[Block]]:
    """Say in how many quantities two experiments differ, and lay all comparisons of both next to each other.

    The measurement of a variant is that of its base; of others the measured values are compared, the largest
    difference first.
    """
    of_base, own = ({(r.quantity, r.unit, r.against): r for r in rows[n]} for n in (base, name))
    pairs = [(of_base.get(key), own.get(key)) for key in dict.fromkeys([*of_base, *own])]
    pairs.sort(key=lambda pair: -abs(_gap(*pair) or 0.0))
    gaps = [_gap(*pair) for pair in pairs]
    blocks, columns = list[Block](), list[Listed]()
    if session.experiments[name].base == base:
        changed = session.experiments[name].changed
        said = f"{name} is a variant of {base}: {settings_in_words(changed)}."
        caption = "Measured against expected; what the settings do not touch is equal on both sides."
        sides = zip((base, name), zip(*changed.values(), strict=True), strict=True)
        blocks.append(listed([Listed("setting", list(changed)), *(Listed(title, texts) for title, texts in sides)]))
    else:
        known = [gap for gap in gaps if gap is not None]
        apart = sum(abs(gap) >= SURE for gap in known)
        said = f"{apart} of {counted(len(known), 'quantity', 'quantities')} measured in both "
        said += f"{'differs' if apart == 1 else 'differ'} by more than the 95 % interval of the difference."
        said = said if known else "No quantity is measured in both: the comparisons of each follow below."
        caption = (
            "Measured against expected. What both share, such as the calibration of one sensor, counts in each: where "
            "they share much, the difference is known better than is said here."
        )
        columns += [Listed(f"{base} minus {name}", gaps, "u", digits=2)] if known else []
    columns.append(Listed("quantity", [_what(row) for pair in pairs if (row := pair[0] or pair[1])]))
    for title, side in zip((base, name), zip(*pairs, strict=True), strict=False):
        columns.append(Listed(title, [row and comparison_text(row) for row in side]))
    return said, [*blocks, *([listed(columns, caption)] if pairs else [])]


def _gap(old: Row | None, new: Row | None) -> float | None:
    """Return the difference of two measured values in units of its standard uncertainty; None where it has none."""
    if old is None or new is None or old.measured is None or new.measured is None:
        return None
    u = float(np.hypot(old.u_measured or 0.0, new.u_measured or 0.0))
    return (old.measured - new.measured) / u if u else None


def _curves_of(results: Results, names: tuple[str, str]) -> Iterator[Block]:
    """Lay the main curve of each experiment over the other's, where both are of one kind."""
    kind, other = (KINDS[results.experiments[name].kind] for name in names)
    source = kind.picture if kind is other else None
    found = [one for name in names if source and (one := results.first(name, source.stage)) is not None]
    sides = [side for one in found if source and (side := curve(one, source)) is not None]
    if source is None or len(sides) < len(names):
        return
    shown = []
    for variable, values in zip((source.x, source.y), zip(*sides, strict=True), strict=True):
        every = np.concatenate(values)
        shown.append(display_unit(every[np.isfinite(every)], str(found[0][variable].attrs.get("units", "1"))))
    labels = [f"{v.replace('_', ' ')} / {unit.text}" for v, unit in zip((source.x, source.y), shown, strict=True)]
    roles: tuple[Role, Role] = ("measured", "reference")
    series = [
        Series(name, x / shown[0].factor, y / shown[1].factor, role=role)
        for name, (x, y), role in zip(names, sides, roles, strict=True)
    ]
    title, scale = source.y.replace("_", " ").capitalize(), source.scale
    yield LineChart(title, labels[0], labels[1], series, x_scale=scale, y_scale=scale)  # type: ignore[arg-type]
