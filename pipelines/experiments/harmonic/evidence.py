"""Dynamic stiffness of oscillations, as data for identification."""

from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from labpipe.arrays import Floats
from labpipe.identification import Evidence, stiffness_evidence
from labpipe.materials import Prony
from pipelines.experiments.harmonic.model import fitted_waves
from pipelines.experiments.harmonic.settings import Harmonic
from pipelines.experiments.shared import mach1_readings
from pipelines.experiments.shared.material_evidence import MaterialEvidence, nuisance, of_punch
from pipelines.experiments.shared.punch_model import SHIFT, elastic_force

_FILTER = nuisance("filter", 0.0, 1.0, "1", "delay of the cell's filter, in units of its uncertainty")
"""One cell tests all specimens of a session: their oscillations share its filter."""


def evidence(
    loads: xr.Dataset, waves: xr.Dataset, file: Path | None, fitted: xr.Dataset | None, *, settings: Harmonic, name: str
) -> MaterialEvidence | str:
    """Gather storage and loss stiffness at every frequency."""
    touch = mach1_readings.touch_of(waves)
    mean = waves["mean_position"].values - touch.value
    shared = of_punch(settings, loads, float(mean.max()), file, fitted)
    if isinstance(shared, str):
        return shared
    geometry, unknowns = shared
    if mean.min() <= 0.0:
        return "an oscillation lies above first touch"
    frequency = waves["frequency"].values
    zero = nuisance(f"{name} first touch", 0.0, touch.u, "m", "stage position of first touch")
    omega = 2.0 * np.pi * frequency

    def slope(shift: float) -> Floats:
        ends = [elastic_force(mean - shift + s * SHIFT, geometry) for s in (1, -1)]
        return np.asarray((ends[0] - ends[1]) / (2.0 * SHIFT))

    storage, loss, by_phase = _stiffness(loads, waves)
    late = [_FILTER] if by_phase.any() else []
    here = slope(0.0)
    by_zero = (slope(SHIFT) - slope(-SHIFT)) / (2.0 * SHIFT)

    time, depth = mach1_readings.clock(loads), loads["position_z"].values - touch.value
    kept = mach1_readings.history(time, depth)

    def fuller(material: Prony, given: Any) -> Floats:
        """Return the stiffness of the whole simulated file: finite amplitude, edges that come and go."""
        made = geometry.pressed(material, time[kept], (depth - given[zero.name])[kept])
        fits = fitted_waves(loads, waves, material, np.interp(time, time[kept], made["force"].values))
        return np.concatenate([[getattr(f, f"{part}_stiffness") for f in fits] for part in ("storage", "loss")])

    def build(rho: Floats) -> Evidence:
        return stiffness_evidence(
            name,
            frequency,
            storage,
            loss,
            here,
            rho,
            geometry.nu,
            slope_by={zero.name: by_zero},
            factors=tuple(unknown.name for unknown in unknowns),
            offsets={p.name: by_phase for p in late},
            fuller=fuller,
        )

    return MaterialEvidence(
        geometry.nu, (1.0 / float(omega.max()), 1.0 / float(omega.min())), (*unknowns, zero, *late), build
    )


def _stiffness(
    loads: xr.Dataset, waves: xr.Dataset, agree: float = 2e-4
) -> tuple[tuple[Floats, Floats], tuple[Floats, Floats], Floats]:
    """Return storage and loss with their random part, and the change of both by one deviation of the filter's delay.

    The random part is at least that of the size to which simulated oscillations and closed forms ``agree``.
    """
    storage, loss = waves["storage_stiffness"].values, waves["loss_stiffness"].values
    u_phase = np.array([mach1_readings.force_lag(loads, f).u_phase for f in waves["frequency"].values.tolist()])
    by_phase = np.concatenate([loss * u_phase, -storage * u_phase])
    u = np.concatenate([waves[f"u_{n}_stiffness"].values for n in ("storage", "loss")])
    of_gain = mach1_readings.relative_gain(loads) * np.concatenate([storage, loss])
    least = agree * np.tile(np.hypot(storage, loss), 2)
    own = np.sqrt(np.maximum(u**2 - by_phase**2 - of_gain**2, least**2))
    return (storage, own[: storage.size]), (loss, own[storage.size :]), by_phase
