"""The plate's modal mass from the momentum of simulated impacts, and the drops on it simulated."""

import json
import warnings
from collections.abc import Sequence

import numpy as np
import xarray as xr

from labpipe import contact
from labpipe.arrays import Floats
from labpipe.errors import InputError
from labpipe.materials import Prony
from labpipe.variables import described, variable, with_u
from pipelines.experiments.plate_vibration.measured import drops_label, weighted_mean
from pipelines.experiments.plate_vibration.settings import PlateVibration
from pipelines.experiments.shared.counter_body import counter_body_of
from pipelines.experiments.shared.material_choice import resolve


def plate(
    table: xr.Dataset, fitted: Sequence[xr.Dataset | None], *, settings: PlateVibration, rounds: int = 3
) -> xr.Dataset:
    """Find the plate's modal mass from amplitude and momentum: m = J / (A omega).

    J is the part of the simulated force that the plate responds to, the modulus of its transform at the plate's damped
    frequency; the plate's own yielding, which changes the blow by M/m, is part of the simulation in some rounds that
    converge like its powers. The moduli of the spheres change it by less than a
    tenth of the uncertainty of amplitudes and heights, and are taken as exact. ``fitted`` are for each of the drops the
    master curve of its DMA experiment, where it names one.
    """
    names = {"plate_natural_frequency": "frequency", "plate_damping_ratio": "damping_ratio"}
    names |= {f"u_{name}": f"u_{short}" for name, short in names.items()}
    made = xr.Dataset({short: table[name].drop_vars(table[name].coords) for name, short in names.items()})
    known = _known(settings, fitted)
    if settings.sphere is None or not known:
        return made.assign(with_u("mass", (), np.nan, np.nan, "kg", "modal mass"))
    frequency, zeta, places = float(made["frequency"]), float(made["damping_ratio"]), list(known)
    scale = table["amplitude"].values[places] * 2 * np.pi * frequency * np.sqrt(1 - zeta**2)
    relative = np.hypot(*relative_uncertainty(table, settings))[places]
    mass, under = np.inf, None
    for _ in range(rounds):
        each = np.array([_heard(settings, i, solid, under, frequency, zeta)[0] for i, solid in known.items()]) / scale
        mass, scatter, _ = weighted_mean(each, each * relative)
        under = contact.Plate(mass, frequency, zeta)
    shared = np.hypot(table.attrs["u_systematic_relative"], settings.sphere.mass.u / settings.sphere.mass.value) * mass
    by_drop, u = np.full((2, table.sizes["series"]), np.nan)
    by_drop[places], u[places] = each, each * relative
    of_each = with_u("modal_mass", "series", by_drop, u, "kg", "modal mass by each of the drops")
    made = made.assign(with_u("mass", (), mass, float(np.hypot(scatter, shared)), "kg", "modal mass") | of_each)
    return made.assign_attrs(work=json.dumps({"simulated_impacts": rounds * len(known)}))


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


def _simulated(
    settings: PlateVibration, i: int, solid: Prony, plate: contact.Plate | None, since: Floats, full: bool = False
) -> xr.Dataset:
    """Simulate one of the drops at times (time,) since first touch [s]."""
    sphere, chosen, height = settings.sphere, settings.model, settings.drops[i].height.value
    if sphere is None:
        raise InputError("the experiment names no sphere; the momentum of an impact needs mass and radius")
    times = since + np.sqrt(2 * height / chosen.gravity.value)
    body = (solid, sphere.radius.value, sphere.mass.value, height, float(times[-1]))
    scheme = (chosen.solver, chosen.profile, chosen.rtol)
    flat = counter_body_of(settings.counter_body)
    options = {"gravity": chosen.gravity.value, "plate": plate, "substrate": flat, "times": times, "full": full}
    return contact.drop(*body, *scheme, **options)


def _heard(
    settings: PlateVibration, i: int, solid: Prony, plate: contact.Plate | None, frequency: float, zeta: float
) -> tuple[float, float]:
    """Momentum [N s] that the plate listens to, and the time [s] from first touch to the blow of no duration.

    A force F(s) leaves the ringing Im[exp(i w t) int F(s) exp((r - i w) s) ds] exp(-r t) / (m w);
    its phase is the time of the equivalent blow, and its modulus, decayed until then, the momentum.
    """
    s = np.arange(0.0, 6e-3, 4e-6)  # any contact ends before; it gets 250 points
    force = _simulated(settings, i, solid, plate, s)["force"].values
    rate, damped = zeta * 2 * np.pi * frequency, 2 * np.pi * frequency * np.sqrt(1 - zeta**2)
    whole = np.trapezoid(force * np.exp((rate - 1j * damped) * s), s)
    blow = float(-np.angle(whole) / damped)
    return float(np.abs(whole) * np.exp(-rate * blow)), blow


def model(
    table: xr.Dataset,
    plate: xr.Dataset,
    fitted: Sequence[xr.Dataset | None],
    *,
    settings: PlateVibration,
    full: bool = False,
    around: tuple[float, float] = (-3e-3, 60e-3),
    step: float = 5e-5,
) -> xr.Dataset:
    """Simulate every drop on the plate that was found, as the laser should have seen it around the blow [s].

    ``full`` takes the simulator's shortcuts away; the numbers stay the same within ``rtol``.
    """
    mass, frequency, zeta = (float(plate[name]) for name in ("mass", "frequency", "damping_ratio"))
    if not np.isfinite(mass):
        raise InputError(
            "no modal mass is known for the simulation; name the sphere, with radius and mass, and "
            "a DMA experiment (material_from) or a material of the library"
        )
    found, time = contact.Plate(mass, frequency, zeta), np.arange(*around, step)
    moved = np.full((table.sizes["series"], time.size), np.nan)
    for i, solid in _known(settings, fitted).items():
        since = time + _heard(settings, i, solid, found, frequency, zeta)[1]
        moved[i] = -_simulated(settings, i, solid, found, since, full)["plate_displacement"].values
    made = xr.Dataset(coords={"series": table["series"], "time": ("time", time, described("s", "time since impact"))})
    return made.assign(displacement=variable(("series", "time"), moved, "m", "simulated displacement of the plate"))
