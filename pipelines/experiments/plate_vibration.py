"""Plate vibration: frequency, damping and amplitude of the plate under falling spheres.

Each recording shows one drop: a first blow, free ringing until the sphere comes back, and more
blows. Only the free ringing is fitted (:func:`labpipe.signals._ringing`). Frequency and damping
belong to the plate, the amplitude to the impact; the plate's modal mass follows from the momentum
of a simulated impact. Upwards is positive, as for the sphere.
"""

import json
import warnings
from pathlib import Path

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.stats import chi2

import calibration
from calibration import laser
from labpipe import contact, materials, signals
from labpipe.errors import InputError
from labpipe.materials import Prony
from pipelines.experiments.laser_file import read_laser
from pipelines.settings.plate_vibration import Drops, PlateVibration

Array = NDArray[np.float64]

_COVERED = 6e-3  # s of simulation after first touch: any contact ends before
_FINE = 4e-6  # s, spacing of the simulated force: 250 points in a contact
_ROUNDS = 3  # the plate's yielding changes the blow by M/m: the rounds converge like its powers
_BEFORE, _AFTER = 3e-3, 60e-3  # s around the blow in which measurement and model are compared
_STEP = 5e-5  # s, of the compared curves
_LEAST_CHANGE = 1e-2  # relative change of an input by which a sensitivity is found
_PER_DROP = ("natural_frequency", "damping_ratio", "amplitude")
_UNITS = {"natural_frequency": "Hz", "damping_ratio": "1", "amplitude": "m", "modal_mass": "kg"}
_NAMES = {
    "natural_frequency": "natural frequency",
    "damping_ratio": "damping ratio",
    "amplitude": "amplitude at the blow",
    "modal_mass": "modal mass",
}


def readings(path: Path, *, settings: PlateVibration) -> xr.Dataset:
    """Read one laser export; what it leaves unsaid comes from the settings."""
    return read_laser(path, settings.keyence)


def displacement(readings: xr.Dataset, record: Path, *, settings: PlateVibration) -> xr.Dataset:
    """Correct the inclination: upward displacement of the plate, with uncertainty."""
    if settings.sensor.serial is not None:
        readings = readings.assign_attrs(serial=settings.sensor.serial)
    return laser.displacement(
        readings, calibration.load_record(record), output=settings.sensor.output,
        direction=settings.sensor.direction, measured=settings.measured_on,
    )  # fmt: skip


def ringing(displacement: xr.Dataset, *, settings: PlateVibration) -> xr.Dataset:
    """Fit the free ringing after the first blow."""
    moved = displacement["displacement"]
    found = signals.ringing(
        moved["time"].values, moved.values, noise=float(displacement.attrs["noise"]),
        longest_blow=settings.blow.longest.value, shortest_pause=settings.blow.pause.value,
    )  # fmt: skip
    fit = found.fit
    relative = float(displacement.attrs["u_systematic_relative"])
    values = {
        "natural_frequency": (fit.natural_frequency, fit.u_frequency),
        "damping_ratio": (fit.damping_ratio, fit.u_damping_ratio),
        "amplitude": (fit.amplitude, fit.u_amplitude),
    }
    made = xr.Dataset()
    for name, (value, u) in values.items():
        made[name] = _scalar(value, _UNITS[name], _NAMES[name])
        made[f"u_{name}"] = _scalar(u, _UNITS[name], f"random standard uncertainty: {_NAMES[name]}")
    for name, value, units, text in (
        ("blow_time", found.blow_time, "s", "time of the blow"),
        ("u_blow_time", found.u_blow_time, "s", "standard uncertainty: time of the blow"),
        ("onset_time", found.onset_time, "s", "time at which the motion is first seen"),
        ("free_from", found.free_from, "s", "begin of the free ringing"),
        ("free_to", found.free_to, "s", "end of the free ringing"),
        ("chi_square", found.chi_square, "1", "scatter about the fit over the noise, squared"),
        ("phase", fit.phase, "rad", "phase at the blow"),
        ("largest", float(np.nanmax(np.abs(moved.values))), "m", "largest single reading"),
    ):
        made[name] = _scalar(value, units, text)
    count = int(((moved["time"] >= found.free_from) & (moved["time"] <= found.free_to)).sum())
    work = {"readings_fitted": count, "readings_total": int(moved.size)}
    u_clock = float(json.loads(displacement.attrs["time_base"])["u_relative"])
    return made.assign_attrs(
        u_systematic_relative=relative, u_clock_relative=u_clock, work=json.dumps(work)
    )


