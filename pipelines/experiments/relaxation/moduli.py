"""The relaxation curve of a test, one ramp with its hold, and the modulus from its plateau (thesis, eq. 2.17)."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

from labpipe.arrays import Floats, Integers
from labpipe.errors import InputError
from labpipe.signals import independent_count
from labpipe.uncertainty import Row, Source, budget_rows, combined_uncertainty, excess_uncertainty
from labpipe.variables import from_rows, variable
from pipelines.experiments.relaxation.measured import Hold, find, systematic
from pipelines.experiments.relaxation.settings import Relaxation
from pipelines.experiments.shared.material_choice import resolve
from pipelines.experiments.shared.punch_model import Geometry, elastic_force, relative_sources

_BINS_PER_DECADE = 12  # of the relaxation curve
_ENOUGH = 100  # readings from which noise is known to 7 %
_NOISE_TREND = 3  # degree in log time: what is left of the second half of a hold is noise


def curves(
    loads: xr.Dataset, ramps: xr.Dataset, material_file: Path | None, fitted: xr.Dataset | None, *, settings: Relaxation
) -> xr.Dataset:
    """Return relaxation curves over the time since the ramp, and moduli where the depth is known.

    Of the named material only Poisson's ratio is used.
    """
    found = find(loads)
    result = _relaxation_curves(loads, found)
    touch = float(ramps["contact_position"])
    if settings.punch is None or not np.isfinite(touch):
        reason = "no punch is named" if settings.punch is None else ramps.attrs["contact"]
        return result.assign_attrs(absent=f"no modulus was found: {reason}")
    substrate = settings.substrate
    nu = None if substrate is None else float(resolve(substrate, material_file, fitted).nu)
    geometry = Geometry.of(settings.punch, substrate, settings.model, nu)
    moduli = [_modulus(loads, ramps.isel(ramp=i), geometry) for i in range(len(found))]
    columns = {
        "reduced_modulus": ("Pa", "relaxed reduced modulus E/(1 - nu^2), from the plateau"),
        "reduced_modulus_own_part": ("Pa", "part of its uncertainty that other depths do not share"),
    }
    result = result.merge(xr.Dataset(from_rows("ramp", [m for m, _ in moduli], columns)))
    result.attrs = {"budgets": json.dumps([b for _, b in moduli])}
    result["nu"] = variable((), np.nan if nu is None else nu, "1", "Poisson ratio")
    return result


def _relaxation_curves(loads: xr.Dataset, found: list[Hold]) -> xr.Dataset:
    """Bin the force of every hold over the logarithm of the time since the stage arrived, at the bins' mean times."""
    interval = float(loads["sampling_interval"][found[0].block])
    longest = max(hold.last - hold.end for hold in found)
    edges = np.geomspace(0.5 * interval, 1.001 * longest, int(np.log10(longest / interval) * _BINS_PER_DECADE) + 2)
    text = "force in the hold, as recorded behind the cell's filter"
    columns = {
        "force": ("N", text),
        "u_force": ("N", f"standard uncertainty from noise: {text}"),
        "mean_time": ("s", "mean time of a bin's readings since the stage arrived"),
        "time_spread": ("s", "standard deviation of the times of a bin's readings"),
    }
    table = np.full((len(columns), len(found), edges.size - 1), np.nan)
    for i, hold in enumerate(found):
        since, force = loads["time"].values[hold.rows] - hold.end, loads["force"].values[hold.rows]
        place = np.searchsorted(edges, since, side="right") - 1
        inside = (place >= 0) & (place < edges.size - 1)
        bins = pd.DataFrame({"time": since[inside], "force": force[inside]}).groupby(place[inside])
        mean, count = bins.mean(), bins.size()
        u = _u_of_means(loads, hold, np.asarray(count, np.int64))
        table[:, i, count.index] = mean["force"], u, mean["time"], bins["time"].std(ddof=0)
    kept = np.isfinite(table[0]).any(axis=0)
    lag = np.sqrt(edges[1:] * edges[:-1])[kept]
    return xr.Dataset(
        {
            name: variable(("ramp", "lag"), values[:, kept], *words)
            for (name, words), values in zip(columns.items(), table, strict=True)
        },
        coords={"ramp": np.arange(1, len(found) + 1), "lag": variable("lag", lag, "s", "time since the stage arrived")},
    )


def _u_of_means(loads: xr.Dataset, hold: Hold, count: Integers) -> Floats:
    """Return the standard uncertainty [N] of means of so many readings, by the noise of the second half of a hold."""
    time, force = loads["time"].values[hold.rows], loads["force"].values[hold.rows]
    late = time >= 0.5 * (hold.end + hold.last)
    step = float(loads.attrs.get("resolution", 0.0))
    sd, memory = float(np.nanmax(loads["u_force"].values)), 1.0
    if late.sum() >= _ENOUGH:
        since = np.log(time[late] - hold.end)
        rest = force[late] - np.polynomial.Polynomial.fit(since, force[late], _NOISE_TREND)(since)
        # the cell's filter ties neighbouring readings together
        sd, memory = float(rest.std()), rest.size / independent_count(rest)
    least = step / np.sqrt(12.0)
    u = max(sd, least) / np.sqrt(np.maximum(count / memory, 1.0))
    return np.asarray(np.maximum(u, least) if sd < step / 2 else u)


def _modulus(loads: xr.Dataset, at: xr.Dataset, geometry: Geometry) -> tuple[dict[str, float], list[Row]]:
    """Invert the plateau: reduced modulus, its uncertainty, and the budget."""
    depth, force = float(at["depth"]), float(at["plateau_force"])
    if depth <= 0:
        message = f"the hold lies {-depth * 1e6:.3g} µm above first touch; the position of first touch cannot be right"
        raise InputError(message)
    value = force / float(elastic_force(np.array([depth]), geometry)[0])
    of_force, noise = value / force, excess_uncertainty(float(at["u_plateau_force"]), systematic(loads, force))
    own = [
        Source("noise", 0.0, noise, "N", of_force, "random"),
        Source("tare", float(loads["tare"]), float(loads["u_tare"]), "N", -of_force, "systematic"),
        Source("unfinished relaxation", 0.0, float(at["unfinished"]), "N", -of_force, "systematic"),
    ]
    # a deeper contact at the same force is a softer one
    of_punch = relative_sources(depth, float(at["u_depth"]), geometry)
    *shape, touch = (s._replace(sensitivity=-value * s.sensitivity) for s in of_punch)
    gain = Source("gain", float(loads["gain"]), float(np.nan_to_num(loads["u_gain"])), "1", value, "systematic")
    sources = [*own, gain, *shape, touch]
    row = {
        "reduced_modulus": value,
        "u_reduced_modulus": combined_uncertainty(sources),
        "reduced_modulus_own_part": combined_uncertainty([*own, touch]),
    }
    return row, budget_rows(sources)
