"""Comparison of a plate vibration with the model: the vibration after an impact, its amplitude."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import xarray as xr

from labpipe import signals
from labpipe.arrays import Floats
from labpipe.variables import described
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
    errors = np.array([_error(a, b) for a, b in zip(measured, theirs, strict=True)])
    bias = np.nanmean(measured - theirs, axis=1)
    return xr.Dataset(
        {
            "measured": (("series", "time"), measured, described("m", "displacement, mean of the repeats")),
            "model": (("series", "time"), theirs, described("m", "simulated displacement")),
            "nrmse": ("series", errors, described("1", "root-mean-square error over the range")),
            "bias": ("series", bias, described("m", "mean of measured minus model")),
        },
        coords={"series": table["series"], "time": model["time"]},
    )


def _error(measured: Floats, theirs: Floats) -> float:
    both = np.isfinite(measured) & np.isfinite(theirs)
    return signals.nrmse(measured[both], theirs[both]) if both.any() else np.nan


def rows(comparison: xr.Dataset, table: xr.Dataset, plate: xr.Dataset, *, settings: PlateVibration) -> Iterator[Row]:
    """Yield the rows of ``compare``."""
    del settings
    for i in range(table.sizes["series"]):
        where: dict[str, Any] = {
            "material": str(table["material"].values[i]),
            "condition": f"{float(table['height'][i]) * 1e3:g} mm",
        }
        n = int(table["n"][i])
        yield row(
            "plate's displacement", "m", n, nrmse=comparison["nrmse"][i], difference=comparison["bias"][i], **where
        )
        scale = float(plate["modal_mass"][i]) / float(plate["mass"])
        measured = float(table["amplitude"][i])
        own = float(plate["u_modal_mass"][i]) / float(plate["modal_mass"][i])
        yield row(
            "amplitude at impact",
            "m",
            n,
            measured=measured,
            u_measured=table["u_amplitude"][i],
            model=measured * scale,
            difference=measured * (1 - scale),
            u_difference=measured * own,
            **where,
        )
