"""Forces of relaxation tests, as data for identification."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import xarray as xr

from labpipe.arrays import Floats
from labpipe.identification import Evidence, LinearModel, Parameter, force_evidence, lee_radok_basis
from pipelines.experiments.relaxation.settings import Relaxation
from pipelines.experiments.shared import mach1_readings
from pipelines.experiments.shared.material_evidence import MaterialEvidence, nuisance, of_punch
from pipelines.experiments.shared.punch_model import SHIFT, Geometry, elastic_force


def evidence(
    loads: Sequence[xr.Dataset],
    ramps: Sequence[xr.Dataset],
    curves: Sequence[xr.Dataset],
    file: Path | None,
    fitted: xr.Dataset | None,
    *,
    settings: Relaxation,
    name: str,
    least: float = 1e-5,
) -> MaterialEvidence | str:
    """Gather the forces of all holds, as recorded behind the cell's filter.

    The uncertainty of a force is at least a part of it, up to which chords of histories are good.
    """
    parts = []
    for number, (load, found, curve) in enumerate(zip(loads, ramps, curves, strict=True), 1):
        shared = of_punch(settings, load, float(found["depth"].max()), file, fitted)
        if isinstance(shared, str):
            return shared
        label = name + (f" {number}" if len(loads) > 1 else "")
        parts.append((shared[0].nu, *_of_file(label, load, found, curve, least, *shared)))
    unknowns = [unknown for _, _, own, _ in parts for unknown in own]
    lags = np.concatenate([lag for _, lag, _, _ in parts])

    def joined(rho: Floats) -> Evidence:
        each = [build(rho) for *_, build in parts]
        if len(each) == 1:
            return each[0]
        groups = tuple(replace(g, name=f"{g.name}, test {i}") for i, one in enumerate(each, 1) for g in one.groups)
        return Evidence(
            name, groups, LinearModel.stacked([one.model for one in each if isinstance(one.model, LinearModel)])
        )

    return MaterialEvidence(parts[0][0], (float(lags.min()), float(lags.max())), tuple(unknowns), joined)


def _of_file(
    label: str,
    loads: xr.Dataset,
    ramps: xr.Dataset,
    curves: xr.Dataset,
    least: float,
    geometry: Geometry,
    unknowns: Sequence[Parameter],
) -> tuple[Floats, list[Parameter], Callable[[Floats], Evidence]]:
    """Return times [s], unknowns, and the evidence by relaxation times, of the ramps and holds of one file."""
    # half of two forces, a deviation of the times before and after their mean, has the mean of any parabola
    kept = (curves["mean_time"].values >= mach1_readings.filter_settles(loads)) & np.isfinite(curves["force"].values)
    lag, force, width, u = (curves[n].values[kept] for n in ("mean_time", "force", "time_spread", "u_force"))
    u = np.maximum(u, least * force)
    touch, u_touch = (float(ramps[n]) for n in ("contact_position", "u_contact_position"))
    zero = nuisance(f"{label} first touch", 0.0, u_touch, "m", "stage position of first touch")
    tare = nuisance(f"{label} tare", 0.0, max(float(loads["u_tare"]), 1e-6), "N", "zero of the force")
    delay = mach1_readings.filter_delay(loads)
    # the file's time (number,) at which the stage arrived from every number's ramp
    clock, time = mach1_readings.clock(loads), loads["time"].values
    first = ramps["first"].values.astype(int)
    begins = (clock - time)[first] + ramps["end"].values
    at = begins[np.nonzero(kept)[0]] + lag - delay.value
    places = np.array([at - width, at + width])
    # the history of the contact, which no choice of relaxation times changes
    position = loads["position_z"].values
    told = mach1_readings.history(clock, position)
    grid = np.union1d(clock[told], places)
    rows = np.searchsorted(grid, places)
    areas = []  # elastic force over reduced modulus, by interpolation
    for shift in (0.0, SHIFT):
        # a contact that once was as wide keeps its width: the running maximum stands for the depth
        reached = np.maximum.accumulate(np.maximum(position[told] - touch - shift, 0.0))
        depths = np.concatenate([[0.0], np.geomspace(1e-4, 1.0, 200) * float(reached.max())])
        forces = np.interp(reached, depths, elastic_force(depths, geometry))
        areas.append(np.interp(grid, clock[told], forces))

    def basis(rho: Floats, area: Floats) -> Floats:
        made = lee_radok_basis(grid, area, rho, geometry.nu)
        return np.asarray(0.5 * (made[rows[0]] + made[rows[1]]))

    def build(rho: Floats) -> Evidence:
        usual = basis(rho, areas[0])
        shifts = {zero.name: (basis(rho, areas[1]) - usual) / SHIFT}
        factors, offsets = tuple(unknown.name for unknown in unknowns), (tare.name,)
        return force_evidence(label, lag, force, u, usual, shifts=shifts, factors=factors, offsets=offsets)

    return lag, [*unknowns, zero, tare], build
