"""The plate's modal mass from the momentum of simulated impacts, and the drops on it simulated."""

import json
import warnings
from typing import NamedTuple

import numpy as np
import xarray as xr

from labpipe import contact, materials
from labpipe.arrays import Floats
from labpipe.errors import InputError
from labpipe.materials import Prony
from labpipe.variables import described
from pipelines.experiments.plate_vibration.measured import NAMES, drops_label, scalar, weighted_mean
from pipelines.experiments.plate_vibration.settings import PlateVibration

_COVERED = 6e-3  # s of simulation after first touch: any contact ends before
_FINE = 4e-6  # s, spacing of the simulated force: 250 points in a contact
_ROUNDS = 3  # the plate's yielding changes the blow by M/m: the rounds converge like its powers
_BEFORE, _AFTER = 3e-3, 60e-3  # s around the blow in which measurement and model are compared
_STEP = 5e-5  # s, of the compared curves


def plate(table: xr.Dataset, *, settings: PlateVibration) -> xr.Dataset:
    """Find the plate's modal mass from amplitude and momentum: m = J / (A omega).

    J is the part of the simulated force that the plate listens to, the modulus of its transform at
    the plate's damped frequency; the plate's own yielding is part of the simulation.
    """
    made = xr.Dataset(
        {
            name: table[f"{prefix}plate_{kept}"].assign_attrs(table[f"{prefix}plate_{kept}"].attrs)
            for prefix in ("", "u_")
            for name, kept in ((f"{prefix}frequency", "natural_frequency"), (f"{prefix}damping_ratio", "damping_ratio"))
        }
    )
    known = _known(settings)
    if settings.sphere is None or not known:
        nothing = np.nan
        made["mass"] = scalar(nothing, "kg", NAMES["modal_mass"])
        made["u_mass"] = scalar(nothing, "kg", f"standard uncertainty: {NAMES['modal_mass']}")
        return made
    frequency, zeta = float(made["frequency"]), float(made["damping_ratio"])
    amplitude = table["amplitude"].values[list(known)]
    damped = 2 * np.pi * frequency * np.sqrt(1 - zeta**2)
    mass, solves = np.inf, 0
    for _ in range(_ROUNDS):
        substrate = None if np.isinf(mass) else contact.Plate(mass, frequency, zeta)
        heard = np.array(
            [
                _momentum(settings, solid, settings.drops[i].height.value, substrate, frequency, zeta)
                for i, solid in known.items()
            ]
        )
        solves += len(known)
        each = heard / (amplitude * damped)
        u_each = each * relative_uncertainty(table, settings).total[list(known)]
        mass, u_mass, _ = weighted_mean(each, u_each)
    shared = float(table.attrs["u_systematic_relative"])
    shared = float(np.hypot(shared, settings.sphere.mass.u / settings.sphere.mass.value))
    made["mass"] = scalar(mass, "kg", NAMES["modal_mass"])
    made["u_mass"] = scalar(np.hypot(u_mass, shared * mass), "kg", f"standard uncertainty: {NAMES['modal_mass']}")
    full = np.full((2, table.sizes["series"]), np.nan)
    full[0, list(known)], full[1, list(known)] = each, u_each
    made["modal_mass"] = ("series", full[0], described("kg", "modal mass by each of the drops"))
    made["u_modal_mass"] = ("series", full[1], described("kg", "standard uncertainty: modal mass"))
    return made.assign_attrs(work=json.dumps({"simulated_impacts": solves}))


def _known(settings: PlateVibration) -> dict[int, Prony]:
    """Materials of those drops whose material the library knows, by number."""
    found = {}
    for i, drops in enumerate(settings.drops):
        try:
            found[i] = materials.load(drops.material)
        except InputError as error:
            warnings.warn(f"{drops_label(drops)}: {error}", UserWarning, stacklevel=3)
    return found


class Relative(NamedTuple):
    """Relative standard uncertainties (series,) that are different in every drop."""

    amplitude: Floats
    height: Floats

    @property
    def total(self) -> Floats:
        """Of the modal mass: the momentum goes with the square root of the height."""
        return np.hypot(self.amplitude, self.height)


