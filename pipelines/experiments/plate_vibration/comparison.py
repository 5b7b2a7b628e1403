"""Comparison of a plate vibration with the model: the vibration after an impact, its amplitude."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import xarray as xr

from labpipe import signals
from labpipe.arrays import Floats
from labpipe.units import Quantity
from labpipe.variables import described
from pipelines.experiments.plate_vibration.measured import drops_label
from pipelines.experiments.plate_vibration.model import of_solids, relative_uncertainty
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
            "u_model": model["u_displacement"].variable,
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
    """Predict every amplitude from the plate that the other drops find.

    The plate's mass comes from the amplitudes themselves; only the mass that the others give is
    independent of an amplitude that it is to predict.

    Returns
    -------
    predicted : array (series,)
        Amplitudes [m]; NaN where there are no others.
    weights : array (series, series)
        Of each other drop in the mass that a prediction stands on; rows sum to 1.
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


def by_solids(plate: xr.Dataset, weights: Floats) -> dict[str, tuple[Quantity, Floats]]:
    """Return what is uncertain of the solids, and the relative change (series,) of the predictions per unit.

    Weights are those of :func:`from_others`: what two drops share cancels in the prediction of one by the other.
    """
    return {name: (given, slope - weights @ slope) for name, (given, slope) in of_solids(plate).items()}


def rows(comparison: xr.Dataset, table: xr.Dataset, plate: xr.Dataset, *, settings: PlateVibration) -> Iterator[Row]:
    """Yield the rows of ``compare``: the curve against its fit, the amplitude against the other drops."""
    predicted, weights = from_others(table, plate)
    amplitude = table["amplitude"].values
    own = relative_uncertainty(table, settings)
    solids = by_solids(plate, weights)
    for i in range(table.sizes["series"]):
        where: dict[str, Any] = {
            "material": str(table["material"].values[i]),
            "condition": f"{float(table['height'][i]) * 1e3:g} mm",
        }
        n = int(table["n"][i])
        nrmse, bias = comparison["nrmse"][i], comparison["bias"][i]
        yield row("plate's displacement", "m", n, against="plate fitted to it", nrmse=nrmse, difference=bias, **where)
        if not np.isfinite(predicted[i]):
            continue
        moves = -predicted[i] * (np.eye(amplitude.size)[i] - weights[i])
        slopes = {f"{SERIES} {j + 1}": float(-move) for j, move in enumerate(moves) if move}
        slopes |= {
            height_name(settings, j): float(0.5 * move / settings.drops[j].height.value)
            for j, move in enumerate(moves)
            if move
        }
        slopes |= {name: float(-predicted[i] * slope[i]) for name, (_, slope) in solids.items() if slope[i]}
        solid = [float(predicted[i] * slope[i] * given.u) for given, slope in solids.values()]
        by_others = float(np.hypot(predicted[i] * np.linalg.norm(weights[i] * own.total), np.linalg.norm(solid)))
        by_own = float(predicted[i] * own.total[i])
        yield row(
            "amplitude at impact",
            "m",
            n,
            slopes=slopes,
            measured=(amplitude[i], amplitude[i] * own.amplitude[i]),
            model=(predicted[i], np.hypot(by_others, predicted[i] * own.height[i])),
            difference=(amplitude[i] - predicted[i], np.hypot(by_others, by_own)),
            **where,
        )
