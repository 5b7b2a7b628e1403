"""Comparison of a plate vibration with the model: the vibration after an impact, its amplitude."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr

from labpipe import signals
from labpipe.arrays import Floats
from labpipe.variables import variable
from pipelines.experiments.plate_vibration.measured import drops_label
from pipelines.experiments.plate_vibration.model import relative_uncertainty
from pipelines.experiments.plate_vibration.settings import PlateVibration
from pipelines.experiments.shared.comparison_rows import Row, curve_row, curve_table, row

SERIES, HEIGHT = "drop {}", "height, {}"
"""Inputs of the rows: what one of the drops, by its number, adds to the plate that all find, and its height."""


def comparison(
    displacement: list[xr.Dataset],
    ringing: list[xr.Dataset],
    table: xr.Dataset,
    model: xr.Dataset,
    *,
    settings: PlateVibration,
) -> xr.Dataset:
    """Compare the mean of the repeats with the simulation, each counted from its blow."""
    del settings
    time, remaining = model["time"].values, iter(zip(displacement, ringing, strict=True))
    curves = []
    for count in table["n"].values.astype(int):
        repeats = [next(remaining) for _ in range(count)]
        shifted = [
            np.interp(time + float(r["blow_time"]), d["time"], d["displacement"], left=np.nan, right=np.nan)
            for d, r in repeats
        ]
        curves.append(np.mean(shifted, axis=0))
    measured = np.array(curves)
    theirs = model["displacement"].values
    compared = [
        (None, signals.nrmse(a, b), float(np.nanmean(a - b))) if np.isfinite(a - b).any() else (None, np.nan, np.nan)
        for a, b in zip(measured, theirs, strict=True)
    ]
    return xr.Dataset(
        {
            "measured": variable(("series", "time"), measured, "m", "displacement, mean of the repeats"),
            "model": variable(("series", "time"), theirs, "m", "simulated displacement"),
        }
        | curve_table("series", compared, "m"),
        coords={"series": table["series"], "time": model["time"]},
    )


def from_others(table: xr.Dataset, plate: xr.Dataset) -> tuple[Floats, Floats]:
    """Return amplitudes [m] (series,) on the plate that the other drops find, NaN without others, and their weights.

    Only the mass that others give is independent of an amplitude that it is to predict. The weights (series, series)
    of the others in that mass sum to 1 in each row.
    """
    amplitude = table["amplitude"].values
    each = plate["modal_mass"].values if "modal_mass" in plate else np.full(amplitude.size, np.nan)
    known = np.isfinite(each)
    weights = np.zeros((amplitude.size, amplitude.size))
    if known.sum() < 2:
        return np.full(amplitude.size, np.nan), weights
    weight = np.where(known, (each / plate["u_modal_mass"].values) ** 2, 0.0)
    for i in np.flatnonzero(known):
        weights[i] = np.where(np.arange(amplitude.size) == i, 0.0, weight)
        weights[i] /= weights[i].sum()
    # mean of logarithms: a factor in one of them moves all by known powers of it
    logs = np.log(np.where(known, each, 1.0))
    return np.where(known, amplitude * np.exp(logs - weights @ logs), np.nan), weights


def rows(comparison: xr.Dataset, table: xr.Dataset, plate: xr.Dataset, *, settings: PlateVibration) -> Iterator[Row]:
    """Yield the rows of ``compare``: the curve against its fit, the amplitude against the other drops."""
    for i, amplitude in enumerate(amplitudes(table, plate, settings)):
        of: dict[str, Any] = {
            "material": str(table["material"].values[i]),
            "condition": f"{float(table['height'][i]) * 1e3:g} mm",
        }
        own, n = comparison.isel(series=i), int(table["n"][i])
        yield curve_row("plate's displacement", "m", n, own, against="plate fitted to it", **of)
        if amplitude is not None:
            yield replace(amplitude, **of)


def amplitudes(table: xr.Dataset, plate: xr.Dataset, settings: PlateVibration) -> Iterator[Row | None]:
    """Yield the row of each drop's amplitude against the plate that the others find; None where there are no others."""
    predicted, weights = from_others(table, plate)
    amplitude, (of_amplitude, of_height) = table["amplitude"].values, relative_uncertainty(table, settings)
    total = np.hypot(of_amplitude, of_height)
    for i, expected in enumerate(predicted):
        if not np.isfinite(expected):
            yield None
            continue
        # effects are factors: seen from the geometric mean, two drops that predict each other differ by as much
        middle = float(np.sqrt(amplitude[i] * expected))
        moves = -middle * (np.eye(amplitude.size)[i] - weights[i])
        slopes = {}
        for j in map(int, np.flatnonzero(moves)):
            drops = settings.drops[j]
            slopes[SERIES.format(j + 1)] = float(-moves[j])
            slopes[HEIGHT.format(drops_label(drops))] = float(0.5 * moves[j] / drops.height.value)
        by_others = np.linalg.norm(weights[i] * total)
        yield row(
            "amplitude at impact",
            "m",
            int(table["n"][i]),
            slopes=slopes,
            measured=(amplitude[i], amplitude[i] * of_amplitude[i]),
            model=(expected, expected * np.hypot(by_others, of_height[i])),
            u_difference=middle * np.hypot(by_others, total[i]),
        )