def relative_uncertainty(table: xr.Dataset, settings: PlateVibration) -> Relative:
    """Return what amplitude and height leave uncertain of the mass that each of the drops gives.

    What all share, the scale of length, is left out.
    """
    amplitude = table["amplitude"].values
    shared = float(table.attrs["u_systematic_relative"]) * amplitude
    own = np.sqrt(np.maximum(table["u_amplitude"].values ** 2 - shared**2, 0.0))
    by_height = np.array([0.5 * drops.height.u / drops.height.value for drops in settings.drops])
    return Relative(own / amplitude, by_height)


def _momentum(
    settings: PlateVibration,
    solid: Prony,
    height: float,
    substrate: contact.Plate | None,
    frequency: float,
    zeta: float,
) -> float:
    """Momentum [N s] that the plate listens to, stated at the time of the blow."""
    heard, _ = _transform(settings, solid, height, substrate, frequency, zeta)
    return heard


def _transform(
    settings: PlateVibration,
    solid: Prony,
    height: float,
    substrate: contact.Plate | None,
    frequency: float,
    zeta: float,
) -> tuple[float, float]:
    """Momentum heard, and the time from first touch to the blow of no duration.

    A force F(s) leaves the ringing Im[exp(i w t) int F(s) exp((r - i w) s) ds] exp(-r t) / (m w);
    its phase is the time of the equivalent blow, and its modulus, decayed until then, the momentum.
    """
    body = settings.sphere
    if body is None:
        message = "the experiment names no sphere; the momentum of an impact needs mass and radius"
        raise InputError(message)
    gravity = settings.model.gravity.value
    fall = float(np.sqrt(2 * height / gravity))
    times = np.arange(fall, fall + _COVERED, _FINE)
    made = contact.drop(
        solid,
        body.radius.value,
        body.mass.value,
        height,
        float(times[-1]),
        settings.model.solver,
        settings.model.profile,
        settings.model.rtol,
        gravity=gravity,
        plate=substrate,
        times=times,
    )
    s, force = times - fall, made["force"].values
    omega = 2 * np.pi * frequency
    rate, damped = zeta * omega, omega * np.sqrt(1 - zeta**2)
    whole = np.trapezoid(force * np.exp((rate - 1j * damped) * s), s)
    blow = float(-np.angle(whole) / damped)
    return float(np.abs(whole) * np.exp(-rate * blow)), blow


def model(table: xr.Dataset, plate: xr.Dataset, *, settings: PlateVibration, full: bool = False) -> xr.Dataset:
    """Simulate every drop on the plate that was found: what the laser should have seen.

    ``full`` takes the simulator's shortcuts away; the numbers stay the same within ``rtol``.
    """
    mass = float(plate["mass"])
    if not np.isfinite(mass) or settings.sphere is None:
        message = (
            "no modal mass is known for the simulation; name the sphere, with radius and mass, and "
            "a material of the library"
        )
        raise InputError(message)
    found = contact.Plate(mass, float(plate["frequency"]), float(plate["damping_ratio"]))
    again, lasts = np.full((2, table.sizes["series"]), np.nan)
    time = np.arange(-_BEFORE, _AFTER, _STEP)
    curves = np.full((table.sizes["series"], time.size), np.nan)
    body, gravity = settings.sphere, settings.model.gravity.value
    for i, solid in _known(settings).items():
        height = settings.drops[i].height.value
        _, blow = _transform(settings, solid, height, found, found.frequency, found.damping_ratio)
        start = float(np.sqrt(2 * height / gravity)) + blow
        times = time + start
        made = contact.drop(
            solid,
            body.radius.value,
            body.mass.value,
            height,
            float(times[-1]),
            settings.model.solver,
            settings.model.profile,
            settings.model.rtol,
            gravity=gravity,
            plate=found,
            times=times,
            fold=not full,
            shortcuts=contact.Shortcuts.chosen(full=full),
        )
        curves[i] = -made["plate_displacement"].values
        touches = made["impact_time"].values
        if touches.size:
            lasts[i] = float(made["contact_duration"][0])
        if touches.size > 1:
            again[i] = float(touches[1]) - start
    return xr.Dataset(
        {
            "displacement": (("series", "time"), curves, described("m", "simulated displacement of the plate")),
            "second_touch": ("series", again, described("s", "time from the blow to the second touch")),
            "contact_duration": ("series", lasts, described("s", "duration of the first contact")),
        },
        coords={"series": table["series"], "time": ("time", time, described("s", "time since impact"))},
    )
