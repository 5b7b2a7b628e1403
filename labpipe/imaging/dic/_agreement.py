"""Whether a displacement lies as near to what the points around it show as both uncertainties say.

Two things make it lie farther off: a subset that has slipped along an edge or around an arc and still matches,
and a misfit that pixels share in a way that its residual does not tell, such as that of a pattern sampled
before it was blurred. Neither is told by the subset alone.
"""

from dataclasses import dataclass

import numpy as np

from labpipe.arrays import Flags, Floats, Integers
from labpipe.imaging.dic._places import nearest, powers

#: Points around one of them that are asked: at most, and at least for a plane and for a curved surface through
#: their displacements; and their farthest distance in widths of the subset, and where there are no more than tell
#: a curved surface.
_AROUND, _PLANE, _CURVED, _REACH, _REACH_OF_FEW = 20, 6, 12, 1.5, 2.0
#: Standard deviations of the difference from which it is none by chance, and how many of those around, the most alike
#: of them, are a body of their own: beside the border of two bodies the surface is neither's.
_BY_CHANCE, _ALIKE = 4.0, 3
#: Share of the variances of independent displacements that a difference of overlapping subsets has at least.
_LEAST_SHARE = 0.2
#: Points of a frame from which their scatter is judged, its multiple of what the uncertainties say from which they
#: are widened, how much more of it is chance times the root of the points, the lower quartile of the sum of the
#: squares of two deviations of variance 1, and the root of such a sum from which it is no scatter.
_MANY, _WIDER, _FEW_SCATTER, _QUARTILE, _NONE_FROM = 20, 1.2, 1.5, 0.575, 10.0
#: Error of the weights' own sums, below which the points around tell the surface at the middle.
_TOLD = 1e-4
#: Points around a doubtful one among which trusted ones are sought: at most, and in widths of the subset.
_SOUGHT, _SOUGHT_WITHIN = 60, 3.0
#: Standard deviations within which trusted displacements around a doubtful one confirm it.
_CONFIRMS = 3.0
#: Results whose surroundings are looked at once; bounds the work arrays to some 20 MB.
_BLOCK = 5_000


def disagreement(places: Floats, widths: Integers, value: Floats, deviation: Floats, is_found: Flags) -> Floats:
    """Variance (frame, point, 3) [px²] along x and y, and covariance, that the points around tell to be missing.

    ``places``: (point, 2) [px], where the points are in the reference; ``widths``: integer (point,) [px], of
    their subsets; ``value``, ``deviation``: (frame, point, 3) [px, px, rad], displacements, rotations and their
    standard uncertainties; ``is_found``: bool (frame, point), which displacements count.

    Notes
    -----
    A plane or a curved surface through the displacements of the points around, by least squares, tells the
    displacement of each. Where the differences of most points of a frame are larger than the uncertainties say,
    all are widened alike; where that of one does, it is itself its uncertainty, or what it differs by from those of a
    few points around that move most alike.
    """
    more = np.zeros((*is_found.shape, 3))
    used = np.flatnonzero(is_found.any(axis=0))
    if len(used) <= _PLANE:
        return more
    surroundings = _look_around(places[used], widths[used])
    found = is_found[:, used]
    shown = np.where(found[..., None], value[:, used], 0.0)
    variance = np.where(found[..., None], deviation[:, used, :2] ** 2, 0.0)
    apart, square = _differences(surroundings, shown[..., :2], variance, found)
    judged = np.isfinite(square)
    scale, part = np.ones(len(square)), np.zeros((*found.shape, 3))
    # A plane leaves what is bent, which is no scatter.
    curved = judged & (surroundings.within.sum(axis=1) >= _CURVED)
    number, scatter = _scatter_of_frames(square, curved)
    is_wider = (number >= _MANY) & (scatter > (_WIDER + _FEW_SCATTER / np.sqrt(np.maximum(number, 1))) ** 2)
    for k in np.flatnonzero(is_wider).tolist():
        scale[k] = scatter[k]
        # where uncertainties are wrong as a whole, no point is better known than most
        usual = np.maximum(variance[k], np.median(variance[k, curved[k]], axis=0))
        part[k, :, :2] = np.maximum(scatter[k] * usual - variance[k], 0.0)
    rows, points = np.nonzero(judged & (square > _BY_CHANCE**2 * scale[:, None]))
    x, y = _stray(surroundings, places[used], shown, found, apart, rows, points).T
    part[rows, points] += np.stack([x * x, y * y, x * y], axis=1)
    more[:, used] = part
    return more


