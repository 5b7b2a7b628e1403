"""Relaxation under a periodic punch: peak, plateau, modulus, and the model beside them.

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
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.optimize import nnls

from labpipe.errors import InputError
from labpipe.uncertainty import Row, Source, beyond, combined, table
from labpipe.units import Quantity
from pipelines.experiments.relaxation.settings import Relaxation
from pipelines.experiments.shared import mach1_readings, ramps_and_holds
from pipelines.experiments.shared.material_choice import resolve
from pipelines.experiments.shared.punch_model import (
    Geometry,
    elastic_force,
    relative_sources,
    simulated,
)
from pipelines.experiments.shared.ramps_and_holds import Hold

Array = NDArray[np.float64]

_BINS_PER_DECADE = 12  # of the relaxation curve
_TERMS_PER_DECADE = 3  # of the modulus that is fitted
_FASTEST = 0.2  # of a sampling interval: faster processes cannot be told apart
_BIRGE_LIMIT = 2.0  # of chance alone, three depths exceed it once in fifty
_RESOLVED = 4.0  # sampling intervals: the fitted modulus at shorter times is a guess
_FIT_READINGS = 400  # of a hold
_SETTLED = 5.0  # s of a hold after which the filter's delay changes the force by less than 1e-4
_PARTS = ("ramp", "early", "late", "all")


def readings(path: Path, *, settings: Relaxation) -> xr.Dataset:
    """Read one Mach-1 file."""
    del settings
    return mach1_readings.read(path)


def loads(readings: xr.Dataset, record: Path | None, *, settings: Relaxation) -> xr.Dataset:
    """Make force compression-positive, and tare it where the file begins in air."""
    return mach1_readings.force(
        readings, settings.load_cell.tare, record,
        untared="peak and plateau hold the cell's offset and a preload",
    )  # fmt: skip


def ramps(loads: xr.Dataset, *, settings: Relaxation) -> xr.Dataset:
    """Find every ramp and hold, first touch, and the peak and plateau of the force."""
    try:
        touch, how = mach1_readings.contact_position(loads, settings.contact)
    except InputError as error:
        # forces need no depth
        warnings.warn(f"no modulus and no model: {error}", stacklevel=2)
        touch, how = None, str(error)
    result = ramps_and_holds.measured(loads, touch, settings.hold.plateau.value)
    value, u = (np.nan, np.nan) if touch is None else (touch.value, touch.u)
    text = "stage position of first touch"
    result["contact_position"] = ((), value, {"units": "m", "long_name": text})
    result["u_contact_position"] = (
        (), u, {"units": "m", "long_name": f"standard uncertainty: {text}"},
    )  # fmt: skip
    return result.assign_attrs(contact=how)


def curves(
    loads: xr.Dataset,
    ramps: xr.Dataset,
    material_file: Path | None,
    fitted: xr.Dataset | None,
    *,
    settings: Relaxation,
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
        "u_reduced_modulus": ("Pa", "standard uncertainty: relaxed reduced modulus"),
        "reduced_modulus_own_part": (
            "Pa",
            "part of its uncertainty that other depths do not share",
        ),
        "reduced_modulus_cosine": ("Pa", "the same by eq. (2.17), for a cosine on a half-plane"),
    }
    result = result.merge(xr.Dataset(ramps_and_holds.over_ramps([m for m, _ in moduli], columns)))
    result.attrs = {"budgets": json.dumps([b for _, b in moduli])}
    result["nu"] = ((), np.nan if nu is None else nu, {"units": "1", "long_name": "Poisson ratio"})
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
    edges = np.geomspace(0.5 * interval, 1.001 * longest, int(decades * _BINS_PER_DECADE) + 2)
    lag = np.sqrt(edges[1:] * edges[:-1])
    step = float(loads.attrs.get("resolution", 0.0))
    force, spread, middle, width = (np.full((len(found), lag.size), np.nan) for _ in range(4))
    for i, hold in enumerate(found):
        since = loads["time"].values[hold.rows] - hold.end
        values = loads["force"].values[hold.rows]
        t, mean, _, _ = ramps_and_holds.binned(since, values, edges)
        place = np.searchsorted(edges, t, side="right") - 1
        force[i, place], middle[i, place] = mean, t
        width[i, place] = ramps_and_holds.binned(since, since, edges)[2]
        spread[i, place] = ramps_and_holds.u_of_means(
            since, values, edges, ramps_and_holds.noise(loads, hold), step
        )
    kept = np.isfinite(force).any(axis=0)
    text = "force in the hold, as recorded behind the cell's filter"
    table = {
        "force": (force, "N", text),
        "u_force": (spread, "N", f"standard uncertainty from noise: {text}"),
        "mean_time": (middle, "s", "mean time of a bin's readings since the stage arrived"),
        "time_spread": (width, "s", "standard deviation of the times of a bin's readings"),
    }
    return xr.Dataset(
        {
            name: (("ramp", "lag"), values[:, kept], {"units": units, "long_name": text})
            for name, (values, units, text) in table.items()
        },
        coords={
            "ramp": np.arange(1, len(found) + 1),
            "lag": ("lag", lag[kept], {"units": "s", "long_name": "time since the stage arrived"}),
        },
    )


def _modulus(
    loads: xr.Dataset, at: xr.Dataset, geometry: Geometry
) -> tuple[dict[str, float], list[Row]]:
    """Invert the plateau: reduced modulus, its uncertainty, and the budget."""
    depth, force = float(at["depth"]), float(at["plateau_force"])
    if depth <= 0:
        message = (
            f"the hold lies {-depth * 1e6:.3g} µm above first touch; the position of first touch "
            "cannot be right"
        )
        raise InputError(message)
    value = force / float(elastic_force(np.array([depth]), geometry)[0])
    cosine = Geometry(
        geometry.radius, geometry.period, geometry.depth, geometry.tips, np.inf, geometry.nu,
        type(geometry.model)(profile="cosine"),
    )  # fmt: skip
    gain = float(np.nan_to_num(float(loads["u_gain"])))
    tare = float(loads["u_tare"])
    noise = beyond(float(at["u_plateau_force"]), ramps_and_holds.systematic(loads, force))
    of_force = value / force
    sources = [
        Source("noise of the plateau", force, noise, "N", of_force, "random"),
        Source("tare", float(loads["tare"]), tare, "N", of_force, "systematic"),
        Source("relaxation not finished", 0.0, float(at["unfinished"]), "N", of_force,
               "systematic"),
        Source("gain of the cell", float(loads["gain"]), gain, "1", value, "systematic"),
    ]  # fmt: skip
    # a deeper contact at the same force is a softer one
    sources += [
        s._replace(sensitivity=-value * s.sensitivity)
        for s in relative_sources(depth, float(at["u_depth"]), geometry)
    ]
    shared = {"gain of the cell", "tip radius", "period", "length of a tip"}
    own = [s for s in sources if s.source not in shared]
    row = {
        "reduced_modulus": value,
        "u_reduced_modulus": combined(sources),
        "reduced_modulus_own_part": combined(own),
        "reduced_modulus_cosine": force / float(elastic_force(np.array([depth]), cosine)[0]),
    }
    return row, table(sources)


def _fitted(loads: xr.Dataset, found: list[Hold], touch: float, geometry: Geometry) -> xr.Dataset:
    """Fit the relaxation modulus to the force, and return it with the force before the filter.

    Every Maxwell term of weight one gives a force by Lee and Radok's integral; the weights follow
    by non-negative least squares, after each of these forces has passed the cell's filter.
    """
    interval = float(loads["sampling_interval"][found[0].block])
    declared = mach1_readings.declared_filter(loads)
    time = mach1_readings.clock(loads)
    area = elastic_area(loads["position_z"].values - touch, geometry)
    longest = max(hold.last - hold.end for hold in found)
    decades = np.log10(longest / (_FASTEST * interval))
    rho = np.geomspace(_FASTEST * interval, longest, int(decades * _TERMS_PER_DECADE))
    basis = np.column_stack([area] + [_maxwell(time, area, r) for r in rho])
    rows = _fit_rows(loads, found, interval)
    measured = loads["force"].values[rows]
    answers = []
    kinds = mach1_readings.filter_kinds(loads)
    for kind in kinds:
        passed = np.column_stack([
            _through(loads, column, interval, declared, kind)[rows] for column in basis.T
        ])  # fmt: skip
        scale = np.maximum(np.abs(passed).max(axis=0), 1e-300)
        found_weights, _ = nnls(passed / scale, measured)
        answers.append(found_weights / scale)
    chosen = answers[0]
    clean = [basis @ each for each in answers]
    first = _RESOLVED * interval
    lag = np.geomspace(first, longest, int(np.log10(longest / first) * _BINS_PER_DECADE))
    modulus = chosen[0] + np.exp(-lag[:, None] / rho) @ chosen[1:]
    peaks = np.array([[c[hold.rows].max() for hold in found] for c in clean])
    systematic = np.array([ramps_and_holds.systematic(loads, p) for p in peaks[0]])
    rest = measured - _through(loads, clean[0], interval, declared, kinds[0])[rows]
    misfit = np.array([_misfit(loads, rest, rows, hold) for hold in found])
    of_filter = np.abs(peaks[-1] - peaks[0]) / np.sqrt(3.0)
    u_peak = np.sqrt(systematic**2 + misfit**2 + of_filter**2)
    return xr.Dataset(
        {
            "relaxation_modulus": (
                "elapsed", modulus,
                {"units": "Pa", "long_name": "reduced relaxation modulus, fitted to the force"},
            ),
            "peak_force_unfiltered": (
                "ramp", peaks[0], {"units": "N", "long_name": "largest force before the filter"},
            ),
            "u_peak_force_unfiltered": (
                "ramp", u_peak,
                {"units": "N", "long_name": "standard uncertainty: largest force before filter"},
            ),
            "peak_filter_part": (
                "ramp", of_filter,
                {"units": "N", "long_name": "part of it that the unknown kind of filter leaves"},
            ),
        },
        coords={
            "ramp": np.arange(1, len(found) + 1),
            "elapsed": ("elapsed", lag, {"units": "s", "long_name": "time since a step of strain"}),
        },
        attrs={"work": json.dumps({"fit_rows": int(rows.size), "fit_terms": int(rho.size + 1)})},
    )  # fmt: skip


def elastic_area(depth: Array, geometry: Geometry) -> Array:
    """Return elastic force over reduced modulus of a history that only grows, by interpolation."""
    deepest = float(depth.max())
    grid = np.concatenate([[0.0], np.geomspace(1e-4, 1.0, 200) * deepest])
    area = elastic_force(grid, geometry)
    # a contact that once was as wide keeps its width: the running maximum stands for the depth
    reached = np.maximum.accumulate(np.maximum(depth, 0.0))
    return np.asarray(np.interp(reached, grid, area))


def _maxwell(time: Array, area: Array, rho: float) -> Array:
    """Return ∫ exp(−(t − s)/ρ) dA(s) on the samples, A linear between them."""
    step = np.diff(time) / rho
    decay = np.exp(-step)
    share = np.where(step > 0, -np.expm1(-step) / np.where(step > 0, step, 1.0), 1.0)
    gained = share * np.diff(area)
    made = np.zeros(time.size)
    level = 0.0
    for n, (d, g) in enumerate(zip(decay.tolist(), gained.tolist(), strict=True)):
        level = level * d + g
        made[n + 1] = level
    return made


def _through(
    loads: xr.Dataset,
    force: Array,
    interval: float,
    declared: dict[str, float] | None,
    kind: str = "butterworth",
) -> Array:
    """Pass the force of every block through the cell's filter, while the stage moves and after.

    In a long hold the force is so slow that a filter leaves it as it is.
    """
    made = force.copy()
    moving = np.flatnonzero(np.diff(loads["position_z"].values, prepend=np.nan) != 0)
    for block in range(loads.sizes["block_index"]):
        rows = mach1_readings.rows(loads, block)
        inside = moving[(moving >= rows.start) & (moving < rows.stop)]
        last = int(inside[-1]) if inside.size else rows.start
        part = slice(rows.start, min(rows.stop, last + round(_SETTLED / interval)))
        made[part] = mach1_readings.filtered(force[part], interval, declared, kind)
    return made


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


def _misfit(loads: xr.Dataset, rest: Array, rows: NDArray[np.int64], hold: Hold) -> float:
    """Return the root mean square misfit [N] around the end of a ramp."""
    time = loads["time"].values[rows]
    inside = (rows >= hold.rows.start) & (rows < hold.rows.stop)
    near = inside & (np.abs(time - hold.end) < max(hold.end - hold.begin, 0.1))
    return float(np.sqrt(np.mean(rest[near] ** 2)))


def model(
    loads: xr.Dataset,
    ramps: xr.Dataset,
    material_file: Path | None,
    fitted: xr.Dataset | None,
    *,
    settings: Relaxation,
) -> xr.Dataset:
    """Simulate the whole file with the measured displacement.

    Without punch, substrate and first touch there is nothing to simulate; the result says so.
    """
    touch = float(ramps["contact_position"])
    if settings.punch is None or settings.substrate is None:
        reason = "session.toml names no punch and no substrate, so nothing was simulated"
        return xr.Dataset(attrs={"absent": reason})
    if not np.isfinite(touch):
        return xr.Dataset(attrs={"absent": ramps.attrs["contact"]})
    solid = resolve(settings.substrate, material_file, fitted)
    geometry = Geometry.of(settings.punch, settings.substrate, settings.model, float(solid.nu))
    at = Quantity(touch, float(ramps["u_contact_position"]), "m")
    force, u_force, attrs = simulated(loads, at, solid, geometry)
    text = "simulated force, before the cell's filter"
    interval, longest = float(loads["sampling_interval"][0]), float(ramps["duration"].max())
    elapsed = np.geomspace(interval, longest, int(np.log10(longest / interval) * _BINS_PER_DECADE))
    return xr.Dataset(
        {
            "force": ("sample", force, {"units": "N", "long_name": text}),
            "u_force": (
                "sample", u_force,
                {"units": "N", "long_name": "standard uncertainty from first touch and punch"},
            ),
            "reduced_modulus": (
                (), float(solid.E_relaxed) / (1 - float(solid.nu) ** 2),
                {"units": "Pa", "long_name": "relaxed reduced modulus of the material"},
            ),
            "relaxation_modulus": (
                "elapsed", np.asarray(solid.relaxation(elapsed)) / (1 - float(solid.nu) ** 2),
                {"units": "Pa", "long_name": "reduced relaxation modulus of the material"},
            ),
        },
        coords={
            "elapsed": (
                "elapsed", elapsed, {"units": "s", "long_name": "time since a step of strain"},
            ),
        },
        attrs=attrs,
    )  # fmt: skip


def comparison(
    loads: xr.Dataset, ramps: xr.Dataset, model: xr.Dataset, *, settings: Relaxation
) -> xr.Dataset:
    """Lay the simulated force, filtered as the cell filters, over the measured one.

    Errors of ramp, early and late relaxation are all relative to the range of the whole test, so
    that they can be compared with each other.
    """
    if "absent" in model.attrs:
        return xr.Dataset(attrs={"absent": model.attrs["absent"]})
    found = ramps_and_holds.find(loads)
    declared = mach1_readings.declared_filter(loads)
    interval = float(loads["sampling_interval"][found[0].block])
    kind = mach1_readings.filter_kinds(loads)[0]
    passed = _through(loads, model["force"].values, interval, declared, kind)
    measured = loads["force"].values
    rows = []
    for number, hold in enumerate(found):
        level = ramps_and_holds.plateau(loads, hold, settings.hold.plateau.value)
        late = loads["time"].values[hold.rows] >= level.begin
        theirs = passed[hold.rows]
        peak, plateau = float(theirs.max()), float(theirs[late].mean())
        u_plateau = float(model["u_force"].values[hold.rows][late].mean())
        at = ramps.isel(ramp=number)
        rows.append(
            _errors(loads, hold, measured, passed, settings.hold.early.value)
            | {
                "peak_force_model": peak,
                "plateau_force_model": plateau,
                "peak_force_difference": float(at["peak_force"]) - peak,
                "plateau_force_difference": float(at["plateau_force"]) - plateau,
                "u_plateau_force_difference": float(
                    np.hypot(float(at["u_plateau_force"]), u_plateau)
                ),
            }
        )
    columns = {f"nrmse_{p}": ("1", f"rms error over range of force, {p}") for p in _PARTS}
    columns |= {f"bias_{p}": ("N", f"mean of measured minus model, {p}") for p in _PARTS}
    columns |= {
        "peak_force_model": ("N", "largest force, model behind the filter"),
        "plateau_force_model": ("N", "plateau force, model"),
        "peak_force_difference": ("N", "largest force, measured minus model"),
        "plateau_force_difference": ("N", "plateau force, measured minus model"),
        "u_plateau_force_difference": ("N", "standard uncertainty: plateau force difference"),
    }
    made = xr.Dataset(ramps_and_holds.over_ramps(rows, columns), coords={"ramp": ramps["ramp"]})
    made["simulated_force"] = (
        "sample", passed, {"units": "N", "long_name": "simulated force, behind the cell's filter"},
    )  # fmt: skip
    return made


def _errors(
    loads: xr.Dataset, hold: Hold, measured: Array, simulated: Array, early: float
) -> dict[str, float]:
    """Return nRMSE and bias of the parts of one test."""
    time = loads["time"].values[hold.rows]
    ours, theirs = measured[hold.rows], simulated[hold.rows]
    extent = float(np.ptp(ours))
    parts = {
        "ramp": (time >= hold.begin) & (time <= hold.end),
        "early": (time > hold.end) & (time <= hold.end + early),
        "late": time > hold.end + early,
        "all": time >= hold.begin,
    }
    row = {}
    for name, inside in parts.items():
        gap = ours[inside] - theirs[inside]
        row[f"nrmse_{name}"] = float(np.sqrt(np.mean(gap**2))) / extent if gap.size else np.nan
        row[f"bias_{name}"] = float(gap.mean()) if gap.size else np.nan
    return row


def tests(
    ramps: list[xr.Dataset],
    curves: list[xr.Dataset],
    comparison: list[xr.Dataset],
    *,
    settings: Relaxation,
) -> xr.Dataset:
    """Gather every ramp of every file, and average the modulus over the depths."""
    names = [
        Path(file).stem + (f", ramp {i + 1}" if found.sizes["ramp"] > 1 else "")
        for file, found in zip(settings.mach1, ramps, strict=True)
        for i in range(found.sizes["ramp"])
    ]
    parts = [
        xr.merge(
            [found, curve.drop_dims(["lag", "elapsed"], errors="ignore"),
             compared.drop_dims("sample", errors="ignore")],
            combine_attrs="drop_conflicts",
        )
        for found, curve, compared in zip(ramps, curves, comparison, strict=True)
    ]  # fmt: skip
    wanted = sorted({str(n) for part in parts for n in part.data_vars if "ramp" in part[n].dims})
    table: dict[str, Any] = {}
    for name in wanted:
        values = [
            part[name].values if name in part else np.full(part.sizes["ramp"], np.nan)
            for part in parts
        ]
        attrs = next(part[name].attrs for part in parts if name in part)
        table[name] = ("test", np.concatenate(values), attrs)
    made = xr.Dataset(table, coords={"test": np.arange(1, len(names) + 1)})
    made.attrs = {"names": json.dumps(names)}
    if "reduced_modulus" in made:
        nus = [float(c["nu"]) for c in curves if "nu" in c]
        made = made.merge(_averaged(made, nus[0]))
    return made


def _averaged(table: xr.Dataset, nu: float) -> xr.Dataset:
    """Average the modulus over the tests, weighted by what they do not share.

    The scatter is tested against the stated uncertainties; where it is larger, they grow by the
    Birge ratio.
    """
    value = table["reduced_modulus"].values
    own, whole = table["reduced_modulus_own_part"].values, table["u_reduced_modulus"].values
    usable = np.isfinite(value) & (own > 0)
    weight = 1 / own[usable] ** 2
    mean = float(np.sum(weight * value[usable]) / weight.sum())
    shared = float(np.mean(np.sqrt(np.maximum(whole[usable] ** 2 - own[usable] ** 2, 0.0))))
    chi = float(np.sum(weight * (value[usable] - mean) ** 2))
    freedom = int(usable.sum()) - 1
    birge = max(1.0, np.sqrt(chi / freedom)) if freedom > 0 else 1.0
    if birge > _BIRGE_LIMIT:
        warnings.warn(
            f"the moduli of the depths differ by {birge:.1f} times their uncertainties: the rubber "
            "is not linear, or the punch is not what session.toml says",
            stacklevel=2,
        )
    u = float(np.hypot(birge / np.sqrt(weight.sum()), shared))
    tension = 1 - nu**2
    rows = {
        "mean_reduced_modulus": (mean, "Pa", "relaxed reduced modulus over all tests"),
        "u_mean_reduced_modulus": (u, "Pa", "standard uncertainty: mean reduced modulus"),
        "birge_ratio": (birge, "1", "scatter between tests over their uncertainties"),
        "mean_relaxed_modulus": (mean * tension, "Pa", "relaxed modulus in tension"),
        "u_mean_relaxed_modulus": (u * tension, "Pa", "standard uncertainty: relaxed modulus"),
    }
    return xr.Dataset({
        name: ((), number, {"units": units, "long_name": text})
        for name, (number, units, text) in rows.items()
    })  # fmt: skip
