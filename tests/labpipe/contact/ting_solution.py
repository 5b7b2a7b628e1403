r"""Lee-Radok and Ting: a sphere on a viscoelastic half-space, by quadrature. An oracle.

Prescribed approach that rises to one maximum and falls. While the contact grows (Lee and Radok),

.. math:: a^2 = R\,\delta(t), \qquad
    F = \tfrac43 \sqrt R \int_0^t E^*(t - s)\,\mathrm d\,\delta^{3/2}(s);

while it shrinks (Ting) the contact is as wide as at an earlier time t₁, given by

.. math:: \int_{t_1}^t E^*(t - s)\,\delta'(s)\,\mathrm ds = 0, \qquad
    F = \tfrac43 \sqrt R \int_0^{t_1} E^*(t - s)\,\mathrm d\,\delta^{3/2}(s).

The relaxation form of the material and no springs: nothing here is shared with the solvers that it
checks.

References
----------
.. [1] E. H. Lee, J. R. M. Radok, J. Appl. Mech. 27 (1960) 438, https://doi.org/10.1115/1.3644020.
.. [2] T. C. T. Ting, J. Appl. Mech. 33 (1966) 845, https://doi.org/10.1115/1.3625192.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq

from labpipe.arrays import Floats
from labpipe.contact._memory import checked_history
from labpipe.errors import InputError
from labpipe.materials import Prony

_POINTS = 12
# A relaxation is followed from half its time to where it has died away, in panels that double.
_PANELS = 2.0 ** np.arange(-1, 7)
_ROOT_TOLERANCE = 1e-15


class TingResult(NamedTuple):
    """Force [N] and contact radius [m], both (time,), of :func:`ting`."""

    force: Floats
    contact_radius: Floats


def ting(material: Prony, radius: float, time: ArrayLike, approach: ArrayLike) -> TingResult:
    """Force and contact radius under a single rise and fall of the approach.

    ``approach`` (time,) [m] starts at 0, rises to one maximum, then falls; linear between strictly rising times [s].
    Other histories raise InputError.
    """
    times, depth = checked_history(time, approach, "approach")
    peak = int(np.argmax(depth))
    rises = np.all(np.diff(depth[: peak + 1]) >= 0.0) and np.all(np.diff(depth[peak:]) <= 0.0)
    if depth[0] != 0.0 or not rises or not np.all(np.diff(times) > 0.0):
        message = (
            "Ting's solution needs an approach that starts at 0, rises to one maximum and falls, "
            "at strictly rising times; use press_sphere for other histories"
        )
        raise InputError(message)
    segments = _Segments(times, depth, material)
    scale = 4.0 / 3.0 * np.sqrt(radius)
    force, width = np.zeros(times.size), np.zeros(times.size)
    for n, now in enumerate(times):
        since = now if n <= peak else segments.turning_time(n)
        if since > 0.0 or n <= peak:
            force[n] = scale * segments.force(float(since), float(now))
            width[n] = np.sqrt(radius * max(segments.depth_at(float(since)), 0.0))
    return TingResult(force, width)


class _Segments:
    """A piecewise linear approach and a sum of exponentials: all integrals in closed form."""

    def __init__(self, time: Floats, depth: Floats, material: Prony) -> None:
        self.time = time - time[0]
        self.depth = depth
        self.slope = np.diff(depth) / np.diff(time)
        factor = material.factor("contact")
        self.weight = factor * np.append(material.E, material.E_relaxed)
        self.rate = np.append(1.0 / material.rho, 0.0)
        self.start = float(time[0])
        self.nodes, self.weights = np.polynomial.legendre.leggauss(_POINTS)

    def depth_at(self, since: float) -> float:
        return float(np.interp(since - self.start, self.time, self.depth))

    def rate_integral(self, since: float, now: float) -> float:
        """∫ E*(now − s) δ′(s) ds from ``since`` to ``now`` (s, from the first sample)."""
        ends = np.clip(self.time, since, now)
        left, right = (now - ends[:-1])[:, None], (now - ends[1:])[:, None]
        with np.errstate(divide="ignore", invalid="ignore"):
            decayed = (np.exp(-right * self.rate) - np.exp(-left * self.rate)) / self.rate
        kernel = np.where(self.rate > 0.0, decayed, left - right)
        return float(self.slope @ kernel @ self.weight)

    def turning_time(self, n: int) -> float:
        """Return the time at which the contact was as wide as at sample n; the start if never."""
        now = float(self.time[n])
        peak = float(self.time[int(np.argmax(self.depth))])
        if self.depth[n] <= 0.0 and self.rate_integral(0.0, now) <= 0.0:
            return self.start
        if self.rate_integral(0.0, now) <= 0.0:
            return self.start
        root = brentq(self.rate_integral, 0.0, peak, args=(now,), xtol=_ROOT_TOLERANCE * now)
        return self.start + float(root)

    def force(self, since: float, now: float) -> float:
        """∫ E*(now − s) d δ^{3/2} from the start to ``since``, without the factor (4/3)√R."""
        end, now = since - self.start, now - self.start
        edges = self._edges(end, now)
        left, right = edges[:-1], edges[1:]
        slope = self.slope[np.searchsorted(self.time, left, side="right") - 1]
        base = np.interp(left, self.time, self.depth)
        # In r = sqrt(s − left) the root-like start of δ^{1/2} is smooth.
        half = 0.5 * np.sqrt(right - left)[:, None]
        r = half * (1.0 + self.nodes)
        depth = base[:, None] + slope[:, None] * r**2
        rise = 1.5 * np.sqrt(np.maximum(depth, 0.0)) * slope[:, None] * 2.0 * r
        lag = now - left[:, None] - r**2
        modulus = np.exp(-np.maximum(lag, 0.0)[..., None] * self.rate) @ self.weight
        return float(np.sum(half * self.weights * rise * modulus))

    def _edges(self, end: float, now: float) -> Floats:
        """Panels up to ``end`` in which neither the approach nor the modulus varies too fast."""
        lags = (_PANELS[:, None] / self.rate[self.rate > 0.0]).ravel()
        edges = np.concatenate([self.time, now - lags])
        edges = np.unique(edges[(edges > 0.0) & (edges < end)])
        return np.concatenate([[0.0], edges, [end]] if end > 0.0 else [[0.0]])
