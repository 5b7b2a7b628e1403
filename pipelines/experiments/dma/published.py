"""Comparison of shift factors with a published table."""

import warnings
from pathlib import Path

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from labpipe import materials
from labpipe.arrays import Floats
from labpipe.errors import SourceError
from labpipe.variables import variable
from pipelines.experiments.dma import _shift_tables as shift_tables
from pipelines.experiments.dma.settings import Dma

_LEAST_SHARED = 2
_LEVELS_COUNT = 1e-9  # levels that were not fitted are exactly one


def compared(sweeps: xr.Dataset, master_curve: xr.Dataset, shifts: Path | None, *, settings: Dma) -> xr.Dataset:
    """Compare the fitted shifts with a published table, over ``temperature``.

    The published shifts are taken at the measured temperatures, relative to the reference of the
    master curve. They are also imposed on the sweeps, everything else fitted as before: what
    residuals they leave says whether the readings speak for them.
    """
    if shifts is None:
        return xr.Dataset(attrs={"absent": "no published shifts were given"})
    table = shift_tables.read(shifts, settings)
    T, T_ref = master_curve["temperature"].values, float(master_curve["T_ref"])
    published = shift_tables.at(table, T) - shift_tables.at(table, np.array([T_ref]))
    known = np.isfinite(published) & np.isfinite(master_curve["log10_aT"].values)
    if known.sum() < _LEAST_SHARED:
        raise SourceError(
            shifts,
            f"the table holds {table[0].size} temperatures; it shares fewer than "
            f"{_LEAST_SHARED} with the sweeps, or T_ref = {T_ref:g} °C lies outside",
            hint="Compare tables of the same temperatures, or choose T_ref within the table.",
        )
    kept = sweeps.isel(temperature=np.flatnonzero(known))
    imposed = _imposed(kept, published[known], master_curve, settings)
    found = _over_temperature(master_curve, published, known, imposed)
    order = np.argsort(table[1], kind="stable")
    zero = float(np.interp(0.0, table[1][order], table[0][order]))
    found.attrs = {
        "published_source": settings.published.source if settings.published else "",
        "published_file": shifts.name,
        "published_zero": zero,
        "published_at_reference": float(shift_tables.at(table, np.array([T_ref]))[0]),
        "residual_storage": rms(imposed["storage_residual"].values),
        "residual_loss": rms(imposed["loss_residual"].values),
        "temperature_distance": float(np.max(np.min(np.abs(table[0][None, :] - T[known][:, None]), axis=1))),
    }
    return found


def _imposed(sweeps: xr.Dataset, published: Floats, curve: xr.Dataset, settings: Dma) -> xr.Dataset:
    """Fit spectrum, vertical law, levels and delay as they were chosen, with published shifts."""
    noise = settings.fit.noise_ratio
    with warnings.catch_warnings(action="ignore", category=UserWarning):  # they were said of the fit itself
        made = materials.master_curve(
            sweeps,
            float(curve["T_ref"]),
            vertical=str(curve.attrs["vertical_law"]),  # type: ignore[arg-type]
            delay=bool(float(curve["delay"])),
            levels=bool(np.nanmax(np.abs(curve["level"].values - 1.0)) > _LEVELS_COUNT),
            robust=settings.fit.robust,
            noise_ratio=noise,
            shifts=published,
            refine=False,
            nu=settings.nu.value,
        )
    return made.data


def _over_temperature(
    curve: xr.Dataset, published: Floats, known: NDArray[np.bool_], imposed: xr.Dataset
) -> xr.Dataset:
    fitted, u = curve["log10_aT"].values, curve["u_log10_aT"].values
    columns = {
        "fitted": (fitted, "fitted log10 a_T"),
        "u_fitted": (u, "standard uncertainty: fitted log10 a_T"),
        "published": (published, "published log10 a_T, relative to the same reference"),
        "difference": (fitted - published, "fitted less published log10 a_T"),
    }
    for name in ("storage_residual", "loss_residual"):
        values = np.full(known.size, np.nan)
        values[known] = np.sqrt(np.nanmean(imposed[name].values ** 2, axis=1))
        text = f"{name.replace('_', ' ')} with published shifts, rms"
        columns[f"imposed_{name}"] = (values, text)
    return xr.Dataset(
        {
            name: variable("temperature", np.where(known, values, np.nan) if name != "fitted" else values, "1", text)
            for name, (values, text) in columns.items()
        },
        coords={"temperature": curve["temperature"]},
    )


def rms(values: Floats) -> float:
    """Return the root mean square of what is finite."""
    good = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(good**2))) if good.size else float("nan")
