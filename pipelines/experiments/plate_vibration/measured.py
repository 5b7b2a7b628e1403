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

OF_PLATE = {"natural_frequency": ("Hz", "natural frequency"), "damping_ratio": ("1", "damping ratio")}
"""Unit and name of what all drops have in common."""
_OF_DROP = OF_PLATE | {"amplitude": ("m", "amplitude at impact")}


def ringing(
    displacement: xr.Dataset, *, settings: PlateVibration, impact: float = 4e-3, pause: float = 15e-3
) -> xr.Dataset:
    """Fit the free ringing after the first blow, with the longest impact and the shortest pause that are expected [s].

    A contact lasts 1 ms, and a sphere from 1.5 mm that keeps half of its speed is back after 17 ms.
    """
    del settings
    moved, attrs = displacement["displacement"], displacement.attrs
    limits = {"longest_impact": impact, "shortest_pause": pause}
    found = signals.ringing(moved["time"].values, moved.values, noise=float(attrs["noise"]), **limits)
    made = with_u("blow_time", (), found.blow_time, found.u_blow_time, "s", "time of impact")
    us = (found.fit.u_frequency, found.fit.u_damping_ratio, found.fit.u_amplitude)
    for (name, (units, text)), u in zip(_OF_DROP.items(), us, strict=True):
        made |= with_u(name, (), getattr(found.fit, name), u, units, text, "(random)")
    for name, units, text in (
        ("onset_time", "s", "first motion"),
        ("free_from", "s", "start of the free vibration"),
        ("free_to", "s", "end of the free vibration"),
        ("chi_square", "1", "scatter about the fit over the noise, squared"),
    ):
        made[name] = variable((), getattr(found, name), units, text)
    u_clock = float(json.loads(attrs["time_base"])["u_relative"])
    return xr.Dataset(made, attrs={"u_systematic_relative": attrs["u_systematic_relative"], "u_clock": u_clock})


def table(ringing: list[xr.Dataset], *, settings: PlateVibration) -> xr.Dataset:
    """Gather the repeats by material and height, and pool the frequency and damping of the plate."""
    remaining = iter(ringing)
    groups = [[next(remaining) for _ in drops.laser] for drops in settings.drops]
    heights = [drops.height for drops in settings.drops]
    relative, u_clock = (float(ringing[0].attrs[name]) for name in ("u_systematic_relative", "u_clock"))
    made = with_u("height", "series", [h.value for h in heights], [h.u for h in heights], "m", "drop height")
    made["material"] = variable("series", [drops.material for drops in settings.drops], "1", "material")
    made["n"] = variable("series", list(map(len, groups)), "1", "recordings")
    for name, (units, text) in _OF_DROP.items():
        each = [np.array([(float(one[name]), float(one[f"u_{name}"])) for one in group]).T for group in groups]
        value, n = np.array([values.mean() for values, _ in each]), made["n"][1]
        scatter = [np.std(values, ddof=int(values.size > 1)) for values, _ in each]
        u = np.maximum(scatter, [np.sqrt(np.mean(own**2)) for _, own in each]) / np.sqrt(n)
        if name == "amplitude":  # inclination and gain are the same in every recording
            u = np.hypot(u, relative * value)
        made |= with_u(name, "series", value, u, units, f"{text}, mean of the repeats")
        if name not in OF_PLATE:
            continue
        mean, u_mean, ratio = weighted_mean(value, u)
        if name == "natural_frequency":  # the sensor's clock is the same in all recordings
            u_mean = float(np.hypot(u_mean, u_clock * mean))
        made |= with_u(f"plate_{name}", (), mean, u_mean, units, f"{text}, all drops")
        freedom = len(value) - 1
        chance = float(chdtrc(freedom, ratio * freedom)) if freedom else 1.0
        made[f"probability_{name}"] = variable((), chance, "1", f"probability of so large a difference: {text}")
    series = {"series": ("series", np.arange(1, len(groups) + 1), described("1", "number of the drops"))}
    return xr.Dataset(made, series, {"u_systematic_relative": relative})


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
