"""The largest contact radius of an impact, between the frames of a film or of a curve."""

from typing import NamedTuple

import numpy as np

from labpipe.arrays import Floats

STILL = 20e-3  # s of contact after which it is rest, not an impact
WINDOW = 3e-3  # s around the largest radius in which film and model are compared
# Frames on either side of the largest and degree of the polynomial through them, the best first. In
# simulated impacts of four polymers at 10,000 frames a second five frames and degree 2, 3 lie 0.06,
# 0.03 % low (worst 0.16, 0.10), seven and degree 4 0.01 % high (worst 0.09); noise of 1 µm scatters
# all of them by 0.07 to 0.08 %.
_FITS = ((3, 4), (2, 3), (1, 2))
BESIDE = _FITS[0][0]
_PARABOLA = 0.1  # of the steps between three frames beside a missing one, what their parabola leaves open
_REAL = 1e-9  # imaginary part of a root that is real


class Peak(NamedTuple):
    """The largest radius [m] of an impact, its time [s], and two standard uncertainties of it.

    ``u`` is that of the frames, ``sampling`` that of the course between them.
    """

    time: float
    radius: float
    u: float
    sampling: float = 0.0


def peak_of(time: Floats, a: Floats, u: Floats) -> Peak:
    """Find the largest radius by a polynomial through a² of the frames around the largest.

    a² goes with the approach, which passes its largest value smoothly; a itself does not. How far
    fewer frames and a lower degree end elsewhere tells what the frames leave open between them.
    """
    is_known = np.isfinite(a)
    time, a, u = time[is_known], a[is_known], u[is_known]
    top = int(np.argmax(a))
    windows = [(top - beside, top + beside + 1, degree) for beside, degree in _FITS]
    found = [p for window in windows if (p := _fitted(time, a, u, top, *window))]
    if not found:  # a frame beside the largest could not be read: the three nearest, wherever they lie
        return _of_few(time, a, u, top)
    best, lower, *_ = *found, Peak(float(time[top]), float(a[top]), float(u[top]))
    return best._replace(sampling=abs(best.radius - lower.radius) / np.sqrt(3.0))


def _of_few(time: Floats, a: Floats, u: Floats, top: int) -> Peak:
    """Find the largest radius where frames beside the largest are missing, by the three nearest."""
    alone = Peak(float(time[top]), float(a[top]), float(u[top]))
    low, high = max(0, top - 1), min(len(a), top + 2)
    steps = float(np.ptp(a[low:high])) / np.sqrt(12.0)
    first = min(low, max(0, len(a) - 3))
    found = _fitted(time, a, u, top, first, first + 3, 2)
    if found is None:
        return alone._replace(sampling=steps)
    # the parabola may cross the largest frame by chance
    sampling = max(abs(found.radius - alone.radius) / np.sqrt(3.0), _PARABOLA * steps)
    return found._replace(sampling=sampling)


def _fitted(time: Floats, a: Floats, u: Floats, top: int, low: int, high: int, degree: int) -> Peak | None:
    """Fit the frames from low to before high; nothing where they are too few or have no maximum."""
    if low < 0 or high > len(a):
        return None
    x, near = time[low:high] - time[top], a[low:high]
    scale = float(np.max(np.abs(x)))
    weights = 1 / np.maximum(2 * near * u[low:high], 1e-18)
    fit = np.polyfit(x / scale, near**2, degree, w=weights)
    place = _summit(fit)
    if place is None:
        return None
    rest = near - np.sqrt(np.maximum(np.polyval(fit, x / scale), 0))
    scatter = float(np.sqrt(np.sum(rest**2) / max(high - low - degree - 1, 1)))
    value = float(np.sqrt(np.polyval(fit, place)))
    return Peak(float(time[top] + place * scale), value, max(float(u[top]), scatter))


def _summit(polynomial: Floats) -> float | None:
    """Return where a polynomial has its maximum between -1 and 1, the nearest to 0."""
    slope = np.polyder(polynomial)
    roots = [float(r.real) for r in np.roots(slope) if abs(r.imag) < _REAL]
    bend = np.polyder(slope)
    tops = [r for r in roots if abs(r) <= 1.0 and np.polyval(bend, r) < 0.0]
    return min(tops, key=abs) if tops else None