def unconfirmed(
    places: Floats, widths: Integers, value: Floats, deviation: Floats, is_trusted: Flags, is_doubtful: Flags
) -> Floats:
    """Variance (frame, point, 3) [px²] along x and y, and covariance, of displacements that others must confirm.

    A doubtful displacement that lies where the trusted ones around it tell is as uncertain as they are about that,
    and by what it lies away from there; one that does not, or of which they tell nothing, without limit.

    ``places, widths, value, deviation``: as for :func:`disagreement`; ``is_trusted``, ``is_doubtful``: bool
    (frame, point), displacements that count, and those that are asked about.
    """
    more = np.zeros((*is_doubtful.shape, 3))
    rows, points = np.nonzero(is_doubtful)
    if not len(rows):
        return more
    more[rows, points] = np.inf, np.inf, 0.0
    around = _look_around(places, widths, _SOUGHT, _SOUGHT_WITHIN)
    for first in range(0, len(rows), _BLOCK):
        row, point = rows[first : first + _BLOCK], points[first : first + _BLOCK]
        near = row[:, None], around.near[point]
        counts = around.within[point] & is_trusted[near]
        counts &= counts.cumsum(axis=1) < _CURVED  # a plane: a curved surface tells little beside those that tell it
        weight, _ = _surface(around.away[point], counts)
        told = np.where(counts[..., None], value[near][..., :2], 0.0)
        spread = np.where(counts[..., None], deviation[near][..., :2] ** 2, 0.0)
        apart = value[row, point, :2] - (weight[..., None] * told).sum(axis=1)
        scatter = _about_plane(around.away[point], counts, told)
        variance = (weight[..., None] ** 2 * spread).sum(axis=1) + scatter[:, None] ** 2
        square = (apart**2 / (variance + deviation[row, point, :2] ** 2)).sum(axis=1)
        agrees = weight.any(axis=1) & (square < _CONFIRMS**2)
        x, y = apart.T
        added = np.stack([x * x + variance[:, 0], y * y + variance[:, 1], x * y], axis=1)
        more[row[agrees], point[agrees]] = added[agrees]
    return more


@dataclass(frozen=True)
class _Surroundings:
    """The points around each: their numbers (point, near), where from it in its widths, and which are asked."""

    near: Integers
    away: Floats
    within: Flags


def _look_around(places: Floats, widths: Integers, most: int = _AROUND, reach: float = _REACH) -> _Surroundings:
    near = nearest(places, places, min(most + 1, len(places)))
    away = (places[near] - places[:, None]) / widths[:, None, None]
    far = np.hypot(away[..., 0], away[..., 1])
    few = np.arange(near.shape[1]) <= _CURVED  # the first is the point itself
    within = (near != np.arange(len(places))[:, None]) & ((far < reach) | (few & (far < _REACH_OF_FEW)))
    return _Surroundings(near, away, within)


def _normal(columns: Floats, counts: Flags) -> Floats:
    """Make normal matrices (row, term, term) that are not singular."""
    normal = np.swapaxes(columns, 1, 2) @ (columns * counts[..., None])
    trace = np.trace(normal, axis1=1, axis2=2)
    return normal + (1e-9 * trace + 1e-30)[:, None, None] * np.eye(columns.shape[2])


def _surface(away: Floats, counts: Flags) -> tuple[Floats, Floats]:
    """Weights (row, near) of those that count in the surface at the middle, and the share (row,) of variances left.

    Weights are 0 where there are too few, or where they do not tell it; the share is that of independent
    displacements, 1, less what overlaps.
    """
    weights = np.zeros(counts.shape)
    number = counts.sum(axis=1)
    for terms, chosen in ((6, number >= _CURVED), (3, (number >= _PLANE) & (number < _CURVED))):
        if chosen.any():
            columns = powers(away[chosen], terms)
            middle = np.linalg.solve(_normal(columns, counts[chosen]), np.eye(terms)[:, :1])
            own = (columns @ middle)[..., 0] * counts[chosen]
            # Points along one line do not tell a plane beside it.
            missed = np.einsum("rn,rnt->rt", own, columns) - np.eye(terms)[0]
            weights[chosen] = own * (np.abs(missed).max(axis=1, keepdims=True) < _TOLD)
    all_places = np.concatenate([np.zeros((len(away), 1, 2)), away], axis=1)
    all_weights = np.concatenate([np.ones((len(away), 1)), -weights], axis=1)
    # What the noise of two of them has in common: the share in which their subsets overlap.
    overlap = np.ones((len(away), *2 * all_weights.shape[1:]))
    for axis in range(2):
        along = all_places[..., axis]
        apart = along[:, :, None] - along[:, None]
        overlap *= np.maximum(np.subtract(1.0, np.abs(apart, out=apart), out=apart), 0.0, out=apart)
    left = ((overlap @ all_weights[..., None])[..., 0] * all_weights).sum(axis=1)
    return weights, np.maximum(left / np.square(all_weights).sum(axis=1), _LEAST_SHARE)


