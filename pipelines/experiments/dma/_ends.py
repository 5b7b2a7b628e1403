"""The moduli of both ends of a master curve, relaxed and unrelaxed, as far as the data there determine them."""

from math import hypot, inf, nan, pi, sqrt, tan
from typing import Any

import numpy as np
import xarray as xr

from labpipe.arrays import Floats
from labpipe.variables import with_u

_SLOW_DECADES = 2.0  # at the slow end, over which the loss tells how it goes on


def ends(curve: xr.Dataset, scale: float) -> dict[str, Any]:
    """Return ``relaxed_modulus`` and ``unrelaxed_modulus`` [Pa], each with its standard uncertainty.

    Both are NaN where the loss at that end is so large that the storage modulus may still change by
    all of itself: the series' modulus is extrapolated there. The uncertainty is that of
    extrapolating the loss, of the noise at the end, and `scale`, the relative one of all moduli.
    """
    frequency = curve["reduced_frequency"].values
    found: dict[str, Any] = {}
    for name, ratio in (("relaxed", frequency), ("unrelaxed", 1.0 / frequency)):
        # Mirrored, the loss of the fast end falls as that of the slow one does.
        left = still_falls(ratio, curve["master_loss"].values)
        last, u_last = (float(curve[part][int(np.argmin(ratio))]) for part in ("master_storage", "u_master_storage"))
        modulus = float(curve[f"E_{name}"]) if left < last else nan
        u = hypot(left / sqrt(3.0), modulus * u_last / last, modulus * scale) if left < last else nan
        found |= with_u(f"{name}_modulus", (), modulus, u, "Pa", f"{name} modulus, where the data determine it")
    return found


def still_falls(frequency: Floats, loss: Floats) -> float:
    """Return how far [Pa] the storage modulus falls beyond the slow end, if the loss goes on so.

    A loss that falls as the power m of the frequency belongs to a storage modulus that lies
    E″ cot(m π/2) above its end (Kramers and Kronig). What does not fall ends nowhere.
    """
    order = np.argsort(frequency)
    f, e = frequency[order], loss[order]
    near = f <= f[0] * 10.0**_SLOW_DECADES
    if near.sum() < 2 or not np.all(e[near] > 0.0):
        return inf
    power = float(np.polyfit(np.log(f[near]), np.log(e[near]), 1)[0])
    if power <= 0.0:
        return inf
    return float(e[0]) / tan(0.5 * pi * min(power, 1.0))