def _scalar(value: float, units: str, text: str) -> xr.DataArray:
    return xr.DataArray(float(value), attrs={"units": units, "long_name": text})


def table(ringing: list[xr.Dataset], *, settings: PlateVibration) -> xr.Dataset:
    """Gather the repeats by material and height, and pool what belongs to the plate."""
    groups = _groups(ringing, settings)
    made = xr.Dataset(coords={"series": np.arange(1, len(groups) + 1)})
    made["series"].attrs = {"units": "1", "long_name": "number of the drops"}
    heights = [drops.height for drops in settings.drops]
    made["material"] = ("series", [d.material for d in settings.drops], _text("material"))
    made["height"] = ("series", [h.value for h in heights], _attrs("m", "drop height"))
    made["u_height"] = (
        "series", [h.u for h in heights], _attrs("m", "standard uncertainty: drop height"),
    )  # fmt: skip
    made["n"] = ("series", [len(group) for group in groups], _attrs("1", "recordings"))
    relative = float(ringing[0].attrs["u_systematic_relative"])
    for name in _PER_DROP:
        pairs = [_mean(group, name) for group in groups]
        value, u = (np.array(part) for part in zip(*pairs, strict=True))
        if name == "amplitude":  # inclination and gain are the same in every recording
            u = np.hypot(u, relative * value)
        units, text = _UNITS[name], _NAMES[name]
        made[name] = ("series", value, _attrs(units, f"{text}, mean of the repeats"))
        made[f"u_{name}"] = ("series", u, _attrs(units, f"standard uncertainty: {text}"))
    for name in ("natural_frequency", "damping_ratio"):
        made = made.merge(_pooled(made[name].values, made[f"u_{name}"].values, name))
    # the sensor's clock is the same in all recordings
    u_clock = float(ringing[0].attrs["u_clock_relative"])
    own = float(made["u_plate_natural_frequency"])
    made["u_plate_natural_frequency"] = _scalar(
        np.hypot(own, u_clock * float(made["plate_natural_frequency"])), "Hz",
        f"standard uncertainty: {_NAMES['natural_frequency']}",
    )  # fmt: skip
    return made.assign_attrs(u_systematic_relative=relative)


def _groups(ringing: list[xr.Dataset], settings: PlateVibration) -> list[list[xr.Dataset]]:
    """Deal the recordings out to their drops."""
    remaining = iter(ringing)
    return [[next(remaining) for _ in drops.laser] for drops in settings.drops]


def _attrs(units: str, text: str) -> dict[str, str]:
    return {"units": units, "long_name": text}


def _text(text: str) -> dict[str, str]:
    return _attrs("1", text)


def _mean(group: list[xr.Dataset], name: str) -> tuple[float, float]:
    """Mean of the repeats; its uncertainty is never less than what each repeat states."""
    values = np.array([float(one[name]) for one in group])
    stated = np.sqrt(np.mean([float(one[f"u_{name}"]) ** 2 for one in group]))
    scatter = float(np.std(values, ddof=1)) if len(values) > 1 else 0.0
    return float(values.mean()), float(max(scatter, stated) / np.sqrt(len(values)))


def _pooled(values: Array, u: Array, name: str) -> xr.Dataset:
    """Weighted mean over all drops, and the probability that they differ as much by chance."""
    mean, u_mean, ratio = weighted_mean(values, u)
    probability = float(chi2.sf(ratio * (len(values) - 1), len(values) - 1)) if len(u) > 1 else 1.0
    units, text = _UNITS[name], _NAMES[name]
    return xr.Dataset(
        {
            f"plate_{name}": _scalar(mean, units, f"{text}, all drops"),
            f"u_plate_{name}": _scalar(u_mean, units, f"standard uncertainty: {text}"),
            f"probability_{name}": _scalar(
                probability, "1", f"of so large a difference by chance: {text}"
            ),
        }
    )


