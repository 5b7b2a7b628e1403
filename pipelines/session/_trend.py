"""Quantities of many sessions over time: control charts, drift, and differences between groups.

Followed are the key numbers of every kind, for each specimen, and every check that compares two sizes, as observed over
expected, for each sensor: free-fall acceleration seen by a laser shows the laser's scale, whatever was dropped.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path

import pandas as pd

from labpipe import files
from labpipe.errors import InputError
from labpipe.report import quantity
from pipelines.experiments import KINDS
from pipelines.session._catalogue import CHECKS, open_catalogue
from pipelines.session._catalogue_page import TREND_PAGE
from pipelines.session._catalogue_query import Opened
from pipelines.session._control_chart import Trend, control_charts
from pipelines.session._trend_page import trend_page

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
