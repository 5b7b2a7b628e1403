"""Comparison of a ball drop with the model: displacement, free fall, and the first impacts."""

import json
from collections.abc import Iterator

import numpy as np
import xarray as xr

from labpipe import signals
from labpipe.arrays import Floats
from labpipe.judging import Agreement, along_curve, stretch_means, stretches
from labpipe.variables import variable, with_u
from pipelines.experiments.ball_drop.measured import NOISE
from pipelines.experiments.ball_drop.model import FOLLOWED, path_by_input
from pipelines.experiments.ball_drop.settings import BallDrop
from pipelines.experiments.shared.comparison_rows import (
    IMPACTS,
    Row,
    curve_row,
    curve_table,
    flights,
    moved_by_scatter,
    row,
    with_its_u,
)
from pipelines.experiments.shared.counter_body import floor_under
from pipelines.experiments.shared.drop_model import slopes_of
from pipelines.experiments.shared.fall_checks import GUIDE

RESTITUTION, DURATION = "restitution, impact ", "contact duration, impact "
SCALE = "scale of length (gain and inclination)"
"""Input of the rows in addition to those of the model: the laser's gain and inclination together."""


def comparison(
    repeats: xr.Dataset, model: xr.Dataset, plate: xr.Dataset | None = None, *, settings: BallDrop
) -> xr.Dataset:
    """Compare the mean of the repeats with the model, both from first contact.

    An impact is measured by a fit that expects the pulse of polymers in general. The model's own impacts are fitted
    in the same way, so that the departure of its pulse from the expected one is in both.
    """
    first = float(model["impact_time"][0])
    since = model["time"].values - first
    time = repeats["time"].sel(time=slice(since[0], since[-1])).values
    path, laid = repeats["displacement_mean"].sel(time=time), np.interp(time, since, model["displacement"].values)
    left = path.values - laid
    curve = (_along(repeats.sel(time=time), model, since, left), signals.nrmse(path, laid), float(np.nanmean(left)))
    table = curve_table((), [curve], "m")
    table["residual"] = variable("time", left, "m", "measured minus model: displacement")
    made = xr.Dataset(table, coords={"time": path["time"]})

    count = min(repeats.sizes["impact"], model.sizes["impact"], FOLLOWED)
    shown = min(IMPACTS, count)
    interval = float(np.median(np.diff(repeats["time"])))
    gravity = settings.model.gravity.value
    every = max(1, round(interval / float(model["time"][1] - model["time"][0])))
    seen = signals.as_fitted(
        model["displacement"][::every],
        np.append(model["impact_time"].values, float(model["final_contact_time"]))[: shown + 1],
        np.append(model["contact_duration"].values, np.nan)[: shown + 1],
        shown,
        noise=repeats.attrs["noise"],
        gravity=gravity,
        u_gravity=float(repeats.get("u_fall_acceleration", GUIDE * gravity)),
        contact=settings.analysis.contact,
        floor=floor_under(settings.plate, plate, settings.sphere.mass),
    ).reindex(impact=np.arange(1, count + 1))
    made = made.merge(seen.rename({name: f"seen_{name}" for name in seen.data_vars}))

    # restitutions from the same fit to both, so that the shape of its pulse cancels
    fitted = seen["restitution"].values
    simulated = np.where(np.isfinite(fitted), fitted, model["restitution"].values[:count])
    without = _without_shape(repeats, "restitution")[:count]
    u_seen = np.where(np.isfinite(fitted), without, repeats["u_restitution"].values[:count])
    touched, u_touched = model["impact_time"].values[:count] - first, repeats["u_touch_time"].values[:count]
    for name, of_model, theirs, own in (
        ("restitution", "restitution", simulated, u_seen),
        ("touch_time", "impact_time", touched, u_touched),
    ):
        gap, u = repeats[name].values[:count] - theirs, np.hypot(own, model[f"u_{of_model}"].values[:count])
        units, text = str(repeats[name].attrs["units"]), f"{name}, measured minus model"
        made = made.assign(with_u(f"{name}_difference", "impact", gap, u, units, text))
    return made


def foreseen(model: xr.Dataset, lost: float = 0.03, turned: float = 0.25) -> int:
    """Return the number of first impacts whose times a simulated drop gives well enough to propagate uncertainties.

    Effects of the inputs are not linear from an uncertainty of the time on that is the ``lost`` part of the flight
    before, or by which the plate has ``turned`` [rad] in its oscillation: at twice 0.25 rad its speed leaves the
    tangent by an eighth of its amplitude, which moves the next apex by about its uncertainty.
    """
    touches, u = (model[name].values[:FOLLOWED] for name in ("impact_time", "u_impact_time"))
    plate = json.loads(model.attrs["plate"])
    phase = 0.0 * u if plate is None else 2.0 * np.pi * plate["frequency"] * u
    beyond = np.flatnonzero((u > lost * np.diff(touches, prepend=0.0)) | (phase > turned))
    return int(beyond[0]) if beyond.size else FOLLOWED