def weighted_mean(values: Array, u: Array) -> tuple[float, float, float]:
    """Weighted mean, its uncertainty enlarged by a scatter that the parts do not explain.

    Returns
    -------
    mean, u_mean, ratio : float
        ``ratio`` is the reduced chi-square (1 when there is but one value).

    Examples
    --------
    >>> import numpy as np
    >>> mean, u, ratio = weighted_mean(np.array([1.0, 3.0]), np.array([1.0, 1.0]))
    >>> mean, round(u, 3), ratio
    (2.0, 1.0, 2.0)
    """
    weights = 1.0 / u**2
    mean = float(np.sum(weights * values) / np.sum(weights))
    freedom = len(values) - 1
    ratio = float(np.sum(weights * (values - mean) ** 2) / freedom) if freedom else 1.0
    return mean, float(np.sqrt(max(1.0, ratio) / np.sum(weights))), ratio


def plate(table: xr.Dataset, *, settings: PlateVibration) -> xr.Dataset:
    """Find the plate's modal mass from amplitude and momentum: m = J / (A omega).

    J is the part of the simulated force that the plate listens to, the modulus of its transform at
    the plate's damped frequency; the plate's own yielding is part of the simulation.
    """
    made = xr.Dataset(
        {
            name: table[f"{prefix}plate_{kept}"].assign_attrs(table[f"{prefix}plate_{kept}"].attrs)
            for prefix in ("", "u_")
            for name, kept in (
                (f"{prefix}frequency", "natural_frequency"),
                (f"{prefix}damping_ratio", "damping_ratio"),
            )
        }
    )
    known = _known(settings)
    if settings.sphere is None or not known:
        nothing = np.nan
        made["mass"] = _scalar(nothing, "kg", _NAMES["modal_mass"])
        made["u_mass"] = _scalar(nothing, "kg", f"standard uncertainty: {_NAMES['modal_mass']}")
        return made
    frequency, zeta = float(made["frequency"]), float(made["damping_ratio"])
    amplitude = table["amplitude"].values[list(known)]
    damped = 2 * np.pi * frequency * np.sqrt(1 - zeta**2)
    mass, solves = np.inf, 0
    for _ in range(_ROUNDS):
        substrate = None if np.isinf(mass) else contact.Plate(mass, frequency, zeta)
        heard = np.array([
            _momentum(settings, solid, settings.drops[i].height.value, substrate, frequency, zeta)
            for i, solid in known.items()
        ])  # fmt: skip
        solves += len(known)
        each = heard / (amplitude * damped)
        u_each = each * _relative_uncertainty(table, settings, list(known))
        mass, u_mass, _ = weighted_mean(each, u_each)
    shared = float(table.attrs["u_systematic_relative"])
    shared = float(np.hypot(shared, settings.sphere.mass.u / settings.sphere.mass.value))
    made["mass"] = _scalar(mass, "kg", _NAMES["modal_mass"])
    made["u_mass"] = _scalar(
        np.hypot(u_mass, shared * mass), "kg", f"standard uncertainty: {_NAMES['modal_mass']}"
    )
    full = np.full((2, table.sizes["series"]), np.nan)
    full[0, list(known)], full[1, list(known)] = each, u_each
    made["modal_mass"] = ("series", full[0], _attrs("kg", "modal mass by each of the drops"))
    made["u_modal_mass"] = ("series", full[1], _attrs("kg", "standard uncertainty: modal mass"))
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


def _relative_uncertainty(table: xr.Dataset, settings: PlateVibration, chosen: list[int]) -> Array:
    """Relative uncertainty of the masses from amplitude and height, different in each of them.

    The momentum goes with the square root of the height.
    """
    part = table.isel(series=chosen)
    shared = float(table.attrs["u_systematic_relative"]) * part["amplitude"].values
    own = np.sqrt(np.maximum(part["u_amplitude"].values ** 2 - shared**2, 0.0))
    heights = [settings.drops[i].height for i in chosen]
    by_height = np.array([0.5 * h.u / h.value for h in heights])
    return np.hypot(own / part["amplitude"].values, by_height)


def _momentum(
    settings: PlateVibration, solid: Prony, height: float, substrate: contact.Plate | None,
    frequency: float, zeta: float,
) -> float:  # fmt: skip
    """Momentum [N s] that the plate listens to, stated at the time of the blow."""
    heard, _ = _transform(settings, solid, height, substrate, frequency, zeta)
    return heard


