"""Plate vibration: frequency, damping and amplitude of the plate under falling spheres.

Each recording shows one drop: a first blow, free ringing until the sphere comes back, and more
blows. Only the free ringing is fitted (:func:`labpipe.signals._ringing`). Frequency and damping
belong to the plate, the amplitude to the impact; the plate's modal mass follows from the momentum
of a simulated impact. Upwards is positive, as for the sphere.
"""

import json

import numpy as np
import xarray as xr
from scipy.special import chdtrc

from labpipe import signals
from labpipe.arrays import Floats
from labpipe.variables import described, variable, with_u
from pipelines.experiments.plate_vibration.settings import Drops, PlateVibration

LONGEST_IMPACT, SHORTEST_FLIGHT = 4e-3, 15e-3
"""s; a contact lasts 1 ms, and a sphere from 1.5 mm that keeps half of its speed is back after 17 ms."""
_UNITS = {"natural_frequency": "Hz", "damping_ratio": "1", "amplitude": "m", "modal_mass": "kg"}
NAMES = {
    "natural_frequency": "natural frequency",
    "damping_ratio": "damping ratio",
    "amplitude": "amplitude at impact",
    "modal_mass": "modal mass",
}


def ringing(displacement: xr.Dataset, *, settings: PlateVibration) -> xr.Dataset:
    """Fit the free ringing after the first blow."""
    moved = displacement["displacement"]
    del settings
    noise = float(displacement.attrs["noise"])
    time = moved["time"].values
    found = signals.ringing(
        time, moved.values, noise=noise, longest_impact=LONGEST_IMPACT, shortest_pause=SHORTEST_FLIGHT
    )
    fit = found.fit
    relative = float(displacement.attrs["u_systematic_relative"])
    made = xr.Dataset(with_u("blow_time", (), found.blow_time, found.u_blow_time, "s", "time of impact"))
    for name, value, u in (
        ("natural_frequency", fit.natural_frequency, fit.u_frequency),
        ("damping_ratio", fit.damping_ratio, fit.u_damping_ratio),
        ("amplitude", fit.amplitude, fit.u_amplitude),
    ):
        made = made.assign(with_u(name, (), value, u, _UNITS[name], NAMES[name], "(random)"))
    for name, value, units, text in (
        ("onset_time", found.onset_time, "s", "time at which the motion is first seen"),
        ("free_from", found.free_from, "s", "start of the free vibration"),
        ("free_to", found.free_to, "s", "end of the free vibration"),
        ("chi_square", found.chi_square, "1", "scatter about the fit over the noise, squared"),
        ("phase", fit.phase, "rad", "phase at impact"),
    ):
        made[name] = variable((), value, units, text)
    count = int(((moved["time"] >= found.free_from) & (moved["time"] <= found.free_to)).sum())
    work = {"readings_fitted": count, "readings_total": int(moved.size)}
    u_clock = float(json.loads(displacement.attrs["time_base"])["u_relative"])
    return made.assign_attrs(u_systematic_relative=relative, u_clock_relative=u_clock, work=json.dumps(work))


def table(ringing: list[xr.Dataset], *, settings: PlateVibration) -> xr.Dataset:
    """Gather the repeats by material and height, and pool the frequency and damping of the plate."""
    remaining = iter(ringing)
    groups = [[next(remaining) for _ in drops.laser] for drops in settings.drops]
    made = xr.Dataset(coords={"series": np.arange(1, len(groups) + 1)})
    made["series"].attrs = described("1", "number of the drops")
    heights = [drops.height for drops in settings.drops]
    made["material"] = variable("series", [d.material for d in settings.drops], "1", "material")
    made = made.assign(
        with_u("height", "series", [h.value for h in heights], [h.u for h in heights], "m", "drop height")
    )
    made["n"] = variable("series", [len(group) for group in groups], "1", "recordings")
    relative, u_clock = (float(ringing[0].attrs[name]) for name in ("u_systematic_relative", "u_clock_relative"))
    for name in ("natural_frequency", "damping_ratio", "amplitude"):
        means, units, text = np.array([_mean(group, name) for group in groups]), _UNITS[name], NAMES[name]
        value, u = means.T
        if name == "amplitude":  # inclination and gain are the same in every recording
            u = np.hypot(u, relative * value)
        made = made.assign(with_u(name, "series", value, u, units, f"{text}, mean of the repeats"))
        if name == "amplitude":
            continue
        mean, u_mean, ratio = weighted_mean(value, u)
        if name == "natural_frequency":  # the sensor's clock is the same in all recordings
            u_mean = float(np.hypot(u_mean, u_clock * mean))
        made = made.assign(with_u(f"plate_{name}", (), mean, u_mean, units, f"{text}, all drops"))
        freedom = len(value) - 1
        chance = float(chdtrc(freedom, ratio * freedom)) if freedom else 1.0
        text = f"probability of so large a difference by chance: {text}"
        made[f"probability_{name}"] = variable((), chance, "1", text)
    return made.assign_attrs(u_systematic_relative=relative)


def _mean(group: list[xr.Dataset], name: str) -> tuple[float, float]:
    """Return the mean of the repeats; its uncertainty is at least that of the repeats."""
    values = np.array([float(one[name]) for one in group])
    stated = np.sqrt(np.mean([float(one[f"u_{name}"]) ** 2 for one in group]))
    scatter = float(np.std(values, ddof=1)) if len(values) > 1 else 0.0
    return float(values.mean()), float(max(scatter, stated) / np.sqrt(len(values)))


def weighted_mean(values: Floats, u: Floats) -> tuple[float, float, float]:
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


def drops_label(drops: Drops) -> str:
    """Name of one row: ``acrylic, 1.5 mm``."""
    return f"{drops.material}, {drops.height.value * 1e3:g} mm"
