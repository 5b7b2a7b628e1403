"""Quantities of many sessions over time: control charts, drift, and differences between groups.

Followed are the key numbers of every kind, for each specimen, and every check that compares two sizes, as observed over
expected, for each sensor: free-fall acceleration seen by a laser shows the laser's scale, whatever was dropped.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from labpipe import files
from labpipe.errors import InputError
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
    quantity,
)
from pipelines.experiments import KINDS
from pipelines.experiments.shared.judgements import probability
from pipelines.experiments.shared.pages import SYNTHETIC, counted
from pipelines.session._catalogue import CHECKS, open_catalogue
from pipelines.session._catalogue_page import PAGE as CATALOGUE_PAGE, TREND_PAGE, Opened
from pipelines.session._control_chart import GROUPS, RARE, ControlChart, Trend, control_charts

_OTHER_TEMPERATURE = 10.0
"""K from the median of a material, beyond which an experiment has charts of its own: rooms vary by less."""


def trend(
    folders: str | Path | Iterable[str | Path],
    database: str | Path | None = None,
    *,
    where: str = "",
    out: str | Path | None = None,
) -> Trend:
    """Chart the quantities of all sessions below some folders over time, and write a page of them.

    The catalogue is brought up to date first; nothing is processed. The day of an experiment is ``measured_on`` of
    its settings, or else that of its files.

    Parameters
    ----------
    folders, database, where
        As of :func:`catalogue`; ``where`` selects experiments.
    out : path-like, optional
        The page; default ``trend.html`` in the first folder.

    Returns
    -------
    Trend

    Raises
    ------
    InputError
        No quantity was measured on two days.
    UsageError
        The expression is not one, or names a column that is not there.

    Examples
    --------
    >>> trend("sessions", where="operator = 'A. Person'").drifts  # doctest: +SKIP
    """
    with open_catalogue(folders, database) as opened:
        points = _points(opened, where)
        is_dated = points["recorded"].notna()
        undated = points.loc[~is_dated, ["session", "experiment"]].drop_duplicates()
        charts = control_charts(points[is_dated])
        if not charts:
            raise InputError(
                f"{opened.base}: no quantity was measured on two days ({len(undated)} experiments have no day: state "
                "measured_on in session.toml). Process the sessions, or search a folder that holds more of them"
            )
        drifts: dict[str, list[str]] = {}
        for chart in charts:
            if chart.is_drifting:
                drifts.setdefault(chart.owner, []).append(chart.drift)
        page = opened.page_folder / TREND_PAGE if out is None else Path(out)
        pairs = tuple(undated.itertuples(index=False, name=None))
        found = Trend(page, charts, drifts, pairs, opened.done["problems"])
        files.write_text(page, trend_page(found, opened))
    return found


def _points(opened: Opened, where: str) -> pd.DataFrame:
    """Return every quantity of every experiment, a row each, as :func:`control_charts` takes them."""
    frame = opened.select("experiments", where)
    units = frame.attrs["units"]
    for name in {"material", "height", "temperature"} - set(frame):
        frame[name] = None
    frame["specimen"], frame.attrs["units"] = _specimens(frame), units
    titles = {name: kind.title for name, kind in KINDS.items()}
    known = frame["kind"].map(str)
    common = ["session", "experiment", "recorded", "record", "operator", "specimen"]
    parts = [frame[[*common]].iloc[:0]]
    for kind in KINDS.keys() & set(known):
        own = frame[known == kind]
        own.attrs["units"] = units
        for key in KINDS[kind].key_numbers:
            value, u = opened.number(own, kind, key)
            made = own[common].assign(value=value, u=u, chart=own["specimen"], owner=titles[kind], quantity=key.title)
            parts.append(made.assign(unit=key.unit, is_ratio=False))
    ratios = opened.select("results", f"stage = '{CHECKS}' AND ({where.strip() or 'true'})")
    ratios = ratios.groupby(["session", "experiment", "variable"], as_index=False)[["value", "u"]].mean()
    ratios = ratios.merge(frame[[*common, "kind", "sensor"]], on=["session", "experiment"])
    owner = ratios["sensor"].fillna(ratios["kind"].map(titles))
    parts.append(ratios.rename(columns={"variable": "quantity"}).assign(owner=owner, unit="1", is_ratio=True, chart=""))
    points = pd.concat([part for part in parts if len(part)] or parts, ignore_index=True)
    return points[points["value"].notna()] if "value" in points else points


def _specimens(frame: pd.DataFrame) -> list[str]:
    """Name material, height, and a temperature that is not the usual one, for every experiment."""
    height, temperature = (pd.to_numeric(frame[name], errors="coerce") for name in ("height", "temperature"))
    usual = temperature.groupby(frame["material"].fillna("")).transform("median")
    names = []
    for material, h, t, u in zip(frame["material"], height, temperature, usual, strict=True):
        parts = [material if isinstance(material, str) else "", quantity(h, "m", 3) if math.isfinite(h) else ""]
        parts += [quantity(t, "degC", 2)] if abs(t - u) > _OTHER_TEMPERATURE else []
        names.append(", ".join(part for part in parts if part))
    return names


_TIED = "\N{NO-BREAK SPACE}"  # a sign stays with its number
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
    pairs = list(zip(charts, units, strict=True))
    columns = [
        Listed("of", [c.owner for c in charts]),
        Listed("quantity", [c.title for c in charts]),
        Listed("state", [c.state for c in charts]),
        Listed("mean", [c.mean / u.factor for c, u in pairs], u=[c.sigma / u.factor for c, u in pairs]),
        Listed("in", [u.text for u in units]),
        Listed("change", [c.change / u.factor for c, u in pairs], digits=2),
        Listed("p", [probability(c.p).replace(" ", _TIED) if np.isfinite(c.p) else None for c in charts]),
        Listed("sessions", [len(c.points) for c in charts]),
    ]
    columns = [column for column in columns if column.title != "in" or any(column.cells)]
    caption = "After ±: standard deviation of one session. Change: by the line of least squares, first to last day."
    return listed(columns, caption)


def _drawn(chart: ControlChart) -> LineChart:
    """Draw an individuals chart over the days of the sessions."""
    points, is_out = chart.points, chart.is_outside
    x = points["day"].to_numpy("datetime64[D]").astype(float)
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
    titles = (chart.title, "first day of the session", label)
    return LineChart(*titles, series, "days", "day", vlines=marks, caption=caption.strip(), height_px=240)


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
