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
from typing import NamedTuple

import numpy as np

from labpipe.arrays import Floats
from labpipe.signals._spline_kernel import DEGREE, LEAF, distances, expanded, followed, normal_equations, penalised

Cuts = tuple[Sequence[float], Sequence[float]]
_MULTIPLICITY = DEGREE - 2, DEGREE - 1  # of knots at a contact, a release: derivative 3, 2 jumps


class Smooth(NamedTuple):
    """A spline and its derivatives (derivative, n), with their standard uncertainties, and counts of the work."""

    value: Floats
    u: Floats
    n_coefficients: int
    n_solves: int


def smooth(
    time: Floats, values: Floats, sigma: float, order: int, cuts: Cuts = ((), ()), at: Floats | None = None
) -> Smooth:
    """Fit the spline to 8 or more finite samples with a white noise of standard deviation ``sigma`` > 0.

    At the first of ``cuts``, contacts, the third derivative may jump, for a convex body meets or leaves a flat; at the
    others, releases, the second. Derivatives up to ``order``, 3 at most, are returned ``at`` increasing times, default
    those of the samples.
    """
    scale, offset = float(np.median(np.diff(time))), float(np.mean(values))
    x, z = (time - time[0]) / scale, (values - offset) / sigma
    # knots at a density that follows the curve, manifold ones at contacts and releases
    n, distance = len(x), distances(z)
    density = np.concatenate([[0.0], np.cumsum(LEAF / distance)])
    edge = np.minimum(np.arange(len(density)) * LEAF, n - 1)
    wanted = np.linspace(0.0, density[-1], max(int(np.ceil(density[-1])), 1) + 1)
    breaks = np.interp(np.interp(wanted, density, edge), np.arange(n), x)
    breaks = breaks[np.concatenate([[True], np.diff(breaks) > 0])]
    for each, multiplicity in zip(cuts, _MULTIPLICITY, strict=True):
        times = (np.asarray(each, float) - time[0]) / scale
        inside = np.unique(times[(times > x[1]) & (times < x[-2])])
        if len(inside):
            # A simple knot within half a sample of a cut would leave an interval without samples.
            fences = np.concatenate([[-np.inf], inside, [np.inf]])
            place = np.searchsorted(fences, breaks)
            is_kept = np.minimum(fences[place] - breaks, breaks - fences[place - 1]) > 0.5
            is_kept[[0, -1]] = True
            breaks = np.sort(np.concatenate([breaks[is_kept], np.repeat(inside, multiplicity)]))
    knots = np.concatenate([np.repeat(breaks[0], DEGREE), breaks, np.repeat(breaks[-1], DEGREE)])
    count = len(knots) - DEGREE - 1
    start = np.flatnonzero(np.diff(knots[: count + 1]) > 0.0)
    breaks, first = np.append(knots[start], knots[-1]), start - DEGREE
    basis = expanded(knots, first)
    normal, rough, right = normal_equations(x, z, breaks, basis, first)
    coefficients, band, n_solves = penalised(normal, right, rough, np.diff(breaks), first)
    if not np.isfinite(coefficients).all():
        raise np.linalg.LinAlgError("the penalised spline's matrix is not positive definite")
    since = (time if at is None else at) - time[0]
    value, u = followed(scale * breaks, basis, first, sigma * coefficients, sigma**2 * band, since, order)
    value[0] += offset
    return Smooth(value, u, count, n_solves)
