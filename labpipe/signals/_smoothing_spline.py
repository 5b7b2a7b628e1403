"""An adaptive quintic smoothing spline, with its posterior uncertainty, in linear time.

The spline minimises ``sum (y - f)^2 / sigma^2 + integral lambda(t) f''''(t)^2 dt``. Knots are as close as the shortest
stretch whose fourth differences exceed the noise asks for (a flight: hundreds of samples; an impact: a few), and lambda
is estimated from the record (restricted likelihood, Fellner-Schall update) in a sliding window, so that a flight is
smoothed hard and an impact next to it is not blunted.

References
----------
S. N. Wood and M. Fasiolo, Biometrics 73 (2017) 1071, doi:10.1111/biom.12666 (the update);
D. Nychka, J. Am. Stat. Assoc. 83 (1988) 1134, doi:10.1080/01621459.1988.10478711 (the variance).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from labpipe.arrays import Floats
from labpipe.signals._spline_kernel import DEGREE, Indices, expanded, followed, moments, penalised

_LEAF = 4  # samples over which the distance of knots is the same
_CLOSEST = 2.0  # samples between knots
_SLOPE = 0.1  # by which the distance of knots may grow with that from closer ones
_MULTIPLICITY = DEGREE - 2, DEGREE - 1  # of knots at a contact, a release: derivative 3, 2 jumps
_ONE = np.arange(DEGREE + 1)


@dataclass(frozen=True, slots=True)
class Smooth:
    """A fitted spline with the covariance of its coefficients.

    ``breaks`` (interval + 1,) in units of ``time_scale`` from ``time_origin``; ``first`` (interval,) is the first of
    the six coefficients that count in one, by ``basis`` (interval, 6, 6); ``coefficients`` and their covariance, of
    which ``covariance`` (m, 6) is the band from the diagonal downwards, are in units of ``sigma`` about ``offset``.
    """

    breaks: Floats
    first: Indices
    basis: Floats
    coefficients: Floats
    covariance: Floats
    time_origin: float
    time_scale: float
    sigma: float
    offset: float
    n_updates: int


def smooth(
    time: Floats, values: Floats, sigma: float, contacts: Sequence[float] = (), releases: Sequence[float] = ()
) -> Smooth:
    """Fit the spline to 8 or more finite samples with a white noise of standard deviation ``sigma`` > 0.

    At ``contacts`` the third derivative may jump, for a convex body meets or leaves a flat; at ``releases`` the second.
    """
    scale = float(np.median(np.diff(time)))
    x = (time - time[0]) / scale
    offset = float(np.mean(values))
    z = (values - offset) / sigma
    knots = _knots(x, z, [(np.asarray(cuts, float) - time[0]) / scale for cuts in (contacts, releases)])
    count = len(knots) - DEGREE - 1
    start = np.flatnonzero(np.diff(knots[: count + 1]) > 0.0)
    breaks, first = np.append(knots[start], knots[-1]), start - DEGREE
    length = np.diff(breaks)
    basis = expanded(knots, first, length)
    ends, place = _places(breaks, x)
    powers, products = moments(place, z, ends)
    transposed = basis.transpose(0, 2, 1)
    normal = transposed @ powers[:, _ONE[:, None] + _ONE] @ basis
    right = np.bincount((first[:, None] + _ONE).ravel(), (transposed @ products[:, :, None]).ravel(), count + DEGREE)
    # the fourth derivative is linear: 24 and 120 times the highest powers, and u^2 is 1/12 in the mean
    power, highest = length**7, basis[:, 4:] * np.array([[24.0], [120.0 / np.sqrt(12.0)]])
    rough = highest.transpose(0, 2, 1) @ highest / power[:, None, None]
    octave = np.unique(np.round(np.log2(length)), return_inverse=True)[1]
    coefficients, covariance, n_solves = penalised(normal, right, rough, power, octave, first)
    if not np.isfinite(coefficients).all():
        raise np.linalg.LinAlgError("the penalised spline's matrix is not positive definite")
    return Smooth(breaks, first, basis, coefficients, covariance, float(time[0]), scale, sigma, offset, n_solves)


def evaluate(fit: Smooth, time: Floats, *derivatives: int) -> list[tuple[Floats, Floats]]:
    """Return the spline, or derivatives of it, each with its standard uncertainty.

    ``time`` (m,) increases inside the fitted record; ``derivatives`` are 0 to 3, and values and u (m,) are in units of
    the samples per time unit to that power.
    """
    x = np.clip((time - fit.time_origin) / fit.time_scale, fit.breaks[0], fit.breaks[-1])
    ends, place = _places(fit.breaks, x)
    active = fit.coefficients[fit.first[:, None] + _ONE][:, :, None]
    low, apart = np.minimum(_ONE[:, None], _ONE), np.abs(_ONE[:, None] - _ONE)
    covariance = fit.covariance[fit.first[:, None, None] + low, apart]
    found = []
    for derivative in derivatives:
        basis = fit.basis
        for _ in range(derivative):
            basis = basis[:, 1:] * (np.arange(1, basis.shape[1])[:, None] / np.diff(fit.breaks)[:, None, None])
        products, size = basis @ covariance @ basis.transpose(0, 2, 1), basis.shape[1]
        variances = np.zeros((len(fit.first), 2 * size - 1))
        for q in range(size):
            variances[:, q : q + size] += products[:, q]
        value, variance = followed((basis @ active)[:, :, 0], place, ends), followed(variances, place, ends)
        factor, offset = fit.sigma / fit.time_scale**derivative, 0.0 if derivative else fit.offset
        found.append((factor * value + offset, factor * np.sqrt(np.maximum(variance, 0.0))))
    return found


def _places(breaks: Floats, x: Floats) -> tuple[Indices, Floats]:
    """Return the first sample of each interval (interval + 1,), and the place of each in it, from -1/2 to 1/2."""
    ends = np.searchsorted(x, breaks)
    ends[-1] = len(x)
    over, count = 1.0 / np.diff(breaks), np.diff(ends)
    return ends, x * np.repeat(over, count) - np.repeat(0.5 * (breaks[1:] + breaks[:-1]) * over, count)


def _distances(z: Floats) -> Floats:
    """Return the distance of knots, in samples, for every leaf of samples ``z`` (n,) with a noise of 1.

    Means over L samples have fourth differences that no white noise reaches, where L is the scale of the curve: five
    such means then hold eight knots.
    """
    n = len(z)
    found = np.full(-(-n // _LEAF), max(n / 10.0, _CLOSEST))
    # White noise exceeds it in one record of a hundred: fourth differences of means have a variance of 70, and the
    # probability of t deviations is below exp(-t^2 / 2) in each of n differences.
    limit = float(np.sqrt(70.0 * 2.0 * np.log(100.0 * n)))
    total, leaf = np.concatenate([[0.0], np.cumsum(z)]), np.arange(len(found))
    for octave in range(int(np.log2(n / 5.0)), 1, -1):
        size = 2**octave
        t = total[:: size // 2]
        bend = t[10:] - t[:-10] - 5.0 * (t[8:-2] - t[2:-8]) + 10.0 * (t[6:-4] - t[4:-6])
        begin = size // 2 * np.flatnonzero(np.abs(bend) > limit * np.sqrt(size))
        if not begin.size:
            continue
        changes = [np.bincount(at, minlength=len(leaf) + 1) for at in (begin // _LEAF, (begin + 5 * size + 3) // _LEAF)]
        found[np.cumsum(changes[0] - changes[1])[:-1] > 0] = 0.625 * size
    # A long stretch that ends just inside a short one would otherwise bring its coarse knots there.
    rise = _SLOPE * _LEAF * leaf
    rising = np.minimum.accumulate(found - rise) + rise
    return np.minimum(rising, np.minimum.accumulate((found + rise)[::-1])[::-1] - rise)


def _knots(x: Floats, z: Floats, cuts: list[Floats]) -> Floats:
    """Place knots at a density that follows the curve; manifold ones at contacts and releases."""
    n, distance = len(x), _distances(z)
    count = np.concatenate([[0.0], np.cumsum(_LEAF / distance)])
    edge = np.minimum(np.arange(len(count)) * _LEAF, n - 1)
    wanted = np.linspace(0.0, count[-1], max(int(np.ceil(count[-1])), 1) + 1)
    breaks = np.interp(np.interp(wanted, count, edge), np.arange(n), x)
    breaks = breaks[np.concatenate([[True], np.diff(breaks) > 0])]
    for times, multiplicity in zip(cuts, _MULTIPLICITY, strict=True):
        inside = np.unique(times[(times > x[1]) & (times < x[-2])])
        if len(inside):
            # A simple knot within half a sample of a cut would leave an interval without samples.
            fences = np.concatenate([[-np.inf], inside, [np.inf]])
            place = np.searchsorted(fences, breaks)
            is_kept = np.minimum(fences[place] - breaks, breaks - fences[place - 1]) > 0.5
            is_kept[[0, -1]] = True
            breaks = np.sort(np.concatenate([breaks[is_kept], np.repeat(inside, multiplicity)]))
    return np.concatenate([np.repeat(breaks[0], DEGREE), breaks, np.repeat(breaks[-1], DEGREE)])
