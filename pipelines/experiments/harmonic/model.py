"""The indentation simulated with the measured displacement, and closed forms: work, tapping front, their scales."""

import warnings
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from labpipe import contact
from labpipe.arrays import Floats
from labpipe.contact.line import dissipation
from labpipe.errors import InputError
from labpipe.materials import Prony
from labpipe.signals import CommonFit, common_fit
from labpipe.variables import variable, with_u
from pipelines.experiments.harmonic.measured import COLUMNS, evaluated
from pipelines.experiments.harmonic.settings import Harmonic
from pipelines.experiments.shared import mach1_readings, punch_model
from pipelines.experiments.shared.material_choice import resolve
from pipelines.experiments.shared.punch_model import SHIFT, absent


def model(
    loads: xr.Dataset, oscillations: xr.Dataset, file: Path | None, fitted: xr.Dataset | None, *, settings: Harmonic
) -> xr.Dataset:
    """Simulate the whole history of the file with the measured displacement, and fit its force as the measured one."""
    made = punch_model.model(loads, oscillations, file, fitted, settings=settings)
    if settings.substrate is None or "absent" in made.attrs:
        return made
    solid, force = resolve(settings.substrate, file, fitted), made["force"].values
    changed = (force + each for each in (0.0, *made["slope"].values))  # a fit is linear in the force
    rows = list(zip(*(fitted_waves(loads, oscillations, solid, each) for each in changed), strict=True))
    without_chords = force.copy()
    for i, (fit, *_) in enumerate(rows):
        where, _ = evaluated(loads, oscillations.isel(oscillation=i))
        time = loads["time"].values[where]
        angle = 2 * np.pi * fit.force.frequency * (time - fit.force.reference_time) + fit.force.phase
        stiffer = along_chords(solid, float(np.median(np.diff(time))), fit.force.frequency) - 1.0
        without_chords[where] -= fit.force.amplitude * (stiffer * np.exp(1j * angle)).imag
    table: dict[str, Any] = {"force": made["force"].copy(data=without_chords)}
    per_loss = np.pi * np.array([[fit.position.amplitude] for fit, *_ in rows]) ** 2  # work over loss stiffness
    storage, loss = (
        np.array([[getattr(fit, f"{part}_stiffness") for fit in row] for row in rows]) for part in ("storage", "loss")
    )
    found = {"storage_stiffness": storage, "loss_stiffness": loss, "work_per_cycle": per_loss * loss}
    for name, each in found.items():
        (units, text), values, slopes = COLUMNS[name], each[:, 0], each[:, 1:] - each[:, :1]
        u = np.sqrt(np.sum((slopes * made["input_u"].values) ** 2, axis=1))
        table |= with_u(name, "oscillation", values, u, units, f"{text}, simulated", "by touch, punch and solid")
        text = f"change with an input, SI: {text}, simulated"
        table[f"slope_{name}"] = variable(("oscillation", "uncertain"), slopes, "1", text)
    return made.assign(table).assign_coords(oscillation=oscillations["oscillation"])


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