def _transform(
    settings: PlateVibration, solid: Prony, height: float, substrate: contact.Plate | None,
    frequency: float, zeta: float,
) -> tuple[float, float]:  # fmt: skip
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
        solid, body.radius.value, body.mass.value, height, float(times[-1]),
        settings.model.solver, settings.model.profile, settings.model.rtol, gravity=gravity,
        plate=substrate, times=times,
    )  # fmt: skip
    s, force = times - fall, made["force"].values
    omega = 2 * np.pi * frequency
    rate, damped = zeta * omega, omega * np.sqrt(1 - zeta**2)
    whole = np.trapezoid(force * np.exp((rate - 1j * damped) * s), s)
    blow = float(-np.angle(whole) / damped)
    return float(np.abs(whole) * np.exp(-rate * blow)), blow


def model(
    table: xr.Dataset, plate: xr.Dataset, *, settings: PlateVibration, full: bool = False
) -> xr.Dataset:
    """Simulate every drop on the plate that was found: what the laser should have seen.

    ``full`` takes the simulator's shortcuts away; the numbers stay the same within ``rtol``.
    """
    mass = float(plate["mass"])
    if not np.isfinite(mass) or settings.sphere is None:
        message = (
            "there is no modal mass to simulate with; name the sphere, with radius and mass, and "
            "a material of the library"
        )
        raise InputError(message)
    found = contact.Plate(mass, float(plate["frequency"]), float(plate["damping_ratio"]))
    time = np.arange(-_BEFORE, _AFTER, _STEP)
    curves = np.full((table.sizes["series"], time.size), np.nan)
    body, gravity = settings.sphere, settings.model.gravity.value
    for i, solid in _known(settings).items():
        height = settings.drops[i].height.value
        _, blow = _transform(settings, solid, height, found, found.frequency, found.damping_ratio)
        start = float(np.sqrt(2 * height / gravity)) + blow
        times = time + start
        made = contact.drop(
            solid, body.radius.value, body.mass.value, height, float(times[-1]),
            settings.model.solver, settings.model.profile, settings.model.rtol,
            gravity=gravity, plate=found, times=times,
            fold=not full, shortcuts=contact.Shortcuts.chosen(full=full),
        )  # fmt: skip
        curves[i] = -made["plate_displacement"].values
    return xr.Dataset(
        {
            "displacement": (
                ("series", "time"), curves, _attrs("m", "simulated displacement of the plate"),
            )
        },
        coords={
            "series": table["series"],
            "time": ("time", time, _attrs("s", "time since the blow")),
        },
    )  # fmt: skip


def comparison(
    displacement: list[xr.Dataset],
    ringing: list[xr.Dataset],
    table: xr.Dataset,
    model: xr.Dataset,
    *,
    settings: PlateVibration,
) -> xr.Dataset:
    """Compare the mean of the repeats with the simulation, each counted from its blow."""
    del settings
    time = model["time"].values
    curves, first = [], 0
    for count in table["n"].values.astype(int):
        shifted = [
            np.interp(
                time + float(r["blow_time"]), d["time"].values, d["displacement"].values,
                left=np.nan, right=np.nan,
            )
            for d, r in zip(
                displacement[first : first + count], ringing[first : first + count], strict=True
            )
        ]  # fmt: skip
        curves.append(np.mean(shifted, axis=0))
        first += count
    measured = np.array(curves)
    theirs = model["displacement"].values
    errors = np.array([_error(a, b) for a, b in zip(measured, theirs, strict=True)])
    bias = np.nanmean(measured - theirs, axis=1)
    return xr.Dataset(
        {
            "measured": (
                ("series", "time"), measured, _attrs("m", "displacement, mean of the repeats"),
            ),
            "model": (("series", "time"), theirs, _attrs("m", "simulated displacement")),
            "nrmse": ("series", errors, _attrs("1", "root-mean-square error over the range")),
            "bias": ("series", bias, _attrs("m", "mean of measured minus model")),
        },
        coords={"series": table["series"], "time": model["time"]},
    )  # fmt: skip


def _error(measured: Array, theirs: Array) -> float:
    both = np.isfinite(measured) & np.isfinite(theirs)
    return signals.nrmse(measured[both], theirs[both]) if both.any() else np.nan


def drops_label(drops: Drops) -> str:
    """Name of one row: ``acrylic, 1.5 mm``."""
    return f"{drops.material}, {drops.height.value * 1e3:g} mm"
