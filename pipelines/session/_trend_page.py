"""The page of control charts."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from labpipe.report import (
    Band,
    Block,
    Details,
    Document,
    LineChart,
    Link,
    Listed,
    Notice,
    Paragraph,
    Section,
    Series,
    display_unit,
    listed,
)
from pipelines.experiments.shared.judgements import probability
from pipelines.experiments.shared.pages import SYNTHETIC, counted
from pipelines.session._catalogue_query import PAGE as CATALOGUE_PAGE
from pipelines.session._control_chart import GROUPS, RARE, ControlChart, Trend

if TYPE_CHECKING:
    from pipelines.session._catalogue_query import Opened

_METHOD = (
    "Each point is one session: the mean of its experiments with the mean of their standard uncertainties. Centre "
    "line: mean of all sessions. Band: three standard deviations of the individuals, estimated from the mean moving "
    "range of sessions that follow each other (MR × √π / 2), which a slow drift does not widen. Outer lines: three "
    "times the stated standard uncertainty (root mean square); it includes that of the calibration, which sessions "
    "of one record share, so that the points should scatter less. A drift is a least-squares slope whose probability "
    f"by chance, over all charts together, is below {RARE:g}. Groups are compared by analysis of variance. Ratios are "
    "those of the checks, observed over expected, by the sensor that observed them. (D. C. Montgomery, Introduction "
    "to Statistical Quality Control, chapter 6.)"
)


def trend_page(found: Trend, opened: Opened) -> str:
    """Write the page: what drifts, with its chart, first; then all charts by sensor and kind, and the groups."""
    charts = found.charts
    worst = next((c for c in charts if c.is_drifting), None)
    answer: list[Block] = [*_answer(found), *([_drawn(worst)] if worst else [])]
    if found.page.parent == opened.page_folder:
        answer.append(Link("All experiments", CATALOGUE_PAGE, "of these sessions, with their verdicts"))
    sections = [Section("Answer", answer), Section("All quantities", [_summary(charts)])]
    for is_ratio, owner in dict.fromkeys((c.is_ratio, c.owner) for c in charts):
        own = [_drawn(c) for c in charts if (c.is_ratio, c.owner) == (is_ratio, owner) and c is not worst]
        sections += [Section(f"{owner}: observed over expected" if is_ratio else owner, own)] if own else []
    sections.append(Section("By calibration record, operator and specimen", list(_groups(charts))))
    sections.append(Section("Method", [Paragraph(_METHOD, copyable=True)]))
    days = sorted({day for c in charts for day in c.points["day"]})
    badge = SYNTHETIC if opened.select("sessions", "NOT coalesce(synthetic, 0)").empty else ""
    return Document(f"{opened.base.name}: quantities over time", f"{days[0]} to {days[-1]}", badge, sections).render()


def _answer(found: Trend) -> Iterator[Notice]:
    for owner, texts in found.drifts.items():
        worst = next(c for c in found.charts if c.owner == owner and c.is_drifting)
        records = ", ".join(dict.fromkeys(filter(None, worst.points["record"])))
        remedy = f" Calibrate it again, and give each period a record of its own (now: {records})." * worst.is_ratio
        more = f" {counted(len(texts) - 1, 'more drift')} of it in the table below." if len(texts) > 1 else ""
        yield Notice("warning", f"{owner} drifts: {texts[0]}.{remedy}{more}")
    steady, n = sum(not c.is_drifting for c in found.charts), sum(len(c.points) for c in found.charts)
    outside = sum(int(c.is_outside.sum()) for c in found.charts)
    text = f"No drift in {counted(steady, 'other chart' if found.drifts else 'chart')}. "
    text += f"{outside} of {counted(n, 'value')} outside three standard deviations; by chance about {RARE * n:.1f}, "
    yield Notice("info" if found.drifts else "ok", f"{text}and some more where the sessions are few.")
    for name, problem in found.problems.items():
        yield Notice("error", f"{name} cannot be read: {problem}")
    if found.undated:
        names = ", ".join(f"{session}/{experiment}" for session, experiment in found.undated[:5])
        names += f" and {len(found.undated) - 5} more" if len(found.undated) > 5 else ""
        yield Notice("info", f"Left out, since neither files nor settings hold a day (state measured_on): {names}.")


def _summary(charts: Sequence[ControlChart]) -> Block:
    units = [display_unit([c.mean], c.unit) for c in charts]
    columns = (
        Listed("of", [c.owner for c in charts]),
        Listed("quantity", [c.title for c in charts]),
        Listed("sessions", [len(c.points) for c in charts]),
        Listed("mean", [c.mean / u.factor for c, u in zip(charts, units, strict=True)],
               u=[c.sigma / u.factor for c, u in zip(charts, units, strict=True)]),
        Listed("in", [u.text for u in units]),
        Listed("change", [c.change / u.factor for c, u in zip(charts, units, strict=True)], digits=2),
        Listed("p", [probability(c.p) if np.isfinite(c.p) else None for c in charts]),
        Listed("state", [c.state for c in charts]),
    )  # fmt: skip
    caption = "After ±: standard deviation of one session. Change: by the line of least squares, first to last day."
    return listed(columns, caption)


def _drawn(chart: ControlChart) -> LineChart:
    """Draw an individuals chart over the days since the first session."""
    points, x, is_out = chart.points, chart.elapsed, chart.is_outside
    unit = display_unit(points["value"], chart.unit)
    value, u = points["value"].to_numpy(float) / unit.factor, points["u"].to_numpy(float) / unit.factor
    mean, wide, far = (v / unit.factor for v in (chart.mean, 3.0 * chart.sigma, 3.0 * chart.u))
    ends = x[[0, -1]]
    series: list[Series | Band] = [
        Band("mean ± 3 sd (moving range)", ends, [mean - wide] * 2, [mean + wide] * 2, role="reference"),
        Series("mean", ends, [mean, mean], role="reference"),
    ]
    if far > 0.0:
        edges = {"mean − 3 u (stated)": mean - far, "mean + 3 u (stated)": mean + far}
        series += [Series(name, ends, [edge, edge], role="repeat") for name, edge in edges.items()]
    if chart.is_drifting:
        series.append(Series("drift", x, chart.slope * (x - x.mean()) / unit.factor + mean, role="model"))
    bars = u if np.isfinite(u).any() else None
    for name, those in (("session", ~is_out), ("session outside", is_out)):
        if those.any():
            own = None if bars is None else bars[those]
            role = "measured" if name == "session" else "residual"
            series.append(Series(name, x[those], value[those], style="points", role=role, u=own))  # type: ignore[arg-type]
    label = ("observed / expected" if chart.is_ratio else chart.title) + (f" / {unit.text}" if unit.text else "")
    changes = points[(points["record"] != points["record"].shift()) & (points["record"] != "")]
    marks = list(zip(changes["record"], x[changes.index.to_numpy(int)].tolist(), strict=True))
    outside = ", ".join(f"{p.session} ({p.day})" for p in points[is_out].itertuples())
    caption = f"{chart.drift}. " * chart.is_drifting + (f"Outside: {outside}." if outside else "")
    titles = (chart.title, f"days since {points['day'].iloc[0]}", label)
    return LineChart(*titles, series, group="days", vlines=marks, caption=caption.strip(), height_px=240)


def _groups(charts: Sequence[ControlChart]) -> Iterator[Block]:
    found = sorted(((c, by, *c.groups[by]) for c in charts for by in c.groups), key=lambda row: row[2])
    differing = [row for row in found if row[2] < RARE / len(found)]
    for c, by, _, means in differing:
        least, most = (pick(means, key=means.__getitem__) for pick in (min, max))
        text = f"{c.owner}, {c.title}: differs by {GROUPS[by]}, lowest {least or 'not stated'}, highest {most}."
        yield Notice("warning", text)
    if not differing:
        yield Notice("ok", "No quantity differs between calibration records, operators or specimens.")
    rows = [(c.owner, c.title, GROUPS[by], name or "not stated", mean, c.unit, probability(p))
            for c, by, p, means in found for name, mean in means.items()]  # fmt: skip
    if rows:
        titles = ("of", "quantity", "by", "group", "mean, SI", "unit", "p")
        columns = [Listed(title, cells, digits=5) for title, cells in zip(titles, zip(*rows, strict=True), strict=True)]
        yield Details(f"All {counted(len(found), 'comparison')}, the most different first", (listed(columns),))
