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
from pipelines.experiments.shared.model_inputs import table_of
from pipelines.experiments.shared.punch_model import NOTHING_NAMED, along, modelled


def model(
    loads: xr.Dataset,
    oscillations: xr.Dataset,
    material_file: Path | None,
    fitted: xr.Dataset | None,
    *,
    settings: Harmonic,
) -> xr.Dataset:
    """Simulate the whole history of the file with the measured displacement, and fit its force as the measured one.

    Without punch, substrate and first touch there is nothing to simulate; the result is then empty and says so.
    """
    if settings.punch is None or settings.substrate is None:
        return xr.Dataset(attrs={"absent": NOTHING_NAMED})
    touch = mach1_readings.touch_of(oscillations)
    if not np.isfinite(touch.value):
        return xr.Dataset(attrs={"absent": oscillations.attrs["contact"]})
    slowest, fastest = (1.0 / (2.0 * np.pi * float(f)) for f in np.sort(oscillations["frequency"].values)[[0, -1]])
    solid, effects, made = modelled(loads, touch, settings, material_file, fitted, (fastest, slowest))
    steps, u_inputs = np.array([(e.step, e.given.u) for e in effects.values()]).T
    force = made["force"].values
    changed = [force, *(force - e.change for e in effects.values())]
    rows = list(zip(*(fitted_waves(loads, oscillations, solid, each) for each in changed), strict=True))
    lost, without_chords = [], force.copy()
    for i, (fit, *_) in enumerate(rows):
        where, used = evaluated(loads, oscillations.isel(oscillation=i))
        time = loads["time"].values[where]
        lost.append(float(np.mean(force[where][used] <= 0.0)))
        angle = 2 * np.pi * fit.force.frequency * (time - fit.force.reference_time) + fit.force.phase
        stiffer = along_chords(solid, float(np.median(np.diff(time))), fit.force.frequency) - 1.0
        without_chords[where] -= fit.force.amplitude * (stiffer * np.exp(1j * angle)).imag
    text = "share of a cycle without contact, simulated"
    table: dict[str, Any] = {
        "force": made["force"].copy(data=without_chords),
        "contact_loss": variable("oscillation", np.array(lost), "1", text),
        **along(effects, phases(loads, oscillations), "oscillation"),
    }
    per_loss = np.pi * np.array([fit.position.amplitude for fit, *_ in rows]) ** 2  # work over loss stiffness
    for name, source, factor in (
        ("storage_stiffness", "storage_stiffness", np.ones_like(per_loss)),
        ("loss_stiffness", "loss_stiffness", np.ones_like(per_loss)),
        ("work_per_cycle", "loss_stiffness", per_loss),
    ):
        values, *moved = factor * np.array([[getattr(fit, source) for fit in row] for row in rows]).T
        slopes = (values[:, None] - np.array(moved).T) / steps
        units, text = COLUMNS[name]
        u = np.sqrt(np.sum((slopes * u_inputs) ** 2, axis=1))
        table |= with_u(name, "oscillation", values, u, units, f"{text}, simulated", "by touch, punch and solid")
        text = f"change with an input, SI: {text}, simulated"
        table[f"slope_{name}"] = variable(("oscillation", "uncertain"), slopes, "1", text)
    result = made.assign(table).merge(table_of({name: effect.given for name, effect in effects.items()}))
    return result.assign_coords(oscillation=oscillations["oscillation"]).assign_attrs(made.attrs)


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
    """Return the factor by which chords between samples change the modulus of a sinusoid.

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
