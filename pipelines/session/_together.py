"""The page of two experiments side by side."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

from labpipe import files
from labpipe.errors import InputError, UsageError
from labpipe.report import SURE, Block, Column, Link, Notice, Paragraph, Section, Table, display_unit
from labpipe.workflow.plan import page_name
from labpipe.workflow.results import Results
from labpipe.workflow.session import Session
from pipelines.experiments import KINDS
from pipelines.experiments.shared.comparison_rows import Row
from pipelines.experiments.shared.pages import session_document, synthetic_notice
from pipelines.session._compare_page import beside_base, parts, what
from pipelines.session._comparison import Comparison, compared, side_by_side
from pipelines.session._overview import AND, BESIDE, PAGE, write_overview
from pipelines.session._results import STAGES, opened
from pipelines.session._verdict_notices import each
from pipelines.session._verdicts import Verdict, stored_verdicts


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
    own, others = rows[first] or [], rows[second] or []
    pair = next((n for n in ((first, second), (second, first)) if session.experiments[n[1]].base == n[0]), None)
    if pair is not None:
        (one,) = side_by_side(replace(session, experiments={pair[1]: session.experiments[pair[1]]}), (*own, *others))
        said: Block = Notice("info", f"{one.name} is a variant of {one.base}: {one.changes}.")
        difference: Sequence[Block] = beside_base(one)
    else:
        said, *difference = _difference(own, others, first, second)
    found = Comparison((*own, *others), {}, {}, session.folder / PAGE)
    names = (first, second)
    answer = (*_verdicts(names, verdicts, found.rows), said, *_chart(results, names))
    links = [
        Link(name, page_name(name), KINDS[session.experiments[name].kind].title)
        for name in names
        if (session.folder / page_name(name)).is_file()
    ]
    sections = [
        Section("Answer", answer),
        Section("Difference", (*difference, *links, *synthetic_notice(session))),
        *parts(found),
    ]
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


def _verdicts(names: Sequence[str], verdicts: Mapping[str, Verdict], rows: Iterable[Row]) -> Iterator[Block]:
    by: dict[str, str] = {}  # what an experiment is compared with; a film, the laser
    for row in rows:
        by[row.experiment] = "model" if by.get(row.experiment) == "model" else row.against
    return each(names, verdicts, by)


def _difference(first: Sequence[Row], second: Sequence[Row], a: str, b: str) -> Iterator[Block]:
    """Say in what two experiments differ, in units of the difference's uncertainty."""
    others = {(row.quantity, row.unit, row.against): row for row in second if row.measured is not None}
    body: list[tuple[float | None, tuple[float | str | None, ...]]] = []
    for row in first:
        other = others.get((row.quantity, row.unit, row.against))
        if row.measured is None or other is None or other.measured is None:
            continue
        gap = row.measured - other.measured
        u = ((row.u_measured or 0.0) ** 2 + (other.u_measured or 0.0) ** 2) ** 0.5
        shown = display_unit([row.measured, other.measured], row.unit)
        values = (row.measured, row.u_measured, other.measured, other.u_measured, gap, u or None)
        scaled = [None if value is None else value / shown.factor for value in values]
        body.append((gap / u if u else None, (what(row), *scaled, shown.text)))
    if not body:
        yield Notice("info", "No quantity is measured in both: what each was compared with stands below.")
        return
    body.sort(key=lambda found: -abs(found[0] or 0.0))
    apart = sum(1 for deviation, _ in body if deviation is not None and abs(deviation) >= SURE)
    n = len(body)
    yield Notice(
        "info",
        f"{apart} of {n} quantit{'y' if n == 1 else 'ies'} measured in both differ{'s' if apart == 1 else ''} by more "
        "than the 95 % interval of the difference.",
    )
    head = (Column("difference", "u", digits=2), Column("quantity"))
    sides = (Column(a, u=3), Column("u"), Column(b, u=5), Column("u"), Column(f"{a} minus {b}", u=7), Column("u"))
    columns = (*head, *sides, Column("in"))
    yield Table(columns, [(deviation, *cells) for deviation, cells in body])
    yield Paragraph(
        "The largest difference first, of what was measured. What both share, such as the calibration of one sensor, "
        "is counted in each: where they share much, the difference is known better than is said here."
    )


def _chart(results: Results, names: Sequence[str]) -> Iterator[Block]:
    """Lay the main curve of each experiment over the other's, where both are of one kind."""
    import numpy as np

    from labpipe.report import LineChart, Series

    kinds = {results.experiments[name].kind for name in names}
    source = KINDS[next(iter(kinds))].picture if len(kinds) == 1 else None
    found = [] if source is None else [results.first(name, source.stage) for name in names]
    if source is None or any(one is None or not {source.x, source.y} <= set(one.variables) for one in found):
        return
    curves = [one for one in found if one is not None]
    sides = [tuple(np.asarray(one[v], float) for v in (source.x, source.y)) for one in curves]
    if any(x.ndim != 1 or np.isfinite(x + y).sum() < 2 for x, y in sides):
        return
    labels, factors = [], []
    for variable, values in zip((source.x, source.y), zip(*sides, strict=True), strict=True):
        every = np.concatenate(values)
        unit = display_unit(every[np.isfinite(every)].tolist(), str(curves[0][variable].attrs.get("units", "1")))
        labels.append(f"{variable.replace('_', ' ')} / {unit.text}")
        factors.append(unit.factor)
    roles: tuple[Literal["measured", "reference"], ...] = ("measured", "reference")
    series = []
    for name, (x, y), role in zip(names, sides, roles, strict=True):
        order = np.argsort(x, kind="stable")[: np.isfinite(x).sum()]  # NaN is last
        series.append(Series(name, x[order] / factors[0], y[order] / factors[1], role=role))
    scale: Literal["linear", "log"] = "log" if source.scale == "log" else "linear"
    title = labels[1].partition(" / ")[0].capitalize()
    yield LineChart(title, labels[0], labels[1], series, x_scale=scale, y_scale=scale)
