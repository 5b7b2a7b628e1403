"""Quantities of many sessions over time: control charts, drift, and differences between groups.

Followed are the key numbers of every kind, for each specimen, and every check that compares two sizes, as observed over
expected, for each sensor: free-fall acceleration seen by a laser shows the laser's scale, whatever was dropped.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from labpipe import files
from labpipe.errors import InputError
from labpipe.notebook import Shown, ShownAsTable
from labpipe.report import (
    Band,
    Block,
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
    value_with_uncertainty,
)
from pipelines.experiments import KINDS
from pipelines.experiments.shared.judgements import chance, probability
from pipelines.experiments.shared.pages import SYNTHETIC, counted
from pipelines.session._catalogue import CHECKS, KEYS, PAGE as CATALOGUE_PAGE, TREND_PAGE, Opened, open_catalogue

if TYPE_CHECKING:
    from labpipe.arrays import Floats

RARE = math.erfc(3.0 / math.sqrt(2.0))
"""Probability of a value beyond three standard deviations, as the limits of a control chart have it."""
GROUPS = {"record": "calibration record", "operator": "operator", "specimen": "specimen"}
_OTHER_TEMPERATURE = 10.0
"""K from the median of a material, beyond which an experiment has charts of its own: rooms vary by less."""


@dataclass(frozen=True, slots=True, eq=False)
class ControlChart:
    """One quantity over the days on which it was measured, in SI: an individuals chart.

    ``owner`` is the sensor, of a ratio of observed over expected, or the kind of experiment. ``points`` has a row for
    each session, by day: ``session``, ``day``, ``value`` and ``u`` (means of its experiments, whose calibration is
    one), ``operator``, ``record``. ``sigma`` is the standard deviation from the mean moving range, ``MR sqrt(pi) / 2``
    (D. C. Montgomery, Introduction to Statistical Quality Control, section 6.4), which a slow drift does not widen,
    ``u`` the root mean square of the stated standard uncertainties, NaN where there are none; ``slope`` is that of
    least squares per day with the two-sided probability ``p`` of a larger one by chance. ``groups`` holds, by record,
    operator and specimen, the probability of larger differences by chance and the mean of each group. A drift is a
    slope that is less likely by chance than one value of all charts beyond three standard deviations.
    """

    owner: str
    title: str
    unit: str
    is_ratio: bool
    points: pd.DataFrame
    mean: float
    sigma: float
    u: float
    slope: float
    p: float
    groups: dict[str, tuple[float, dict[str, float]]]
    is_drifting: bool = False

    @property
    def is_outside(self) -> np.ndarray:
        """Whether each value is beyond three standard deviations (session,)."""
        return (np.abs(self.points["value"] - self.mean) > 3.0 * self.sigma).to_numpy() & (self.sigma > 0.0)

    @property
    def change(self) -> float:
        """Change from the first day to the last by the slope."""
        return self.slope * float(_elapsed(self.points["day"])[-1])

    @property
    def drift(self) -> str:
        """The drift in words."""
        size = f"{100 * abs(self.change):.2g} %" if self.is_ratio else quantity(abs(self.change), self.unit, 2)
        first, last = self.points["day"].iloc[[0, -1]]
        within = f", {abs(self.change) / self.u:.2g} times its stated uncertainty" if self.u > 0.0 else ""
        way = "rose" if self.change > 0 else "fell"
        return f"{self.title} {way} by {size} from {first} to {last}{within} ({chance(self.p)})"

    @property
    def state(self) -> str:
        """One word or two for a table."""
        n = int(self.is_outside.sum())
        return "drifts" if self.is_drifting else f"{n} outside" if n else "steady"


@dataclass(frozen=True, slots=True, repr=False)
class Trend(ShownAsTable):
    """Control charts of many sessions, those of ratios first, of every owner the most significant drift first.

    ``drifts`` are drifts in words by owner, ``undated`` session and name of experiments whose files and settings hold
    no day, ``problems`` sessions that cannot be read, with the reason.
    """

    page: Path
    charts: tuple[ControlChart, ...]
    drifts: dict[str, list[str]]
    undated: tuple[tuple[str, str], ...]
    problems: dict[str, str]

    def _shown(self) -> Shown:
        means = (value_with_uncertainty(c.mean, c.sigma, c.unit) for c in self.charts)
        rows = [(c.owner, c.title, len(c.points), mean, c.state) for c, mean in zip(self.charts, means, strict=True)]
        return Shown(f"{len(rows)} control charts", ("of", "quantity", "n", "mean", "state"), rows)

    def documents(self) -> list[dict[str, Any]]:
        """Return the charts for JSON, None for numbers that are not known."""
        names = ("owner", "title", "unit", "mean", "sigma", "u", "slope", "p", "state", "groups")
        rows = (c.points.astype(object).where(c.points.notna(), None).to_dict("records") for c in self.charts)
        made = [{n: getattr(c, n) for n in names} | {"points": own} for c, own in zip(self.charts, rows, strict=True)]
        return [one | {n: None for n in ("u", "p") if not math.isfinite(one[n])} for one in made]


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
    frame = frame.reindex(columns=[*frame, *({"material", "height", "temperature"} - set(frame))])
    # the specimen: material, height, and a temperature that is not the usual one
    height, temperature = (pd.to_numeric(frame[name], errors="coerce") for name in ("height", "temperature"))
    usual = temperature.groupby(frame["material"].fillna("")).transform("median")
    other = temperature.where((temperature - usual).abs() > _OTHER_TEMPERATURE)
    shown = [column.map(lambda v, unit=unit, n=n: quantity(v, unit, n) if math.isfinite(v) else "")
             for column, unit, n in ((height, "m", 3), (other, "degC", 2))]  # fmt: skip
    parts_of = zip(frame["material"].fillna(""), *shown, strict=True)
    frame["specimen"] = [", ".join(filter(None, own)) for own in parts_of]
    common = ["session", "experiment", "recorded", "record", "operator", "specimen", "kind", "sensor"]
    points = opened.select("results", f"stage IN ('{CHECKS}', '{KEYS}') AND ({where.strip() or 'true'})")
    points["u"] = pd.to_numeric(points["u"])
    keys = ["session", "experiment", "stage", "variable", "unit"]
    points = points.groupby(keys, as_index=False, sort=False)[["value", "u"]].mean().merge(frame[common])
    is_ratio, title = points["stage"] == CHECKS, points["kind"].map({name: kind.title for name, kind in KINDS.items()})
    owner = points["sensor"].where(is_ratio).fillna(title)
    points = points.assign(owner=owner, is_ratio=is_ratio, chart=points["specimen"].where(~is_ratio, ""))
    return points.rename(columns={"variable": "quantity"})


def control_charts(points: pd.DataFrame) -> tuple[ControlChart, ...]:
    """Make a chart of each quantity that was measured on two days.

    ``points`` has a row for each quantity of each experiment: ``owner``, ``quantity``, ``chart`` (its specimen, where
    that decides the value), ``is_ratio``, ``unit``, ``recorded`` (ISO day), ``session``, ``operator``, ``record``,
    ``specimen``, ``value`` and ``u`` (SI).
    """
    grouped = points.groupby(["owner", "quantity", "chart"], sort=False) if len(points) else ()
    made = [_chart(own) for _, own in grouped if own["recorded"].nunique() > 1]
    made = [replace(c, is_drifting=c.p < RARE / len(made)) for c in made]
    return tuple(sorted(made, key=lambda c: (not c.is_ratio, c.owner, c.p if math.isfinite(c.p) else 1.0)))


def _chart(own: pd.DataFrame) -> ControlChart:
    """Make a chart of the values of one quantity, an experiment each."""
    from scipy.stats import f_oneway, linregress

    own = own.fillna({"operator": "", "record": ""})

    def joined(texts: pd.Series[str]) -> str:
        return ", ".join(dict.fromkeys(texts))

    columns = {"day": ("recorded", "min"), "value": ("value", "mean"), "u": ("u", "mean")}
    by_session = own.groupby("session", as_index=False)
    table = by_session.agg(**columns, operator=("operator", joined), record=("record", joined))
    table = table.sort_values("day", kind="stable", ignore_index=True)
    value, elapsed = table["value"].to_numpy(float), _elapsed(table["day"])
    slope, p = 0.0, math.nan
    if len(np.unique(elapsed)) > 2 and np.ptp(value) > 0.0:
        slope, _, _, p, _ = map(float, linregress(elapsed, value))
    first = own.iloc[0]
    sigma, u = float(np.abs(np.diff(value)).mean()) * math.sqrt(math.pi) / 2.0, math.sqrt((table["u"] ** 2).mean())
    title = ", ".join(part for part in (first["quantity"], first["chart"]) if part)
    # means compared: of sessions by record and, less the drift, operator; of experiments by specimen in their session
    line = slope * elapsed if p < RARE else 0.0 * elapsed
    sets = {
        "record": (table["record"], table["value"]),
        "operator": (table["operator"], table["value"] - line + line.mean()),
        "specimen": (
            own["specimen"],
            own["value"] - own["session"].map(table.set_index("session")["value"]) + table["value"].mean(),
        ),
    }
    groups = {}
    for by, (names, values) in sets.items():
        parts = {str(name): part.to_numpy(float) for name, part in values.groupby(names.to_numpy(), sort=False)}
        if 1 < len(parts) < len(values) and any(np.ptp(part) > 0.0 for part in parts.values()):
            groups[by] = float(f_oneway(*parts.values()).pvalue), {n: float(part.mean()) for n, part in parts.items()}
    about = (first["owner"], title, first["unit"], bool(first["is_ratio"]))
    return ControlChart(*about, table, float(value.mean()), sigma, u, slope, p, groups)


def _elapsed(days: pd.Series[str]) -> Floats:
    dates = days.to_numpy("datetime64[D]")
    return np.asarray((dates - dates[0]).astype(float))


_TIED = "\N{NO-BREAK SPACE}"  # a sign stays with its number
_METHOD = (
    "Each point is one session: the mean of its experiments with the mean of their standard uncertainties. Centre "
    "line: mean of all sessions. Band: three standard deviations of the individuals, estimated from the mean moving "
    "range of successive sessions (MR × √π / 2), which a slow drift does not widen. Outer lines: three times the "
    "stated standard uncertainty (root mean square). A drift is a least-squares slope whose probability by chance, "
    f"over all charts together, is below {RARE:.2g}. Groups are compared by analysis of variance. Ratios are those of "
    "the checks, observed over expected, by the sensor that observed them. (D. C. Montgomery, Introduction to "
    "Statistical Quality Control, chapter 6.)"
)


def trend_page(found: Trend, opened: Opened) -> str:
    """Write the page: drifts, the gravest with its chart, first; then all charts by sensor and kind, and the groups."""
    charts = found.charts
    worst = next((c for c in charts if c.is_drifting), None)
    answer: list[Block] = [*_answer(found), *([_drawn(worst)] if worst else [])]
    if found.page.parent == opened.page_folder:
        answer.append(Link("All experiments", CATALOGUE_PAGE, "of these sessions, with their verdicts"))
    columns = [
        Listed("of", [c.owner for c in charts]),
        Listed("quantity", [c.title for c in charts]),
        Listed("state", [c.state for c in charts]),
        Listed("mean", [value_with_uncertainty(c.mean, c.sigma, c.unit) for c in charts]),
        Listed("change", [quantity(c.change, c.unit, 2) for c in charts]),
        Listed("p", [probability(c.p).replace(" ", _TIED) if np.isfinite(c.p) else None for c in charts]),
        Listed("sessions", [len(c.points) for c in charts]),
    ]
    caption = "After ±: standard deviation of one session. Change: by the line of least squares, first to last day."
    sections = [Section("Answer", answer), Section("All quantities", [listed(columns, caption)])]
    for is_ratio, owner in dict.fromkeys((c.is_ratio, c.owner) for c in charts):
        own = [_drawn(c) for c in charts if (c.is_ratio, c.owner) == (is_ratio, owner) and c is not worst]
        sections += [Section(f"{owner}: observed over expected" if is_ratio else owner, own)] if own else []
    of_groups = sorted(((c, by, *c.groups[by]) for c in charts for by in c.groups), key=lambda row: row[2])
    notices = list[Block]()
    for c, by, p, means in (row for row in of_groups if row[2] < RARE / len(of_groups)):
        ends = {"lowest": min(means, key=means.__getitem__), "highest": max(means, key=means.__getitem__)}
        shown = [f"{word} {n or 'not stated'} ({quantity(means[n], c.unit, 5)})" for word, n in ends.items()]
        text = f"{c.owner}, {c.title}: differs by {GROUPS[by]}, {', '.join(shown)}, {chance(p)}."
        notices.append(Notice("warning", text))
    alike = Notice("ok", "No quantity differs between calibration records, operators or specimens.")
    sections.append(Section("By calibration record, operator and specimen", notices or [alike]))
    sections.append(Section("Method", [Paragraph(_METHOD, copyable=True)]))
    days = sorted({day for c in charts for day in c.points["day"]})
    badge = SYNTHETIC if opened.select("sessions", "NOT coalesce(synthetic, 0)").empty else ""
    return Document(f"{opened.base.name}: quantities over time", f"{days[0]} to {days[-1]}", badge, sections).render()


def _answer(found: Trend) -> Iterator[Notice]:
    for owner, texts in found.drifts.items():
        worst = next(c for c in found.charts if c.owner == owner and c.is_drifting)
        records = ", ".join(dict.fromkeys(filter(None, worst.points["record"])))
        remedy = f" Calibrate it again, and give each period a record of its own (now: {records})." * worst.is_ratio
        yield Notice("warning", f"{owner} drifts: {'; '.join(texts)}.{remedy}")
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
