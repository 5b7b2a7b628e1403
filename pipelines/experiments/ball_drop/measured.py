"""Ball drop: from laser exports to bounces, and to the mean of the repeats.

Conventions: heights count upwards; a repeat's time 0 is its first contact, its displacement 0 the
level of that contact.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from calibration import laser
from labpipe import signals
from labpipe.arrays import Floats
from labpipe.uncertainty import scatter_beyond
from labpipe.units import Quantity
from labpipe.variables import variable, with_u
from pipelines.experiments.ball_drop.settings import BallDrop
from pipelines.experiments.shared import laser_readings
from pipelines.experiments.shared.counter_body import floor_under
from pipelines.experiments.shared.drop_model import padded

NOISE = "noise"
"""Begins the names of common unknowns that are an impact's own and fall with the number of repeats."""
_SPEEDS = ("incoming_speed", "outgoing_speed")
_LENGTHS = (*_SPEEDS, "penetration")  # that go with the scale of length
_PER_IMPACT = ("restitution", "touch_time", *_LENGTHS, "contact_duration")


def displacement(readings: xr.Dataset, record: Path, *, settings: BallDrop) -> xr.Dataset:
    """Correct the inclination: upward displacement of the holder, with uncertainty."""
    moved = laser_readings.displacement(readings, record, settings=settings)
    if not settings.analysis.inclination_from_height:
        return moved
    # the inclination from the fall of known height, along the line of sight
    along = moved["displacement_raw"] * float(moved["gain"])
    fall = signals.bounces(along, contact=settings.analysis.contact)
    travel = Quantity(float(fall["drop_height"]), float(fall["u_drop_height"]), "m")
    found = laser.inclination_from_drop(travel, settings.height)
    return laser_readings.displacement(readings, record, settings=settings, inclination=found)


def bounces(displacement: xr.Dataset, plate: xr.Dataset | None = None, *, settings: BallDrop) -> xr.Dataset:
    """Find release, contacts and rest; speeds carry the inclination's uncertainty too."""
    floor = floor_under(settings.plate, plate, settings.sphere.mass)
    found = signals.bounces(displacement, contact=settings.analysis.contact, floor=floor)
    relative = float(displacement.attrs["u_systematic_relative"])
    for name in (*_SPEEDS, "drop_height"):
        found[f"u_{name}"].values = np.hypot(found[f"u_{name}"].values, relative * found[name].values)
    return found


def velocity(displacement: xr.Dataset, bounces: xr.Dataset, *, settings: BallDrop) -> xr.Dataset:
    """Differentiate, with knots free to break where contacts begin and end."""
    del settings
    release = float(bounces["release_time"])
    releases = [release] if np.isfinite(release) else []
    found = signals.velocity(displacement, events=bounces, releases=releases)
    return found.reset_coords("u_velocity").assign_attrs(found.attrs)


def repeats(
    displacement: list[xr.Dataset], velocity: list[xr.Dataset], bounces: list[xr.Dataset], *, settings: BallDrop
) -> xr.Dataset:
    """Align the repeats at first contact: mean, band, outliers, and the table of bounces."""
    del settings
    starts = np.array([float(b["first_contact_time"]) for b in bounces])
    shifted = [
        (d["displacement"] - float(b["contact_level"])).assign_attrs(d["displacement"].attrs)
        for d, b in zip(displacement, bounces, strict=True)
    ]
    speeds = signals.combine_repeats([v["velocity"] for v in velocity], starts)
    made = signals.combine_repeats(shifted, starts).merge(speeds.drop_vars(["is_outlier", "n"]))
    relative = float(displacement[0].attrs["u_systematic_relative"])
    random = made["displacement_sd"].values / np.sqrt(np.maximum(made["n"].values, 1))
    u = np.hypot(np.nan_to_num(random), relative * made["displacement_mean"].values)
    made["u_displacement_mean"] = variable("time", u, "m", "standard uncertainty: mean displacement")
    # every bounce over the repeats that show it; touch times since first contact
    count = max(b.sizes["impact"] for b in bounces)

    def of_all(name: str) -> Floats:
        return np.array([padded(b[name].values, count) for b in bounces])

    first, unknown = bounces[0], bounces[0]["unknown"].values
    of_noise = np.char.startswith(unknown.astype(str), NOISE)
    table: dict[str, Any] = {}
    for name in _PER_IMPACT:
        values, own, attrs = of_all(name), of_all(f"u_{name}"), first[name].attrs
        if name == "touch_time":
            values = values - starts[:, None]
        shape = of_all(f"shared_u_{name}") if f"shared_u_{name}" in first else 0.0 * values
        scale = relative * np.nanmean(values, axis=0) * (name in _LENGTHS)
        mean, u, scatter, n = _mean(values, own, np.nanmean(shape**2, axis=0) + scale**2)
        table |= with_u(name, "impact", mean, u, attrs["units"], attrs["long_name"])
        text = f"standard deviation over repeats: {name}"
        table[f"{name}_sd"] = variable("impact", np.where(n > 1, scatter, np.nan), attrs["units"], text)
        if (of_unknowns := f"common_{name}") in first:
            parts = np.nanmean(of_all(of_unknowns), axis=0) / np.where(of_noise, np.sqrt(n)[:, None], 1.0)
            table[of_unknowns] = variable(("impact", "unknown"), parts, attrs["units"], f"by common unknowns: {name}")
    table["n_repeats"] = variable("impact", n, "1", "repeats that show the bounce")
    made = made.merge(xr.Dataset(table, coords={"impact": np.arange(1, count + 1), "unknown": unknown}))
    # of the acceleration of the free fall scale and clock are those of all repeats
    g, own = (np.array([float(b[f"{u}fall_acceleration"]) for b in bounces]) for u in ("", "u_"))
    known = np.isfinite(g) & np.isfinite(own)
    if known.any():
        mean_g, u_g, *_ = map(float, _mean(g[known], own[known], 0.0))
        clock = float(json.loads(displacement[0].attrs["time_base"])["u_relative"])
        u_g = float(np.linalg.norm([u_g, mean_g * relative, 2 * mean_g * clock]))
        made = made.assign(with_u("fall_acceleration", (), mean_g, u_g, "m/s2", "acceleration of the free fall"))
    noise = float(np.mean([b.attrs["noise"] for b in bounces]))
    made.attrs = {"u_systematic_relative": relative, "noise": noise}
    return made


def _mean(values: Floats, own: Floats, shared: Floats | float) -> tuple[Floats, Floats, Floats, Floats]:
    """Return mean, its u, scatter and number of repeats (repeat, …); ``own`` contain the common variance ``shared``."""
    n, mean = np.isfinite(values).sum(axis=0), np.nanmean(values, axis=0)
    scatter = np.sqrt(np.nansum((values - mean) ** 2, axis=0) / np.maximum(n - 1, 1))
    stated = np.sqrt(np.maximum(np.nanmean(own**2, axis=0) - shared, 0.0))
    apart = np.hypot(stated, scatter_beyond(scatter, stated, n)) / np.sqrt(n)
    return mean, np.hypot(apart, np.sqrt(shared)), scatter, n