def theory(
    oscillations: xr.Dataset, loops: xr.Dataset, file: Path | None, fitted: xr.Dataset | None, *, settings: Harmonic
) -> xr.Dataset:
    """Return work by eq. (2.31), the tapping front (2.34), and everything dimensionless.

    Equations (2.37) to (2.40); the work of (2.40) is per contact length. The uncertainty of the
    theory is that of first touch. ``storage_modulus`` and ``loss_modulus`` are the measured
    stiffness over that of the contact per modulus (2.24), by the fit and, ``fourier_…``, by the components of (2.29).
    """
    punch, substrate, (touch, u_touch, _) = settings.punch, settings.substrate, mach1_readings.touch_of(oscillations)
    if punch is None or substrate is None or not np.isfinite(touch):
        return xr.Dataset(attrs={"absent": absent(settings, oscillations)})
    solid = resolve(substrate, file, fitted)
    radius, period = punch.radius.value, punch.period.value
    depth = punch.depth.value * punch.tips
    frequency, amplitude = oscillations["frequency"].values, oscillations["amplitude"].values
    mean = oscillations["mean_position"].values - touch
    if mean.min() <= 0:
        raise InputError(
            f"the mean of an oscillation lies {-mean.min() * 1e6:.3g} µm above first touch; the "
            "position of first touch cannot be right"
        )
    step = max(u_touch, SHIFT)
    shape, unit = (radius, period), Prony(1.0, [], [], nu=float(solid.nu))

    def at(indentation: Floats) -> Floats:
        """Return work [J], tapping front [m] and stiffness per modulus [m] (quantity, oscillation)."""
        rows = [
            (
                float(contact.dissipated_work(solid, f, a, i, *shape, depth)),
                float(contact.tapping_amplitude(solid, f, i, *shape)),
                float(dissipation.dynamic_stiffness(unit, 0.0, i, *shape, depth).real),
            )
            for f, a, i in zip(frequency, amplitude, indentation, strict=True)
        ]
        return np.array(rows).T

    try:
        found = at(mean)
        u_work, u_front, u_contact = np.abs(at(mean + step) - found) * u_touch / step
    except InputError as error:  # a layer may be pressed further than the half-plane of the theory
        return xr.Dataset(attrs={"absent": f"equations (2.31) and (2.34) do not apply: {error}"})
    work, front, per_pascal = found
    shortest = float(solid.creep_terms()[1].min()) if len(solid.rho) else np.nan
    tau = shortest if settings.characteristic_time is None else settings.characteristic_time.value
    seen, u_seen = (oscillations[f"{u}work_per_cycle"].values for u in ("", "u_"))
    table: dict[str, Any] = {}
    for route, text in (("", "by the fit"), ("fourier_", "by the Fourier components")):
        for part in ("storage", "loss"):
            k, u = (oscillations[f"{u}{route}{part}_stiffness"].values for u in ("", "u_"))
            modulus, u = k / per_pascal, np.hypot(u, k * u_contact / per_pascal) / per_pascal
            table |= with_u(f"{route}{part}_modulus", "oscillation", modulus, u, "Pa", f"{part} modulus, {text}")
    unit_work = 1.0 / dissipation.dimensionless_work(1.0, solid, radius, period, depth)
    for name, values, u, units, text in (
        ("dissipated_work", work, u_work, "J", "dissipated work per cycle, eq. (2.31)"),
        ("tapping_amplitude", front, u_front, "m", "amplitude at which contact is lost, eq. (2.34)"),
        ("dimensionless_work_measured", seen / unit_work, u_seen / unit_work, "1", "work (2.40), measured"),
        ("dimensionless_work_theory", work / unit_work, u_work / unit_work, "1", "work (2.40), theory"),
    ):
        table |= with_u(name, "oscillation", values, u, units, text)
    over_radius, text = amplitude / radius, "amplitude over R, eq. (2.37)"
    table["dimensionless_amplitude"] = variable("oscillation", over_radius, "1", text)
    table["dimensionless_frequency"] = variable("oscillation", frequency * tau, "1", "f tau_0, eq. (2.38)")
    table["characteristic_time"] = variable((), float(tau), "s", "characteristic time tau_0")
    table["work_scale"] = variable((), unit_work, "J", "scale of the work (2.40)")
    made = xr.Dataset(table, coords={"oscillation": oscillations["oscillation"]})
    for label, where in (
        ("contact is lost in part of the cycle", loops["contact_loss"].values > 0),
        ("the amplitude lies beyond the tapping front (2.34)", amplitude > front),
    ):
        if where.any():
            shown = ", ".join(f"{f:.3g}" for f in frequency[where])
            warnings.warn(f"{label} at {shown} Hz: thesis eq. (2.31) is an extrapolation there", stacklevel=2)
    return made
