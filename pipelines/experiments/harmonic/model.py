"""The indentation simulated with the measured displacement."""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from labpipe.arrays import Floats
from labpipe.materials import Prony
from labpipe.signals import CommonFit, common_fit
from labpipe.variables import variable, with_u
from pipelines.experiments.harmonic.measured import COLUMNS, evaluated, phases
from pipelines.experiments.harmonic.settings import Harmonic
from pipelines.experiments.shared import mach1_readings
from pipelines.experiments.shared.material_choice import resolve, variations
from pipelines.experiments.shared.model_inputs import table_of
from pipelines.experiments.shared.punch_model import Effect, Geometry, along, simulated


def model(
    loads: xr.Dataset,
    oscillations: xr.Dataset,
    material_file: Path | None,
    fitted: xr.Dataset | None,
    *,
    settings: Harmonic,
) -> xr.Dataset:
    """Simulate the whole history of the file with the measured displacement.

    Without punch and substrate there is nothing to simulate; the result is then empty and says so.
    """
    punch, substrate = settings.punch, settings.substrate
    if punch is None or substrate is None:
        reason = "session.toml names no punch and no substrate, so nothing was simulated"
        return xr.Dataset(attrs={"absent": reason})
    touch, how = mach1_readings.contact_position(loads, settings.contact)
    solid = resolve(substrate, material_file, fitted)
    geometry = Geometry.of(punch, substrate, settings.model, float(solid.nu))
    slowest = 1.0 / (2.0 * np.pi * float(oscillations["frequency"].min()))
    fastest = 1.0 / (2.0 * np.pi * float(oscillations["frequency"].max()))
    others = variations(substrate, material_file, fitted, (fastest, slowest))
    force, effects, attrs = simulated(loads, touch, solid, geometry, others)
    result = _model_rows(loads, oscillations, solid, force, list(effects.values()))
    result = result.merge(table_of({name: effect.given for name, effect in effects.items()}))
    result = result.assign(along(effects, phases(loads, oscillations), "oscillation"))
    result = result.assign(with_u("contact_position", (), touch.value, touch.u, "m", "stage position of first touch"))
    result.attrs |= attrs | {"contact": how}
    return result


def _model_rows(
    loads: xr.Dataset, oscillations: xr.Dataset, solid: Prony, force: Floats, effects: list[Effect]
) -> xr.Dataset:
    """Fit the simulated force as the measured one was, and keep its curve without the effect of its chords."""
    steps, u_inputs = np.array([(e.step, e.given.u) for e in effects]).T
    changed = [force - change for change in (np.zeros_like(force), *(e.change for e in effects))]
    rows = list(zip(*(fitted_waves(loads, oscillations, solid, each) for each in changed), strict=True))
    lost, force = [], force.copy()
    for i, (fit, *_) in enumerate(rows):
        where, used = evaluated(loads, oscillations.isel(oscillation=i))
        time = loads["time"].values[where]
        lost.append(float(np.mean(force[where][used] <= 0.0)))
        angle = 2 * np.pi * fit.force.frequency * (time - fit.force.reference_time) + fit.force.phase
        stiffer = along_chords(solid, float(np.median(np.diff(time))), fit.force.frequency) - 1.0
        force[where] -= fit.force.amplitude * (stiffer * np.exp(1j * angle)).imag
    table: dict[str, Any] = {
        "force": variable("sample", force, "N", "simulated force"),
        "u_force": variable(
            "sample",
            np.sqrt(np.sum(np.square([e.by_u() for e in effects]), axis=0)),
            "N",
            "standard uncertainty from first touch, punch and solid",
        ),
        "contact_loss": variable("oscillation", np.array(lost), "1", "share of a cycle without contact, simulated"),
    }
    slopes = {}
    for name in ("storage_stiffness", "loss_stiffness"):
        values, *moved = np.array([[getattr(fit, name) for fit in row] for row in rows]).T
        units, text = COLUMNS[name]
        slopes[name] = (values[:, None] - np.array(moved).T) / steps
        u = np.sqrt(np.sum((slopes[name] * u_inputs) ** 2, axis=1))
        table |= with_u(name, "oscillation", values, u, units, f"{text}, simulated", "by touch, punch and solid")
    amplitude = np.array([fit.position.amplitude for fit, *_ in rows])
    work, u_work = (np.pi * amplitude**2 * table[f"{part}loss_stiffness"][1] for part in ("", "u_"))
    table |= with_u("work_per_cycle", "oscillation", work, u_work, "J", "simulated work")
    slopes["work_per_cycle"] = np.pi * amplitude[:, None] ** 2 * slopes["loss_stiffness"]
    for name, moved in slopes.items():
        text = f"change with an input, SI: {COLUMNS[name][1]}, simulated"
        table[f"slope_{name}"] = variable(("oscillation", "uncertain"), moved, "1", text)
    return xr.Dataset(table, coords={"oscillation": oscillations["oscillation"]})


def fitted_waves(loads: xr.Dataset, oscillations: xr.Dataset, solid: Prony, force: Floats) -> list[CommonFit]:
    """Fit a simulated force (sample,) [N] as the measured one was.

    The simulation moved along chords between the readings, along which a solid is stiffer: that is taken out.
    """
    found = []
    for i in range(oscillations.sizes["oscillation"]):
        at = oscillations.isel(oscillation=i)
        where, used = evaluated(loads, at)
        time, x = (loads[name].values[where] for name in ("time", "position_z"))
        chords = partial(along_chords, solid, float(np.median(np.diff(time))))
        found.append(common_fit(time[used], x[used], force[where][used], float(at["frequency"]), response=chords))
    return found


def along_chords(material: Prony, interval: float, frequency: float) -> complex:
    """Return by what the modulus of a sampled sinusoid with chords between differs.

    Force over strain at samples ``interval`` [s] apart of a sinusoid of ``frequency`` [Hz], over the complex modulus;
    second order in the interval.

    Notes
    -----
    Over a chord a Maxwell term relaxes by d = exp(-x), x = interval / rho, and gains (1 - d) / x
    of the step of strain: with z = exp(i omega interval) its modulus is that of this recursion,
    E (1 - d) / x (1 - 1/z) / (1 - d/z).

    Examples
    --------
    >>> rubber = Prony(1e6, [1e6], [0.1])
    >>> [round(abs(along_chords(rubber, 0.01 / n, 2.5) - 1) * 1e4, 2) for n in (1, 2)]
    [6.24, 1.56]
    """
    turn, x = np.exp(-2j * np.pi * frequency * interval), interval / np.asarray(material.rho)
    gained = -np.expm1(-x) / x * (1.0 - turn) / (1.0 - np.exp(-x) * turn)
    exact = material.complex_modulus(2.0 * np.pi * frequency)
    return complex((material.E_relaxed + np.asarray(material.E) @ gained) / exact)
