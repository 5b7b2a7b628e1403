"""Comparison of a ball drop with the model: displacement and restitution."""

from collections.abc import Iterator
from math import hypot
from typing import Any

import numpy as np
import xarray as xr

from labpipe import signals
from labpipe.arrays import Floats
from labpipe.variables import variable
from pipelines.experiments.ball_drop._curve import along
from pipelines.experiments.ball_drop._model_uncertainty import FOLLOWED
from pipelines.experiments.ball_drop.measured import NOISE
from pipelines.experiments.ball_drop.settings import BallDrop
from pipelines.experiments.shared.comparison_rows import IMPACTS, Row, curve_table, of_curve, row
from pipelines.experiments.shared.plate_under_drop import floor_under

RESTITUTION, DURATION = "restitution, impact ", "contact duration, impact "
SCALE = "scale of length (gain and inclination)"
"""Input of the rows beside those of the model: the laser's gain and inclination together."""
_U_GRAVITY = 0.01
"""m/s2; where the record tells no acceleration of the fall."""


def comparison(
    repeats: xr.Dataset, model: xr.Dataset, plate: xr.Dataset | None = None, *, settings: BallDrop
) -> xr.Dataset:
    """Lay the model over the mean of the repeats, both from first contact, and measure the gap.

    What an impact shows is found by a fit that expects the pulse of polymers in general. The model's own impacts
    are fitted alike, so that what its pulse departs from that by is in both.
    """
    first = float(model["impact_time"][0])
    since = model["time"].values - first
    window = repeats["time"].where((repeats["time"] >= since[0]) & (repeats["time"] <= since[-1]))
    time = window.dropna("time").values
    measured = repeats["displacement_mean"].sel(time=time)
    simulated = np.interp(time, since, model["displacement"].values)
    curves = signals.compare(measured, measured.copy(data=simulated))
    seen = _seen(repeats, model, floor_under(settings.plate, plate, settings.sphere.mass), settings)
    found = along(repeats.sel(time=time), model, since, curves["residual"].values)
    return curves.assign(curve_table((), [found])).merge(_bounces_compared(repeats, model, seen, first))


def _seen(repeats: xr.Dataset, model: xr.Dataset, floor: signals.Floor | None, settings: BallDrop) -> xr.Dataset:
    """Return the model's first impacts as the analysis finds them (``impact``), NaN where it was not asked."""
    count = min(repeats.sizes["impact"], model.sizes["impact"], FOLLOWED)
    compared = min(IMPACTS, count)
    interval = float(np.median(np.diff(repeats["time"])))
    every = max(1, round(interval / float(model["time"][1] - model["time"][0])))
    found = signals.as_fitted(
        model["displacement"][::every],
        np.append(model["impact_time"].values, float(model["final_contact_time"]))[: compared + 1],
        np.append(model["contact_duration"].values, np.nan)[: compared + 1],
        compared,
        noise=repeats.attrs["noise"],
        gravity=settings.model.gravity.value,
        u_gravity=float(repeats.get("u_fall_acceleration", _U_GRAVITY)),
        contact=settings.analysis.contact,
        floor=floor,
    )
    return found.reindex(impact=np.arange(1, count + 1)).rename({name: f"seen_{name}" for name in found.data_vars})


def _bounces_compared(repeats: xr.Dataset, model: xr.Dataset, seen: xr.Dataset, first: float) -> xr.Dataset:
    count = seen.sizes["impact"]
    fitted = seen["seen_restitution"].values
    is_fitted = np.isfinite(fitted)
    theirs, ours = model["restitution"].values[:count], repeats["u_restitution"].values[:count]
    pairs = {
        "restitution": (
            np.where(is_fitted, fitted, theirs),
            np.where(is_fitted, without_shape(repeats, "restitution")[:count], ours),
            model["u_restitution"],
        ),
        "touch_time": (
            model["impact_time"].values[:count] - first,
            repeats["u_touch_time"].values[:count],
            model["u_impact_time"],
        ),
    }
    table: dict[str, Any] = {}
    for name, (b, u_ours, u_theirs) in pairs.items():
        units = repeats[name].attrs["units"]
        a = repeats[name].values[:count]
        u = np.hypot(u_ours, u_theirs.values[:count])
        for key, values, text in (
            (f"{name}_measured", a, "measured"),
            (f"{name}_model", b, "model"),
            (f"{name}_difference", a - b, "measured minus model"),
        ):
            table[key] = variable("impact", values, units, f"{name}, {text}")
        table[f"u_{name}_difference"] = variable("impact", u, units, f"standard uncertainty: {name} difference")
    return xr.Dataset(table, coords={"impact": np.arange(1, count + 1)}).merge(seen)


