"""Control charts: individuals with limits from the moving range, drift, and differences between groups."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from labpipe.notebook import Shown, ShownAsTable
from labpipe.report import quantity, value_with_uncertainty
from pipelines.experiments.shared.judgements import chance

if TYPE_CHECKING:
    from labpipe.arrays import Floats

RARE = 0.0027
"""Probability of a value beyond three standard deviations, as the limits of a control chart have it."""
GROUPS = {"record": "calibration record", "operator": "operator", "specimen": "specimen"}


@dataclass(frozen=True, slots=True, eq=False)
class ControlChart:
    """One quantity over the days on which it was measured: an individuals chart.

    Attributes
    ----------
    owner : str
        The sensor, of a ratio of observed over expected; the kind of experiment, of a key number.
    title, unit : str
        Quantity and specimen, and SI unit.
    is_ratio : bool
    points : DataFrame
        A row for each session, by day: ``session``, ``day``, ``value`` and ``u`` (means of the session's experiments,
        whose calibration is one), ``operator``, ``record``.
    mean, sigma : float
        Mean, and standard deviation from the mean moving range, ``MR * sqrt(pi) / 2``, which a slow drift does not
        widen (D. C. Montgomery, Introduction to Statistical Quality Control, section 6.4).
    u : float
        Root mean square of the stated standard uncertainties, NaN where there are none.
    slope, p : float
        Least-squares slope per day, and its two-sided probability by chance.
    groups : dict of str to (float, dict of str to float)
        By record, operator and specimen: probability of larger differences by chance, and the mean of each group.
    is_drifting : bool
        The slope is less likely by chance than one value of all charts beyond three standard deviations.
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
    def elapsed(self) -> Floats:
        """Days since the first one (session,)."""
        return _elapsed(self.points["day"])

    @property
    def is_outside(self) -> np.ndarray:
        """Whether each value lies beyond three standard deviations (session,)."""
        return (np.abs(self.points["value"] - self.mean) > 3.0 * self.sigma).to_numpy() & (self.sigma > 0.0)

    @property
    def change(self) -> float:
        """Change from the first day to the last by the slope."""
        return self.slope * float(self.elapsed[-1])

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
        made = []
        for c in self.charts:
            values = {n: getattr(c, n) for n in names}
            points = c.points.astype(object).where(c.points.notna(), None).to_dict("records")
            values |= {n: None for n in ("u", "p") if not math.isfinite(values[n])}
            made.append(values | {"points": points})
        return made


def control_charts(points: pd.DataFrame) -> tuple[ControlChart, ...]:
    """Make a chart of each quantity that was measured on two days.

    Parameters
    ----------
    points : DataFrame
        A row for each quantity of each experiment: ``owner``, ``quantity``, ``chart`` (its specimen, where that
        decides the value), ``is_ratio``, ``unit``, ``recorded`` (ISO day), ``session``, ``operator``, ``record``,
        ``specimen``, ``value`` and ``u`` (SI).
    """
    grouped = points.groupby(["owner", "quantity", "chart"], sort=False) if len(points) else ()
    made = [_chart(own) for _, own in grouped if own["recorded"].nunique() > 1]
    made = [replace(c, is_drifting=c.p < RARE / len(made)) for c in made]
    return tuple(sorted(made, key=lambda c: (not c.is_ratio, c.owner, c.p if math.isfinite(c.p) else 1.0)))


def _chart(own: pd.DataFrame) -> ControlChart:
    """Make a chart of the values of one quantity, an experiment each."""
    from scipy.stats import linregress

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
    groups = dict(_groups(own, table, slope * elapsed if p < RARE else 0.0 * elapsed))
    about = (first["owner"], title, first["unit"], bool(first["is_ratio"]))
    return ControlChart(*about, table, float(value.mean()), sigma, u, slope, p, groups)


def _elapsed(days: pd.Series[str]) -> Floats:
    dates = days.to_numpy("datetime64[D]")
    return np.asarray((dates - dates[0]).astype(float))


def _groups(
    own: pd.DataFrame, table: pd.DataFrame, line: Floats
) -> Iterator[tuple[str, tuple[float, dict[str, float]]]]:
    """Compare the means of groups: sessions by record and operator, experiments by specimen within their session.

    The drift is taken off before operators are compared.
    """
    from scipy.stats import f_oneway

    within = own["value"] - own["session"].map(table.set_index("session")["value"]) + table["value"].mean()
    sets = {
        "record": (table["record"], table["value"]),
        "operator": (table["operator"], table["value"] - line + line.mean()),
        "specimen": (own["specimen"], within),
    }
    for by, (names, values) in sets.items():
        parts = {str(name): part.to_numpy(float) for name, part in values.groupby(names.to_numpy(), sort=False)}
        if 1 < len(parts) < len(values) and any(np.ptp(part) > 0.0 for part in parts.values()):
            yield by, (float(f_oneway(*parts.values()).pvalue), {n: float(part.mean()) for n, part in parts.items()})
