"""The relaxation curve of a test, and moduli from its force.

A test is one ramp with its hold. As long as the contact only grows, the force is that of the
elastic contact run through the relaxation modulus (Lee and Radok),

    F(t) = ∫ E*(t − s) dA(Δ(s)),     A: elastic force over reduced modulus,

whatever the punch's shape; so the modulus follows from the force without a model of the material.

References
----------
Thesis section 2.3.2 and eq. (2.17); E. H. Lee & J. R. M. Radok, J. Appl. Mech. 27 (1960) 438,
https://doi.org/10.1115/1.3644020.
"""

import json
from pathlib import Path

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.optimize import nnls

from labpipe.arrays import Floats
from labpipe.errors import InputError
from labpipe.identification import lee_radok_basis
from labpipe.uncertainty import Row, Source, budget_rows, combined_uncertainty, excess_uncertainty
from labpipe.variables import from_rows, variable, with_u
from pipelines.experiments.relaxation.settings import Relaxation
from pipelines.experiments.shared import mach1_readings, ramps_and_holds
from pipelines.experiments.shared.material_choice import resolve
from pipelines.experiments.shared.punch_model import Geometry, elastic_force, relative_sources
from pipelines.experiments.shared.ramps_and_holds import Hold

BINS_PER_DECADE = 12  # of the relaxation curve
_TERMS_PER_DECADE = 3  # of the modulus that is fitted
_FASTEST = 0.2  # of a sampling interval: faster processes cannot be told apart
_RESOLVED = 4.0  # sampling intervals: the fitted modulus at shorter times is a guess
_FIT_READINGS = 400  # of a hold


def curves(
    loads: xr.Dataset, ramps: xr.Dataset, material_file: Path | None, fitted: xr.Dataset | None, *, settings: Relaxation
) -> xr.Dataset:
    """Return relaxation curves over the time since the ramp, and moduli where the depth is known.

    Of the named material only Poisson's ratio is used.
    """
    found = ramps_and_holds.find(loads)
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
    if loads.attrs["is_tared"]:
        fit = _fitted(loads, found, touch, geometry)
        result = result.merge(fit, combine_attrs="drop_conflicts")
    return result


def _relaxation_curves(loads: xr.Dataset, found: list[Hold]) -> xr.Dataset:
    """Bin the force of every hold over the logarithm of the time since the stage arrived.

    A mean force belongs to the mean time of its readings, which is not the middle of the bin.
    """
    interval = float(loads["sampling_interval"][found[0].block])
    longest = max(hold.last - hold.end for hold in found)
    decades = np.log10(longest / interval)
    edges = np.geomspace(0.5 * interval, 1.001 * longest, int(decades * BINS_PER_DECADE) + 2)
    text = "force in the hold, as recorded behind the cell's filter"
    columns = {
        "force": ("N", text),
        "u_force": ("N", f"standard uncertainty from noise: {text}"),
        "mean_time": ("s", "mean time of a bin's readings since the stage arrived"),
        "time_spread": ("s", "standard deviation of the times of a bin's readings"),
    }
    table = np.full((len(columns), len(found), edges.size - 1), np.nan)
    for i, hold in enumerate(found):
        since = loads["time"].values[hold.rows] - hold.end
        t, mean, _, count = ramps_and_holds.binned(since, loads["force"].values[hold.rows], edges)
        width = ramps_and_holds.binned(since, since, edges)[2]
        u = ramps_and_holds.u_of_means(loads, hold, count)
        table[:, i, np.searchsorted(edges, t, side="right") - 1] = mean, u, t, width
    kept = np.isfinite(table[0]).any(axis=0)
    lag = np.sqrt(edges[1:] * edges[:-1])[kept]
    return xr.Dataset(
        {
            name: variable(("ramp", "lag"), values[:, kept], *words)
            for (name, words), values in zip(columns.items(), table, strict=True)
        },
        coords={"ramp": np.arange(1, len(found) + 1), "lag": variable("lag", lag, "s", "time since the stage arrived")},
    )


def _modulus(loads: xr.Dataset, at: xr.Dataset, geometry: Geometry) -> tuple[dict[str, float], list[Row]]:
    """Invert the plateau: reduced modulus, its uncertainty, and the budget."""
    depth, force = float(at["depth"]), float(at["plateau_force"])
    if depth <= 0:
        message = f"the hold lies {-depth * 1e6:.3g} µm above first touch; the position of first touch cannot be right"
        raise InputError(message)
    value = force / float(elastic_force(np.array([depth]), geometry)[0])
    lag, u = float(at["u_plateau_lag"]), float(at["u_plateau_force"])
    noise = excess_uncertainty(u, ramps_and_holds.systematic(loads, force), lag)
    of_force = value / force
    sources = [
        Source("noise", 0.0, noise, "N", of_force, "random"),
        Source("filter lag", 0.0, lag, "N", -of_force, "systematic"),
        Source("tare", float(loads["tare"]), float(loads["u_tare"]), "N", -of_force, "systematic"),
        Source("unfinished relaxation", 0.0, float(at["unfinished"]), "N", -of_force, "systematic"),
        Source("gain", float(loads["gain"]), float(np.nan_to_num(loads["u_gain"])), "1", value, "systematic"),
    ]
    # a deeper contact at the same force is a softer one
    sources += [
        s._replace(sensitivity=-value * s.sensitivity) for s in relative_sources(depth, float(at["u_depth"]), geometry)
    ]
    shared = {"gain", "tip radius", "period", "length of a tip"}
    own = [s for s in sources if s.source not in shared]
    row = {
        "reduced_modulus": value,
        "u_reduced_modulus": combined_uncertainty(sources),
        "reduced_modulus_own_part": combined_uncertainty(own),
    }
    return row, budget_rows(sources)


