r"""Bounces of a sphere whose contacts are integrated by Ting's equations: motions to try the analysis on.

The relaxation modulus has no exponentials, :math:`E^*(t) = E_\infty + E_1 (1 + t/\tau)^{-\beta}`. While the
contact grows (Lee and Radok), :math:`F = \frac43 \sqrt R \int_0^t E^*(t - s)\,d\delta^{3/2}(s)`; while it
shrinks (Ting), the integral ends at the earlier time :math:`t_1` with
:math:`\int_{t_1}^t E^*(t - s)\,\dot\delta(s)\,ds = 0`. Both are summed over the whole history, in pieces
over which the indentation (in the second) and its power 3/2 (in the first) are linear. Every contact begins
on a surface that has recovered, and the floor is rigid.
"""

from dataclasses import dataclass

import numpy as np

from labpipe.arrays import Floats

RADIUS, MASS, GRAVITY = 9.525e-3, 0.505, 9.81
_STEPS = 1200  # in the duration of a contact without losses
_LONGEST = 6  # such durations, within which every contact ends


@dataclass(frozen=True, slots=True)
class Solid:
    """E* relaxes from ``rest + extra`` to ``rest`` [Pa], around the time ``tau`` [s], with the power ``beta``."""

    rest: float
    extra: float
    tau: float
    beta: float

    def integral(self, time: Floats) -> Floats:
        """Return the integral of E* [Pa s] from 0 to times (n,) [s]."""
        power = 1.0 - self.beta
        grown = ((1.0 + time / self.tau) ** power - 1.0) * self.tau / power
        return np.asarray(self.rest * time + self.extra * grown)


@dataclass(frozen=True, slots=True)
class Motion:
    """A fall and its bounces: downward arcs and contacts as one path; times in s from the release.

    ``time``, ``height`` and ``speed`` (n,) [m, m/s], upwards, are dense enough in contacts for a cubic
    (Hermite) between them, and exact in flights.
    """

    time: Floats
    height: Floats
    speed: Floats
    touch: Floats
    liftoff: Floats
    incoming: Floats
    outgoing: Floats

    def at(self, time: Floats) -> tuple[Floats, Floats]:
        """Return height and speed at times (m,) [s]; at rest before the release."""
        t = np.clip(time, 0.0, self.time[-1])
        i = np.clip(np.searchsorted(self.time, t, side="right") - 1, 0, self.time.size - 2)
        step = self.time[i + 1] - self.time[i]
        x = (t - self.time[i]) / step
        a, b = self.height[i], self.height[i + 1]
        u, v = step * self.speed[i], step * self.speed[i + 1]
        c, d = 3 * (b - a) - 2 * u - v, 2 * (a - b) + u + v
        return a + x * (u + x * (c + x * d)), (u + x * (2 * c + 3 * x * d)) / step


def impact(solid: Solid, speed: float, steps: int = _STEPS) -> tuple[Floats, Floats, Floats]:
    """Integrate one contact; return time from touch, indentation, and its rate (n,), the last at lift-off."""
    stiff = solid.rest + solid.extra
    step = 2.87 * (MASS**2 / (RADIUS * stiff**2 * speed)) ** 0.2 / steps
    size = _LONGEST * steps
    passed = solid.integral(np.arange(size + 1) * step) / step
    kernel = np.diff(passed)  # mean of E* over a piece of the history, by the steps since its end
    depth, rate, force, margin = np.zeros(size), np.zeros(size), 0.0, 0.0
    rate[0] = speed
    for n in range(1, size):
        before, earlier = GRAVITY - force / MASS, margin
        depth[n] = depth[n - 1] + step * (rate[n - 1] + 0.5 * step * before)
        force, margin = _force(solid, step, depth[: n + 1], kernel[:n][::-1])
        rate[n] = rate[n - 1] + 0.5 * step * (before + GRAVITY - force / MASS)
        if margin <= 0.0:  # lifted off since the step before
            share = earlier / (earlier - margin)
            path = np.stack([step * np.arange(n + 1.0), depth[: n + 1], rate[: n + 1]])
            path[:, -1] = path[:, -2] + share * (path[:, -1] - path[:, -2])
            return path[0], path[1], path[2]
    message = f"the contact lasts longer than {size} steps"
    raise RuntimeError(message)


def _force(solid: Solid, step: float, depth: Floats, kernel: Floats) -> tuple[float, float]:
    """Return the force at the end of a history [N], and by how much the contact lasts (negative: it is over)."""
    moved, root = np.diff(depth), np.maximum(depth, 0.0) ** 1.5
    peak, n = int(np.argmax(depth)), len(depth) - 1
    scale = 4.0 / 3.0 * np.sqrt(RADIUS)
    # of Ting's condition, from every earlier time on; the contact is as wide as where it is nothing
    since = np.cumsum((moved * kernel)[::-1])[::-1]
    if peak == n:
        return float(scale * np.diff(root) @ kernel), float(since[0])
    rising = np.flatnonzero(since[:peak] > 0.0)
    if not rising.size:
        return 0.0, float(since[0])
    last = int(rising[-1])
    share = float(since[last] / (since[last] - since[last + 1]))  # of the piece that counts in part
    late = float(np.diff(solid.integral((n - last - np.array([share, 0.0])) * step))[0]) / (share * step)
    grown = max(depth[last] + share * moved[last], 0.0) ** 1.5 - root[last]
    return float(scale * (np.diff(root)[:last] @ kernel[:last] + late * grown)), float(since[0])


def bouncing(solid: Solid, height: float, duration: float, impacts: int = 3) -> Motion:
    """Drop the sphere and follow its first impacts, and the flight behind the last of them."""
    pieces = [np.array([[0.0, height, 0.0]])]
    begin, speed = float(np.sqrt(2.0 * height / GRAVITY)), float(np.sqrt(2.0 * GRAVITY * height))
    touches, liftoffs, ins, outs = [], [], [], []
    for _ in range(impacts):
        time, depth, rate = impact(solid, speed)
        pieces.append(np.stack([begin + time, -depth, -rate], axis=1))
        touches.append(begin)
        liftoffs.append(begin + float(time[-1]))
        ins.append(speed)
        outs.append(-float(rate[-1]))
        # up from below the surface at rest, and down to it
        speed = float(np.sqrt(outs[-1] ** 2 - 2.0 * GRAVITY * float(depth[-1])))
        begin = liftoffs[-1] + (outs[-1] + speed) / GRAVITY
    end = min(begin, duration)
    flown = end - liftoffs[-1]
    last = [end, pieces[-1][-1, 1] + outs[-1] * flown - 0.5 * GRAVITY * flown**2, outs[-1] - GRAVITY * flown]
    t, z, v = np.vstack([*pieces, [last]]).T
    return Motion(t, z, v, *(np.array(each) for each in (touches, liftoffs, ins, outs)))
