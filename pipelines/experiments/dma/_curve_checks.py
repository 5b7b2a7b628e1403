"""Checks of the master curve: order of its shifts, superposition, the published table."""

import json
from dataclasses import replace

import numpy as np
import xarray as xr

from labpipe.judging import Check, Level, bounded, in_words, not_made, stated

_RISE = 0.3  # decades of shift that hysteresis and ageing explain
_FOREIGN, _TORN = 0.25, 1.5
"""Share of the span of the shifts by which a table may differ, and times that residuals may grow:
batches and laboratories differ by less than that share, polymers by more; where readings hardly
tell the shifts, as of broad relaxations, a wrong table tears them little."""
_APART = "the material has two processes, or the specimen, its clamping or its temperature changed between sweeps"


def superposition(curve: xr.Dataset | None) -> Check:
    """Hand on the verdict of the master curve: a material may defy it, the predictions then do as well."""
    name = "superposition"
    if curve is None:
        return not_made(name, "a master curve of several temperatures")
    verdict = json.loads(curve.attrs["superposition"])
    level: Level | None = {"pass": None, "doubtful": "note", "fail": "doubtful"}[verdict["level"]]
    noise = json.loads(curve.attrs["noise"])
    storage, loss = (in_words(100 * noise[name], 2) for name in ("storage", "loss"))
    fit = f"the master curve misses E′ by {storage} % and E″ by {loss} %"
    return stated(name, verdict["reasons"][0] if verdict["reasons"] else fit, level, cause=_APART)


def order_of_shifts(curve: xr.Dataset | None) -> Check:
    name = "order of the shifts"
    if curve is None or curve.sizes["temperature"] < 2:
        return not_made(name, "a master curve of two temperatures")
    T, shift = curve["temperature"].values, curve["log10_aT"].values
    u = curve["u_log10_aT"].values
    rise, own = np.diff(shift), np.hypot(u[1:], u[:-1])
    known = np.isfinite(rise) & np.isfinite(own) & (own > 0)
    if not known.any():
        return not_made(name, "shifts with uncertainties")
    margin = np.where(known, rise / np.where(known, own, 1.0), -np.inf)
    at = int(np.argmax(np.where(rise > _RISE, margin, -np.inf))) if (rise > _RISE).any() else int(np.argmax(margin))
    text = f"log10 a_T changes by {rise[at]:+.2f} from {T[at]:.1f} to {T[at + 1]:.1f} °C"
    found = bounded(name, text, float(rise[at]), float(own[at]), at_most=0.0)
    if rise[at] < _RISE and found.level:
        return replace(found, level="doubtful" if rise[at] > 0.5 * _RISE else None)
    cause = f"the isotherm at {T[at]:.1f} or {T[at + 1]:.1f} °C has a wrong temperature or is of another specimen"
    return replace(found, cause=cause)


def published_shifts(published: xr.Dataset | None, curve: xr.Dataset | None) -> Check:
    """Hold a published table against the readings: shifts of another material tear them apart."""
    name = "published shifts"
    if published is None or curve is None or "difference" not in published:
        return not_made(name, "a published table of shifts")
    known = np.isfinite(published["difference"].values)
    fitted, other = published["fitted"].values[known], published["published"].values[known]
    span, theirs = float(np.ptp(fitted)), float(np.ptp(other))
    apart = float(np.sqrt(np.mean(published["difference"].values[known] ** 2)))
    own = float(np.sqrt(np.nanmean(curve["storage_residual"].values ** 2)))
    worse = float(published.attrs["residual_storage"]) / max(own, 1e-6)
    text = (
        f"the table shifts by {theirs:.1f} decades where the readings shift by {span:.1f}, {apart:.1f} apart (rms); "
        f"with its shifts the readings miss their curve {worse:.1f} times as far"
    )
    is_foreign = apart > _FOREIGN * span and worse > _TORN
    cause = "the table is of another material, or of another state of it"
    return stated(name, text, "doubtful" if is_foreign else None, cause=cause, setting="published.shifts")
