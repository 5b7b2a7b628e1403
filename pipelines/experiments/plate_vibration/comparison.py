"""Comparison of a plate vibration with the model: the vibration after an impact, its amplitude."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr

from labpipe import signals
from labpipe.arrays import Floats
from labpipe.variables import described
from pipelines.experiments.plate_vibration.measured import drops_label
from pipelines.experiments.plate_vibration.model import relative_uncertainty
from pipelines.experiments.plate_vibration.settings import PlateVibration
from pipelines.experiments.shared.comparison_rows import Row, row


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
    time = model["time"].values
    curves, first = [], 0
    for count in table["n"].values.astype(int):
        shifted = [
            np.interp(
                time + float(r["blow_time"]), d["time"].values, d["displacement"].values, left=np.nan, right=np.nan
            )
            for d, r in zip(displacement[first : first + count], ringing[first : first + count], strict=True)
        ]
        curves.append(np.mean(shifted, axis=0))
        first += count
    measured = np.array(curves)
    theirs = model["displacement"].values
    both = np.isfinite(measured) & np.isfinite(theirs)
    errors = [signals.nrmse(a[k], b[k]) if k.any() else np.nan for a, b, k in zip(measured, theirs, both, strict=True)]
    bias = np.nanmean(measured - theirs, axis=1)
    return xr.Dataset(
        {
            "measured": (("series", "time"), measured, described("m", "displacement, mean of the repeats")),
            "model": (("series", "time"), theirs, described("m", "simulated displacement")),
            "nrmse": ("series", errors, described("1", "root-mean-square error over the range of the fit")),
            "bias": ("series", bias, described("m", "mean of measured minus model")),
        },
        coords={"series": table["series"], "time": model["time"]},
    )


SERIES = "drop"
"""Begins the names of what one of the drops adds to the plate that all of them find."""


def height_name(settings: PlateVibration, i: int) -> str:
    """Name the height of one of the drops, as an input of the rows."""
    return f"height, {drops_label(settings.drops[i])}"


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
        nrmse, bias, n = comparison["nrmse"][i], comparison["bias"][i], int(table["n"][i])
        yield row("plate's displacement", "m", n, against="plate fitted to it", nrmse=nrmse, difference=bias, **of)
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
        others = [int(j) for j in np.flatnonzero(moves)]
        slopes = {f"{SERIES} {j + 1}": float(-moves[j]) for j in others}
        slopes |= {height_name(settings, j): float(0.5 * moves[j] / settings.drops[j].height.value) for j in others}
        by_others = np.linalg.norm(weights[i] * total)
        yield row(
            "amplitude at impact",
            "m",
            int(table["n"][i]),
            slopes=slopes,
            measured=(amplitude[i], amplitude[i] * of_amplitude[i]),
            model=(expected, expected * np.hypot(by_others, of_height[i])),
            difference=(amplitude[i] - expected, middle * np.hypot(by_others, total[i])),
        )
