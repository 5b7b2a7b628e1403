"""Forces of relaxation tests, as data for identification."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import xarray as xr

from labpipe.arrays import Floats
from labpipe.identification import Evidence, JoinedModel, Parameter, force_evidence, lee_radok_basis
from pipelines.experiments.relaxation.moduli import elastic_area
from pipelines.experiments.relaxation.settings import Relaxation
from pipelines.experiments.shared import mach1_readings, ramps_and_holds
from pipelines.experiments.shared.material_evidence import MaterialEvidence, nuisance
from pipelines.experiments.shared.punch_evidence import FILTER, SHIFT, PunchEvidence, of_punch

_DELAYS = 20.0  # time constants of the cell's filter after which it leaves a relaxation as it is
_LEAST_OF_FORCE = 1e-5  # of a force in a hold: what chords of histories are good for


def evidence(
    loads: Sequence[xr.Dataset],
    ramps: Sequence[xr.Dataset],
    curves: Sequence[xr.Dataset],
    file: Path | None,
    fitted: xr.Dataset | None,
    *,
    settings: Relaxation,
    name: str,
) -> MaterialEvidence | str:
    """Gather the forces of all holds, as recorded behind the cell's filter."""
    parts = []
    for number, recording in enumerate(settings.mach1):
        found = ramps[number]
        if not np.isfinite(float(found["contact_position"])):
            return f"first touch was not found in {recording}"
        shared = of_punch(settings, loads[number], float(found["depth"].max()), file, fitted)
        if isinstance(shared, str):
            return shared
        label = name + (f" {number + 1}" if len(settings.mach1) > 1 else "")
        parts.append(_Hold(label, loads[number], found, curves[number], shared))
    unknowns = [p for part in parts for p in part.unknowns]
    lags = np.concatenate([part.lag for part in parts])
    ends = (float(lags.min()), float(lags.max()))
    return MaterialEvidence(
        parts[0].shared.nu, ends, tuple(unknowns), lambda rho: _joined(name, [part.evidence(rho) for part in parts])
    )


class _Hold:
    """Ramps and holds of one file as evidence.

    A number is the mean of a bin's readings behind the cell's filter, which comes late by the
    filter's delay. Half of two forces, a standard deviation of the readings' times before and
    after their mean, has the mean of any arc of second degree.
    """

    def __init__(
        self, label: str, loads: xr.Dataset, ramps: xr.Dataset, curves: xr.Dataset, shared: PunchEvidence
    ) -> None:
        self.label, self.shared = label, shared
        declared = mach1_readings.declared_filter(loads)
        quickest = 0.0 if declared is None else _DELAYS / (2.0 * np.pi * declared["cutoff"])
        lag, force = curves["mean_time"].values, curves["force"].values
        kept = (lag >= quickest) & np.isfinite(force)
        self.lag, self.force, width = lag[kept], force[kept], curves["time_spread"].values[kept]
        self.u = np.maximum(curves["u_force"].values[kept], _LEAST_OF_FORCE * self.force)
        self.zero = nuisance(
            f"{label} first touch", 0.0, float(ramps["u_contact_position"]), "m", "stage position of first touch"
        )
        self.tare = nuisance(f"{label} tare", 0.0, max(float(loads["u_tare"]), 1e-6), "N", "zero of the force")
        delay = mach1_readings.filter_delay(loads)
        self.u_delay = delay.u
        # the file's time (number,) at which the stage arrived from every number's ramp
        clock, time = mach1_readings.clock(loads), loads["time"].values
        begins = [clock[h.rows.start] - time[h.rows.start] + h.end for h in ramps_and_holds.find(loads)]
        at = np.array(begins)[np.nonzero(kept)[0]] + self.lag - delay.value
        self.places = np.array([at - width, at + width, at - width - delay.u, at + width - delay.u])
        self._follow(loads, float(ramps["contact_position"]))

    def _follow(self, loads: xr.Dataset, touch: float) -> None:
        """Keep the history of the contact: what no choice of relaxation times changes."""
        clock, position = mach1_readings.clock(loads), loads["position_z"].values
        kept = mach1_readings.history(clock, position)
        self.time = np.union1d(clock[kept], self.places)
        self.rows = np.searchsorted(self.time, self.places)
        self.areas = [
            np.interp(self.time, clock[kept], elastic_area(position[kept] - touch - shift, self.shared.geometry))
            for shift in (0.0, SHIFT)
        ]

    @property
    def unknowns(self) -> list[Parameter]:
        late = [FILTER] if self.u_delay > 0.0 else []
        return [*self.shared.unknowns, self.zero, self.tare, *late]

    def _basis(self, rho: Floats, area: Floats) -> tuple[Floats, Floats]:
        """Return the basis (number, 1 + term), and the same with a delay one deviation longer."""
        made = lee_radok_basis(self.time, area, rho, self.shared.nu)
        early, late, *longer = (made[rows] for rows in self.rows)
        return 0.5 * (early + late), 0.5 * (longer[0] + longer[1])

    def evidence(self, rho: Floats) -> Evidence:
        basis, longer = self._basis(rho, self.areas[0])
        shifts = {self.zero.name: (self._basis(rho, self.areas[1])[0] - basis) / SHIFT}
        if self.u_delay > 0.0:
            shifts[FILTER.name] = longer - basis
        measured, factors, offsets = (self.label, self.lag, self.force, self.u), self.shared.factors, (self.tare.name,)
        return force_evidence(*measured, basis, shifts=shifts, factors=factors, offsets=offsets)


def _joined(name: str, parts: list[Evidence]) -> Evidence:
    """Return the holds of several files as one experiment."""
    if len(parts) == 1:
        return parts[0]
    groups = tuple(replace(g, name=f"{g.name}, test {i + 1}") for i, part in enumerate(parts) for g in part.groups)
    return Evidence(name, groups, JoinedModel(tuple(part.model for part in parts)))
