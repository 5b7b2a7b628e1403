"""The plate's modal mass from the momentum of simulated impacts, and the drops on it simulated."""

import json
import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

from labpipe import contact
from labpipe.arrays import Floats
from labpipe.errors import InputError
from labpipe.materials import Prony
from labpipe.variables import described, variable, with_u
from pipelines.experiments.plate_vibration.measured import NAMES, drops_label, weighted_mean
from pipelines.experiments.plate_vibration.settings import PlateVibration
from pipelines.experiments.shared.counter_body import counter_body_of
from pipelines.experiments.shared.material_choice import resolve

_COVERED = 6e-3  # s of simulation after first touch: any contact ends before
_FINE = 4e-6  # s, spacing of the simulated force: 250 points in a contact
_ROUNDS = 3  # the plate's yielding changes the blow by M/m: the rounds converge like its powers
_BEFORE, _AFTER = 3e-3, 60e-3  # s around the blow in which measurement and model are compared
_STEP = 5e-5  # s, of the compared curves


def plate(table: xr.Dataset, fitted: Sequence[xr.Dataset | None], *, settings: PlateVibration) -> xr.Dataset:
    """Find the plate's modal mass from amplitude and momentum: m = J / (A omega).

    J is the part of the simulated force that the plate responds to, the modulus of its transform at the plate's damped
    frequency; the plate's own yielding is part of the simulation. The moduli of the spheres change it by less than a
    tenth of the uncertainty of amplitudes and heights, and are taken as exact. ``fitted`` are for each of the drops the
    master curve of its DMA experiment, where it names one.
    """
    names = {"plate_natural_frequency": "frequency", "plate_damping_ratio": "damping_ratio"}
    names |= {f"u_{name}": f"u_{short}" for name, short in names.items()}
    made = xr.Dataset({short: table[name].drop_vars(table[name].coords) for name, short in names.items()})
    known = _known(settings, fitted)
    if settings.sphere is None or not known:
        return made.assign(with_u("mass", (), np.nan, np.nan, "kg", NAMES["modal_mass"]))
    frequency, zeta = float(made["frequency"]), float(made["damping_ratio"])
    places = list(known)
    scale = table["amplitude"].values[places] * 2 * np.pi * frequency * np.sqrt(1 - zeta**2)
    relative = np.hypot(*relative_uncertainty(table, settings))[places]
    mass, substrate = np.inf, None
    for _ in range(_ROUNDS):
        substrate = None if np.isinf(mass) else contact.Plate(mass, frequency, zeta)
        drops = [_Drop(settings, solid, settings.drops[i].height.value) for i, solid in known.items()]
        each = np.array([drop.heard(substrate, frequency, zeta)[0] for drop in drops]) / scale
        own = each * relative
        mass, scatter, _ = weighted_mean(each, own)
    shared = float(table.attrs["u_systematic_relative"])
    shared = float(np.hypot(shared, settings.sphere.mass.u / settings.sphere.mass.value)) * mass
    made = made.assign(with_u("mass", (), mass, float(np.hypot(scatter, shared)), "kg", NAMES["modal_mass"]))
    full = np.full((2, table.sizes["series"]), np.nan)
    full[:, places] = each, own
    made = made.assign(with_u("modal_mass", "series", full[0], full[1], "kg", "modal mass by each of the drops"))
    return made.assign_attrs(work=json.dumps({"simulated_impacts": _ROUNDS * len(known)}))


def _known(settings: PlateVibration, fitted: Sequence[xr.Dataset | None]) -> dict[int, Prony]:
    """Return the solids of those drops that name a DMA experiment or a material of the library, by number."""
    found: dict[int, Prony] = {}
    for i, (drops, curve) in enumerate(zip(settings.drops, fitted, strict=True)):
        if drops.material_from is not None and curve is None:
            continue  # the DMA experiment failed
        try:
            found[i] = resolve(drops.choice, None, curve)
        except InputError as error:
            if drops.material_from is not None:
                raise
            warnings.warn(f"{drops_label(drops)}: {error}", UserWarning, stacklevel=3)
    return found