def _along(repeats: xr.Dataset, model: xr.Dataset, since: Floats, left: Floats) -> Agreement | None:
    """Compare fall and flights with the model, each in a few stretches."""
    known = slice(foreseen(model))
    touches = model["impact_time"].values[known] - float(model["impact_time"][0])
    leaves = touches + model["contact_duration"].values[known]
    time, path = repeats["time"].values, model["displacement"].values
    places = flights(time, touches, leaves, float(since[0]))
    if not places:
        return None
    means, own = stretches(left, places)
    relative, u_touch = float(repeats.attrs["u_systematic_relative"]), float(repeats["u_touch_time"][0])
    # a touch that is taken too late has its level too low
    later = np.interp(time, since, np.gradient(path, since))
    touched = u_touch * (later + float(model["impact_speed"][0]))
    shared = [relative * np.interp(time, since, path), touched]
    shared += [np.interp(time, since, one) for one in path_by_input(model)]
    n = repeats.sizes["repeat"]
    if n > 1:
        freedom = max(n, 4) - 1  # fewer have no variance of Student's distribution
        wider = np.sqrt(freedom / (freedom - 2))
        apart = (repeats["displacement"] - repeats["displacement"].mean("repeat", skipna=False)).values
        shared += list(apart * wider / np.sqrt(n * (n - 1)))
        sd = repeats["touch_time_sd"].values * wider / np.sqrt(n)
        shared += moved_by_scatter(time, repeats["touch_time"].values, sd, later)
    return along_curve(means, own, stretch_means(shared, places))


def _without_shape(repeats: xr.Dataset, name: str) -> Floats:
    """Return the standard uncertainty (impact,) without the shape of the pulse, which the model's fit shares."""
    of_shape = [i for i, text in enumerate(repeats["unknown"].values.tolist()) if not text.startswith(NOISE)]
    shape = np.nansum(repeats.variables[f"common_{name}"].values[:, of_shape] ** 2, axis=1)
    return np.asarray(np.sqrt(np.maximum(repeats.variables[f"u_{name}"].values ** 2 - shape, 0.0)))


def rows(comparison: xr.Dataset, repeats: xr.Dataset, model: xr.Dataset, *, settings: BallDrop) -> Iterator[Row]:
    """Yield the rows of ``compare``: the curve, the free fall, and the results of each impact."""
    n = int(repeats.sizes["repeat"])
    yield curve_row("displacement", "m", n, comparison)
    if "fall_acceleration" in repeats:
        seen, u = (float(repeats[f"{u}fall_acceleration"]) for u in ("", "u_"))
        title, gravity = "acceleration of the free fall", settings.model.gravity
        yield row(title, "m/s2", n, slopes={SCALE: seen}, measured=(seen, u), model=tuple(gravity[:2]))
    count, known = min(IMPACTS, comparison.sizes["impact"]), foreseen(model)
    shown = [(f"{RESTITUTION}{i + 1}", "restitution", "restitution", i) for i in range(count)]
    shown += [(f"{DURATION}{i + 1}", "contact_duration", "contact_duration", i) for i in range(count)]
    if count:
        shown += [("speed of the first impact", "incoming_speed", "impact_speed", 0)]
        shown += [("penetration of the first impact", "penetration", "penetration", 0)]
    for title, ours, theirs, i in shown:
        unit = str(repeats.variables[ours].attrs["units"])
        measured, u_measured = with_its_u(repeats, ours, i)
        is_foreseen = theirs != "restitution" or i < known  # which goes with the plate's speed
        expected, u_expected = with_its_u(model, theirs, i)
        u_apart, seen = u_measured, float(comparison[f"seen_{ours}"].values[i])
        if np.isfinite(seen):
            expected, u_apart = seen, float(_without_shape(repeats, ours)[i])
        slopes = slopes_of(model, theirs, i)
        if unit in ("m", "m/s"):
            slopes[SCALE] = measured
        # the noise of an impact is common to all that is measured of it
        slopes |= {
            f"impact {i + 1}, {text}": float(by)
            for text, by in zip(repeats["unknown"].values.tolist(), repeats[f"common_{ours}"].values[i], strict=True)
            if text.startswith(NOISE) and np.isfinite(by)
        }
        yield row(
            title,
            unit,
            int(repeats["n_repeats"][i]),
            slopes=slopes,
            simulated=(theirs, i),
            measured=(measured, u_measured),
            model=(expected, u_expected) if is_foreseen else None,
            u_difference=np.hypot(u_apart, u_expected),
        )
