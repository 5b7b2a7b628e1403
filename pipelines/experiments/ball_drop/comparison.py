"""Comparison of a ball drop with the model: displacement and restitution."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import xarray as xr

from labpipe import signals
from labpipe.variables import variable
from pipelines.experiments.ball_drop.measured import NOISE
from pipelines.experiments.ball_drop.model import FOLLOWED
from pipelines.experiments.ball_drop.settings import BallDrop
from pipelines.experiments.shared.comparison_rows import IMPACTS, Row, row

RESTITUTION, DURATION = "restitution, impact ", "contact duration, impact "
SCALE = "scale of length (gain and inclination)"
"""Input of the rows beside those of the model: the laser's gain and inclination together."""


def comparison(repeats: xr.Dataset, model: xr.Dataset, *, settings: BallDrop) -> xr.Dataset:
    """Lay the model over the mean of the repeats, both from first contact, and measure the gap."""
    del settings
    first = float(model["impact_time"][0])
    since = model["time"].values - first
    window = repeats["time"].where((repeats["time"] >= since[0]) & (repeats["time"] <= since[-1]))
    time = window.dropna("time").values
    measured = repeats["displacement_mean"].sel(time=time)
    simulated = np.interp(time, since, model["displacement"].values)
    curves = signals.compare(measured, measured.copy(data=simulated))
    return curves.merge(_bounces_compared(repeats, model, first))


def _bounces_compared(repeats: xr.Dataset, model: xr.Dataset, first: float) -> xr.Dataset:
    count = min(repeats.sizes["impact"], model.sizes["impact"], FOLLOWED)
    pairs = {
        "restitution": (repeats["restitution"], model["restitution"], model["u_restitution"], 0.0),
        "touch_time": (repeats["touch_time"], model["impact_time"], model["u_impact_time"], first),
    }
    table: dict[str, Any] = {}
    for name, (ours, theirs, u_theirs, shift) in pairs.items():
        units = ours.attrs["units"]
        a, b = ours.values[:count], theirs.values[:count] - shift
        u = np.hypot(repeats[f"u_{name}"].values[:count], u_theirs.values[:count])
        for key, values, text in (
            (f"{name}_measured", a, "measured"),
            (f"{name}_model", b, "model"),
            (f"{name}_difference", a - b, "measured minus model"),
        ):
            table[key] = variable("impact", values, units, f"{name}, {text}")
        table[f"u_{name}_difference"] = variable("impact", u, units, f"standard uncertainty: {name} difference")
    return xr.Dataset(table, coords={"impact": np.arange(1, count + 1)})


def rows(comparison: xr.Dataset, repeats: xr.Dataset, model: xr.Dataset, *, settings: BallDrop) -> Iterator[Row]:
    """Yield the rows of ``compare``: the curve, the free fall, and what each impact shows."""
    n = int(repeats.sizes["repeat"])
    relative = float(repeats.attrs["u_systematic_relative"])
    mean_size = float(np.abs(repeats["displacement_mean"]).mean())
    bias, u = comparison["bias"], relative * mean_size
    yield row("displacement", "m", n, nrmse=comparison["nrmse"], difference=bias, u_difference=u)
    if "fall_acceleration" in repeats:
        seen, u, gravity = repeats["fall_acceleration"], float(repeats["u_fall_acceleration"]), settings.model.gravity
        yield row(
            "acceleration of the free fall",
            "m/s2",
            n,
            slopes={SCALE: float(seen)},
            measured=seen,
            u_measured=u,
            model=gravity.value,
            u_model=gravity.u,
            difference=float(seen) - gravity.value,
            u_difference=np.hypot(u, gravity.u),
        )
    shown = min(IMPACTS, comparison.sizes["impact"])
    for i in range(shown):
        yield _event(f"{RESTITUTION}{i + 1}", "1", ("restitution",) * 2, i, repeats, model)
    for i in range(shown):
        names = ("contact_duration",) * 2
        yield _event(f"{DURATION}{i + 1}", "s", names, i, repeats, model)
    if shown:
        for title, unit, names in (
            ("speed of the first impact", "m/s", ("incoming_speed", "impact_speed")),
            ("penetration of the first impact", "m", ("penetration",) * 2),
        ):
            yield _event(title, unit, names, 0, repeats, model, is_length=True)


def common(repeats: xr.Dataset, name: str, impact: int) -> dict[str, float]:
    """Return what unknowns that are common to several rows add to a measured value, each by its deviation.

    The shape of the contact's pulse is the same in all impacts, the noise is of one.
    """
    found = repeats[f"common_{name}"][impact]
    return {
        f"impact {impact + 1}, {text}" if text.startswith(NOISE) else f"pulse's {text}": float(value)
        for text, value in zip(found["unknown"].values.tolist(), found.values, strict=True)
        if np.isfinite(value)
    }


def _event(
    title: str,
    unit: str,
    names: tuple[str, str],
    impact: int,
    repeats: xr.Dataset,
    model: xr.Dataset,
    *,
    is_length: bool = False,
) -> Row:
    """Return one row; `names` are its variable in the repeats and in the model."""
    ours, theirs = names
    measured, u_measured = float(repeats[ours][impact]), float(repeats[f"u_{ours}"][impact])
    expected, u_expected = float(model[theirs][impact]), float(model[f"u_{theirs}"][impact])
    slopes = {
        str(name): -float(slope)
        for name, slope in zip(model["slope_input"].values, model[f"slope_{theirs}"].values[:, impact], strict=True)
        if np.isfinite(slope)
    }
    if is_length:
        slopes[SCALE] = measured
    slopes |= common(repeats, ours, impact)
    return row(
        title,
        unit,
        int(repeats["n_repeats"][impact]),
        slopes=slopes,
        measured=measured,
        u_measured=u_measured,
        model=expected,
        u_model=u_expected,
        difference=measured - expected,
        u_difference=np.hypot(u_measured, u_expected),
    )