def without_shape(repeats: xr.Dataset, name: str) -> Floats:
    """Return the standard uncertainty (impact,) without the shape of the pulse, which the model's fit shares."""
    of_shape = [i for i, text in enumerate(repeats["unknown"].values.tolist()) if not text.startswith(NOISE)]
    shape = np.nansum(repeats.variables[f"common_{name}"].values[:, of_shape] ** 2, axis=1)
    return np.asarray(np.sqrt(np.maximum(repeats.variables[f"u_{name}"].values ** 2 - shape, 0.0)))


def rows(comparison: xr.Dataset, repeats: xr.Dataset, model: xr.Dataset, *, settings: BallDrop) -> Iterator[Row]:
    """Yield the rows of ``compare``: the curve, the free fall, and what each impact shows."""
    n = int(repeats.sizes["repeat"])
    relative = float(repeats.attrs["u_systematic_relative"])
    mean_size = float(np.abs(repeats["displacement_mean"]).mean())
    bias, u, told = comparison["bias"], relative * mean_size, of_curve(comparison)
    yield row("displacement", "m", n, nrmse=comparison["nrmse"], difference=bias, u_difference=u, **told)
    if "fall_acceleration" in repeats:
        seen, u, gravity = repeats["fall_acceleration"], float(repeats["u_fall_acceleration"]), settings.model.gravity
        yield row(
            "acceleration of the free fall",
            "m/s2",
            n,
            slopes={SCALE: float(seen)},
            measured=(seen, u),
            model=(gravity.value, gravity.u),
            difference=(float(seen) - gravity.value, np.hypot(u, gravity.u)),
        )
    shown = min(IMPACTS, comparison.sizes["impact"])
    for i in range(shown):
        yield _event(f"{RESTITUTION}{i + 1}", "1", ("restitution",) * 2, i, repeats, model, comparison)
    for i in range(shown):
        names = ("contact_duration",) * 2
        yield _event(f"{DURATION}{i + 1}", "s", names, i, repeats, model, comparison)
    if shown:
        for title, unit, names in (
            ("speed of the first impact", "m/s", ("incoming_speed", "impact_speed")),
            ("penetration of the first impact", "m", ("penetration",) * 2),
        ):
            yield _event(title, unit, names, 0, repeats, model, comparison, is_length=True)


def common(repeats: xr.Dataset, name: str, impact: int) -> dict[str, float]:
    """Return what the noise of an impact, common to several rows, adds to a measured value by its deviations."""
    values = repeats.variables[f"common_{name}"].values[impact]
    return {
        f"impact {impact + 1}, {text}": float(value)
        for text, value in zip(repeats["unknown"].values.tolist(), values, strict=True)
        if text.startswith(NOISE) and np.isfinite(value)
    }


def _event(
    title: str,
    unit: str,
    names: tuple[str, str],
    impact: int,
    repeats: xr.Dataset,
    model: xr.Dataset,
    comparison: xr.Dataset,
    *,
    is_length: bool = False,
) -> Row:
    """Return one row; `names` are its variable in the repeats and in the model."""
    ours, theirs = names
    measured, u_measured = (float(repeats.variables[name].values[impact]) for name in (ours, f"u_{ours}"))
    expected, u_expected = (float(model.variables[name].values[impact]) for name in (theirs, f"u_{theirs}"))
    u_apart, seen = u_measured, float(comparison.variables[f"seen_{ours}"].values[impact])
    if np.isfinite(seen):
        expected, u_apart = seen, float(without_shape(repeats, ours)[impact])
    if f"swing_{theirs}" in model:
        u_apart = hypot(u_apart, float(np.nan_to_num(model.variables[f"swing_{theirs}"].values[impact])))
    inputs, changes = model.variables["slope_input"].values, model.variables[f"slope_{theirs}"].values[:, impact]
    slopes = {str(name): -float(slope) for name, slope in zip(inputs, changes, strict=True) if np.isfinite(slope)}
    if is_length:
        slopes[SCALE] = measured
    slopes |= common(repeats, ours, impact)
    return row(
        title,
        unit,
        int(repeats["n_repeats"][impact]),
        slopes=slopes,
        measured=(measured, u_measured),
        model=(expected, u_expected),
        difference=(measured - expected, np.hypot(u_apart, u_expected)),
    )