def _differences(around: _Surroundings, shown: Floats, variance: Floats, found: Flags) -> tuple[Floats, Floats]:
    """Differences (frame, point, 2) [px] from the surfaces, and their squares (frame, point) in variances."""
    from scipy.sparse import csr_array

    count, width = around.near.shape
    weights, share = _surface(around.away, around.within)

    def of_others(factors: Floats, values: Floats) -> Floats:
        rows = np.arange(0, count * width + 1, width)
        return np.asarray((csr_array((factors.ravel(), around.near.ravel(), rows), (count, count)) @ values.T).T)

    apart, total = np.empty(shown.shape), np.empty(shown.shape)
    for axis in range(2):
        apart[..., axis] = shown[..., axis] - of_others(weights, shown[..., axis])
        total[..., axis] = share * (variance[..., axis] + of_others(weights**2, variance[..., axis]))
    total[:, ~weights.any(axis=1)] = np.nan
    if not found.all():
        misses = of_others(around.within.astype(float), (~found).astype(float)) > 0.5
        rows, points = np.nonzero(misses & found)
        for first in range(0, len(rows), _BLOCK):
            row, point = rows[first : first + _BLOCK], points[first : first + _BLOCK]
            near = row[:, None], around.near[point]
            weight, left = _surface(around.away[point], around.within[point] & found[near])
            apart[row, point] = shown[row, point] - (weight[..., None] * shown[near]).sum(axis=1)
            spread = variance[row, point] + (weight[..., None] ** 2 * variance[near]).sum(axis=1)
            total[row, point] = np.where(weight.any(axis=1), left, np.nan)[:, None] * spread
        total[~found] = np.nan
    return apart, np.asarray((apart**2 / np.maximum(total, 1e-30)).sum(axis=-1))


def _scatter_of_frames(square: Floats, counts: Flags) -> tuple[Integers, Floats]:
    """Squares of those (frame, point) that count which are no border of bodies: their number and their mean (frame,).

    Most surfaces may cross the border of two bodies, and there are errors that few have.
    """
    ordered = np.sort(np.where(counts, square, np.inf), axis=1)
    quartile = ordered[np.arange(len(square)), counts.sum(axis=1) // 4]
    most = np.minimum(_BY_CHANCE**2 / _QUARTILE * quartile, _NONE_FROM**2)
    counts = counts & (square < most[:, None])
    number = counts.sum(axis=1)
    return number, 0.5 * np.where(counts, square, 0.0).sum(axis=1) / np.maximum(number, 1)


def _stray(
    around: _Surroundings, places: Floats, shown: Floats, found: Flags, apart: Floats, rows: Integers, points: Integers
) -> Floats:
    """How far (result, 2) [px] displacements lie from what the points around show.

    That is from the surface, or, beside the border of two bodies, from those of a few that move most alike. ``shown``
    (frame, point, 3) are the displacements and the rotation.
    """
    stray = apart[rows, points]
    for first in range(0, len(rows), _BLOCK):
        row, point = rows[first : first + _BLOCK], points[first : first + _BLOCK]
        near = row[:, None], around.near[point]
        right, down = np.moveaxis(places[around.near[point]] - places[point][:, None], 2, 0)
        x, y, turn = shown[row, point, :, None].transpose(1, 0, 2)
        off = shown[near][..., :2] - np.stack([x - turn * down, y + turn * right], axis=-1)
        size = np.where(around.within[point] & found[near], np.hypot(off[..., 0], off[..., 1]), np.inf)
        last = np.arange(len(row)), np.argsort(size, axis=1)[:, min(_ALIKE, size.shape[1]) - 1]
        is_nearer = size[last] < np.hypot(*stray[first : first + _BLOCK].T)
        stray[first : first + _BLOCK][is_nearer] = off[last][is_nearer]
    return stray


def _about_plane(away: Floats, counts: Flags, moved: Floats) -> Floats:
    """Root mean square (row,) [px] of displacements (row, near, 2) about a plane through those that count."""
    columns = powers(away, 3)
    plane = np.linalg.solve(_normal(columns, counts), np.swapaxes(columns, 1, 2) @ moved)
    left = (moved - columns @ plane) * counts[..., None]
    return np.asarray(np.sqrt(np.square(left).sum(axis=(1, 2)) / np.maximum(counts.sum(axis=1) - 3.0, 1.0)))