def relative_uncertainty(table: xr.Dataset, settings: PlateVibration) -> tuple[Floats, Floats]:
    """Return the relative uncertainties (series,) of the mass by each of the drops, from amplitude and from height.

    The momentum goes with the square root of the height. The scale of length, which all share, is left out.
    """
    amplitude = table["amplitude"].values
    shared = float(table.attrs["u_systematic_relative"]) * amplitude
    own = np.sqrt(np.maximum(table["u_amplitude"].values ** 2 - shared**2, 0.0))
    by_height = np.array([0.5 * drops.height.u / drops.height.value for drops in settings.drops])
    return own / amplitude, by_height


@dataclass(frozen=True, slots=True)
class _Drop:
    """A drop of the sphere, of one solid from a height [m]."""

    settings: PlateVibration
    solid: Prony
    height: float

    @property
    def fall(self) -> float:
        """Time from the release to first touch [s]."""
        return float(np.sqrt(2 * self.height / self.settings.model.gravity.value))

    def simulated(self, plate: contact.Plate | None, times: Floats, rtol: float, *, full: bool = False) -> xr.Dataset:
        """Simulate it up to the last of the times (time,) [s]."""
        sphere, chosen = self.settings.sphere, self.settings.model
        if sphere is None:
            raise InputError("the experiment names no sphere; the momentum of an impact needs mass and radius")
        return contact.drop(
            self.solid,
            sphere.radius.value,
            sphere.mass.value,
            self.height,
            float(times[-1]),
            chosen.solver,
            chosen.profile,
            rtol,
            gravity=chosen.gravity.value,
            plate=plate,
            substrate=counter_body_of(self.settings.counter_body),
            times=times,
            full=full,
        )

    def heard(self, plate: contact.Plate | None, frequency: float, zeta: float) -> tuple[float, float]:
        """Momentum [N s] that the plate listens to, and the time [s] from first touch to the blow of no duration.

        A force F(s) leaves the ringing Im[exp(i w t) int F(s) exp((r - i w) s) ds] exp(-r t) / (m w);
        its phase is the time of the equivalent blow, and its modulus, decayed until then, the momentum.
        """
        times = np.arange(self.fall, self.fall + _COVERED, _FINE)
        s, force = times - self.fall, self.simulated(plate, times, self.settings.model.rtol)["force"].values
        omega = 2 * np.pi * frequency
        rate, damped = zeta * omega, omega * np.sqrt(1 - zeta**2)
        whole = np.trapezoid(force * np.exp((rate - 1j * damped) * s), s)
        blow = float(-np.angle(whole) / damped)
        return float(np.abs(whole) * np.exp(-rate * blow)), blow

    def seen(self, plate: contact.Plate, time: Floats, rtol: float, *, full: bool) -> Floats:
        """Return the displacement of the plate [m] at times since the blow."""
        start = self.fall + self.heard(plate, plate.frequency, plate.damping_ratio)[1]
        return np.asarray(-self.simulated(plate, time + start, rtol, full=full)["plate_displacement"].values)


def model(
    table: xr.Dataset,
    plate: xr.Dataset,
    fitted: Sequence[xr.Dataset | None],
    *,
    settings: PlateVibration,
    full: bool = False,
) -> xr.Dataset:
    """Simulate every drop on the plate that was found, as the laser should have seen it.

    ``full`` takes the simulator's shortcuts away; the numbers stay the same within ``rtol``.
    """
    mass = float(plate["mass"])
    if not np.isfinite(mass) or settings.sphere is None:
        raise InputError(
            "no modal mass is known for the simulation; name the sphere, with radius and mass, and "
            "a DMA experiment (material_from) or a material of the library"
        )
    found = contact.Plate(mass, float(plate["frequency"]), float(plate["damping_ratio"]))
    time = np.arange(-_BEFORE, _AFTER, _STEP)
    moved = np.full((table.sizes["series"], time.size), np.nan)
    for i, solid in _known(settings, fitted).items():
        drop = _Drop(settings, solid, settings.drops[i].height.value)
        moved[i] = drop.seen(found, time, settings.model.rtol, full=full)
    made = xr.Dataset(coords={"series": table["series"], "time": ("time", time, described("s", "time since impact"))})
    return made.assign(displacement=variable(("series", "time"), moved, "m", "simulated displacement of the plate"))