def _fitted(loads: xr.Dataset, found: list[Hold], touch: float, geometry: Geometry) -> xr.Dataset:
    """Fit the relaxation modulus to the force, and return it with the force before the filter.

    Every Maxwell term of weight one gives a force by Lee and Radok's integral; the weights follow
    by non-negative least squares, after each of these forces has passed the cell's filter.
    """
    interval = float(loads["sampling_interval"][found[0].block])
    time = mach1_readings.clock(loads)
    area = elastic_area(loads["position_z"].values - touch, geometry)
    longest = max(hold.last - hold.end for hold in found)
    decades = np.log10(longest / (_FASTEST * interval))
    rho = np.geomspace(_FASTEST * interval, longest, int(decades * _TERMS_PER_DECADE))
    basis = lee_radok_basis(time, area, rho, 0.0)
    rows = _fit_rows(loads, found, interval)
    measured = loads["force"].values[rows]
    answers = []
    kinds = mach1_readings.filter_kinds(loads)
    for kind in kinds:
        passed = np.column_stack([mach1_readings.passed(loads, column, kind)[rows] for column in basis.T])
        scale = np.maximum(np.abs(passed).max(axis=0), 1e-300)
        found_weights, _ = nnls(passed / scale, measured)
        answers.append(found_weights / scale)
    chosen = answers[0]
    clean = [basis @ each for each in answers]
    first = _RESOLVED * interval
    lag = np.geomspace(first, longest, int(np.log10(longest / first) * BINS_PER_DECADE))
    modulus = chosen[0] + np.exp(-lag[:, None] / rho) @ chosen[1:]
    peaks = np.array([[c[hold.rows].max() for hold in found] for c in clean])
    systematic = np.array([ramps_and_holds.systematic(loads, p) for p in peaks[0]])
    rest = measured - mach1_readings.passed(loads, clean[0], kinds[0])[rows]
    at = loads["time"].values[rows]
    misfit = np.zeros(len(found))
    for i, hold in enumerate(found):  # about the end of the ramp
        inside = (rows >= hold.rows.start) & (rows < hold.rows.stop)
        near = inside & (np.abs(at - hold.end) < max(hold.end - hold.begin, 0.1))
        misfit[i] = np.sqrt(np.mean(rest[near] ** 2))
    of_filter = np.abs(peaks[-1] - peaks[0]) / np.sqrt(3.0)
    u_peak = np.sqrt(systematic**2 + misfit**2 + of_filter**2)
    return xr.Dataset(
        {
            "relaxation_modulus": variable("elapsed", modulus, "Pa", "reduced relaxation modulus, fitted to the force"),
            **with_u("peak_force_unfiltered", "ramp", peaks[0], u_peak, "N", "largest force before the filter"),
            "peak_filter_part": variable("ramp", of_filter, "N", "part of it that the unknown kind of filter leaves"),
        },
        coords={
            "ramp": np.arange(1, len(found) + 1),
            "elapsed": variable("elapsed", lag, "s", "time since a step of strain"),
        },
        attrs={"work": json.dumps({"fit_rows": int(rows.size), "fit_terms": int(rho.size + 1)})},
    )


def elastic_area(depth: Floats, geometry: Geometry) -> Floats:
    """Return elastic force over reduced modulus of a history that only grows, by interpolation."""
    deepest = float(depth.max())
    grid = np.concatenate([[0.0], np.geomspace(1e-4, 1.0, 200) * deepest])
    area = elastic_force(grid, geometry)
    # a contact that once was as wide keeps its width: the running maximum stands for the depth
    reached = np.maximum.accumulate(np.maximum(depth, 0.0))
    return np.asarray(np.interp(reached, grid, area))


def _fit_rows(loads: xr.Dataset, found: list[Hold], interval: float) -> NDArray[np.int64]:
    """Choose readings: all of a ramp, and then evenly over the logarithm of time."""
    rows: list[int] = []
    for hold in found:
        size = hold.rows.stop - hold.rows.start
        arrival = round((hold.end - float(loads["time"].values[hold.rows.start])) / interval)
        left = max(size - arrival - 1, 1)
        after = np.unique(np.geomspace(1, left, _FIT_READINGS).astype(int))
        rows += range(hold.rows.start, hold.rows.start + arrival + 1)
        rows += (hold.rows.start + arrival + after).tolist()
    return np.array(sorted(set(rows)), dtype=np.int64)
