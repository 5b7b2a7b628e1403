"""Closed forms for comparison with the measurement: dissipated work, tapping front, dimensionless numbers."""

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from labpipe import contact
from labpipe.arrays import Floats
from labpipe.contact.line import dissipation
from labpipe.errors import InputError
from labpipe.materials import Prony
from labpipe.variables import variable, with_u
from pipelines.experiments.harmonic.settings import Harmonic
from pipelines.experiments.shared import mach1_readings
from pipelines.experiments.shared.material_choice import resolve

_LEAST_SHIFT = 1e-7  # m of first touch by which a sensitivity is found


def theory(
    oscillations: xr.Dataset,
    loops: xr.Dataset,
    model: xr.Dataset,
    material_file: Path | None,
    fitted: xr.Dataset | None,
    *,
    settings: Harmonic,
) -> xr.Dataset:
    """Return work by eq. (2.31), the tapping front (2.34), and everything dimensionless.

    Equations (2.36) to (2.40); the work of (2.40) is per contact length. The uncertainty of the
    theory is that of first touch: its mean indentation. ``storage_modulus`` and ``loss_modulus`` are the measured
    stiffness over that of the contact per modulus (2.24), by the fit and, ``fourier_…``, by the components of (2.29).
    """
    punch, substrate = settings.punch, settings.substrate
    if punch is None or substrate is None or "absent" in model.attrs:
        return xr.Dataset(attrs={"absent": str(model.attrs.get("absent", "no punch is named"))})
    solid = resolve(substrate, material_file, fitted)
    radius, period = punch.radius.value, punch.period.value
    depth = punch.depth.value * punch.tips
    touch, u_touch, _ = mach1_readings.touch_of(oscillations)
    frequency, amplitude = oscillations["frequency"].values, oscillations["amplitude"].values
    mean = oscillations["mean_position"].values - touch
    if mean.min() <= 0:
        raise InputError(
            f"the mean of an oscillation lies {-mean.min() * 1e6:.3g} µm above first touch; the "
            "position of first touch cannot be right"
        )
    step = max(u_touch, _LEAST_SHIFT)
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
    for name, values, u, units, text in (
        ("dissipated_work", work, u_work, "J", "dissipated work per cycle, eq. (2.31)"),
        ("tapping_amplitude", front, u_front, "m", "amplitude at which contact is lost, eq. (2.34)"),
        ("mean_indentation", mean, np.full(mean.size, u_touch), "m", "mean indentation"),
        ("work_difference", seen - work, np.hypot(u_seen, u_work), "J", "work, measured minus eq. (2.31)"),
    ):
        table |= with_u(name, "oscillation", values, u, units, text)
    for name, known in (("measured", (seen, u_seen)), ("theory", (work, u_work))):
        values, u = (dissipation.dimensionless_work(each, solid, radius, period, depth) for each in known)
        text = f"work, dimensionless (2.40), {name}"
        table |= with_u(f"dimensionless_work_{name}", "oscillation", values, u, "1", text)
    for name, values, text in (
        ("mean", mean / radius, "mean indentation over R, eq. (2.36)"),
        ("amplitude", amplitude / radius, "amplitude over R, eq. (2.37)"),
        ("frequency", frequency * tau, "f tau_0, eq. (2.38)"),
    ):
        table[f"dimensionless_{name}"] = variable("oscillation", values, "1", text)
    scale = float(solid.E_relaxed) * period * depth * radius
    table["characteristic_time"] = variable((), float(tau), "s", "characteristic time tau_0")
    table["work_scale"] = variable((), scale, "J", "scale of the work (2.40)")
    made = xr.Dataset(table, coords={"oscillation": oscillations["oscillation"]})
    for label, where in (
        ("contact is lost in part of the cycle", loops["contact_loss"].values > 0),
        ("the amplitude lies beyond the tapping front (2.34)", amplitude > front),
    ):
        if where.any():
            shown = ", ".join(f"{f:.3g}" for f in frequency[where])
            warnings.warn(f"{label} at {shown} Hz: eq. (2.31) is an extrapolation there", stacklevel=2)
    return made
