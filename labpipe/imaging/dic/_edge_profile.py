"""How much of what tells a motion along the edges of a subset is no more than the steps that pixels make of them.

However pixels and lenses show a straight or evenly bent edge, a line, or a grating, and whatever blurs it after it
was sampled, each pixel depends on its distance across the edge alone. A profile over that distance, finer than the
pixels, takes all the steps along them with it, and leaves what is texture.
"""

import math
from dataclasses import dataclass

import numpy as np

from labpipe.arrays import Flags, Floats
from labpipe.imaging.dic._motion_uncertainty import strongest_slopes
from labpipe.imaging.dic._reference import Reference

#: Weights of the slope at a pixel, and how many pixels they reach beyond the subset.
_SLOPE = np.array([-1.0, 9.0, -45.0, 0.0, 45.0, -9.0, 1.0]) / 60.0
_BORDER = 3
#: Distance (px) between the knots of the profile: so many pixels lie between two of them, and it is no finer.
_PIXELS_OF_KNOT, _FINEST = 4.8, 0.06
#: The same in the first rounds, which look for the direction; rounds; and the most that one changes (px at the
#: border of the subset) how the edge is turned, bent, and bent the other way.
_COARSE, _ROUNDS, _MOST_CHANGE = (1.0, 0.7, 0.5), 7, np.array([0.15, 0.3, 0.6])
#: Weight of its second differences where no pixels tell it, and sum of squared weights from which they do.
_SMOOTH, _TELLS = 1e-3, 0.02
#: Error of the distance, in distances of knots, of a profile that has steps itself: blur after sampling leaves them.
_MISPLACED = 0.08
#: Share of the texture that edges may be, and ratio of the squared slopes across and along, from which it is looked
#: whether they are.
_MAY_BE, _SIDED = 0.1, 10.0
#: Share of what resists from which steps pull a motion, and one whose residual is noise, and multiple of the noise
#: from which a residual is none.
_MAY_PULL, _ARE, _MISFITS = 0.2, 0.4, 2.0
#: Shift (px) to which edges mislead that are all of the texture.
_MISLEADS = 0.16
#: Grey levels that a misplaced profile misses, over the deviation of noise, up to which pixels tell texture alone.
_FLAT = 0.3
#: Misfit that noise hides, in standard deviations of what noise shows.
_HIDDEN = 0.5
#: Standard deviations by which a residual is less than at another place, where steps match and no texture does.
_TOLD = 3.5
#: Share of the frames that show a point's own noise.
_BETTER = 0.1


@dataclass(frozen=True)
class Along:
    """What resists the motion that a subset tells least.

    Attributes
    ----------
    folded : float [1]
        Share of it that steps of edges may be, 0 to 1.
    texture : float [grey²]
        Variance of a pixel about the profile of the edges, noise of the reference in it.
    seen : float [1]
        Share of the pixels that tell it.
    """

    folded: float
    texture: float
    seen: float


def misled(
    reference: Reference, found: Flags, bound: Floats, texture: Floats, noise: Floats, is_static: Flags
) -> tuple[Floats, Flags]:
    """Shift [px] to which steps of edges mislead, and where they may be all that tells one, (frame, usable point).

    A texture that stays with the pixels while the edge moves on misleads by its share of what resists.

    ``found``: bool (frame, usable point), results that are asked about; ``bound``: (frame, usable point), see
    :func:`.folded_share`; ``texture``, ``noise``: (frame, usable point), as in :class:`.Variances`;
    ``is_static``: bool (frame,).
    """
    shift, is_doubtful = _MISLEADS * bound, np.zeros(found.shape, bool)
    sided = strongest_slopes(reference.subsets) / np.maximum(texture, 1e-30)
    is_asked = found & ((bound > _MAY_BE) | (sided > _SIDED))
    for n in np.flatnonzero(is_asked.any(axis=0)).tolist():
        rows = found[:, n]
        static = noise[is_static, n]
        static = static[np.isfinite(static) & (static > 0.0)]
        still = float(static.mean()) if len(static) else 0.0
        own = max(still or float(np.quantile(noise[rows, n], _BETTER)), reference.rounding)
        along = along_edges(reference, n, own)
        shift[rows, n] = _MISLEADS * np.minimum(bound[rows, n], along.folded)
        told = is_asked[:, n] & _is_told(reference, n, along, noise[:, n], own, still)
        is_doubtful[:, n] = is_asked[:, n] & ~told
        if along.folded > _MAY_PULL:
            least = own if along.folded > _ARE else _MISFITS * min(own, reference.own_noise(n, static)[0])
            pulled = _pulled(reference, n, along, noise[told, n], texture[told, n], least)
            shift[told, n] = np.hypot(shift[told, n], pulled)
    return shift, is_doubtful


def _is_told(reference: Reference, point: int, along: Along, noise: Floats, own: float, static: float) -> Flags:
    """Tell results (frame,) that match the texture beside the edges, not their steps alone.

    Where steps match at another place, the texture there is another one, and leaves twice its variance: a residual is
    less than that by no chance, and nearer to noise alone.

    ``noise``: (frame,) [grey²], variance of a pixel as the residual shows it; ``own``: float [grey²], by noise;
    ``static``: float [grey²], as static frames show it, 0 where they do not.
    """
    share = 1.0 / reference.noise.static_frames
    shown, elsewhere = (1.0 + share) * noise, 2.0 * along.texture + (1.0 - share) * static
    of_texture = 2.0 * along.texture / math.sqrt(along.seen)
    by_chance = math.sqrt(2.0 / reference.subsets.level[point, 2]) * np.hypot(shown, of_texture)
    return np.asarray(elsewhere - shown > np.maximum(_TOLD * by_chance, shown - (1.0 + share) * own))


def _pulled(reference: Reference, point: int, along: Along, shown: Floats, texture: Floats, own: float) -> Floats:
    """Shift (frame,) [px] by which steps of edges pull texture from where it matches, and misfit themselves.

    Of both, each misfits by what it resists times the square of its distance from where it would match, and the
    motion lies between by what both resist. So the misfit tells the shift.

    ``shown``: (frame,) [grey²], variance of a pixel as the residual shows it; ``texture``: (frame,) [grey²/px²], what
    both resist; ``own``: float [grey²], variance of a pixel by noise.
    """
    pixels = float(reference.subsets.level[point, 2])
    seen = float(reference.noise.gain.mean(axis=1).prod()) + reference.noise.own / reference.noise.static_frames
    hidden = _HIDDEN * own * math.sqrt(2.0 / pixels) * (along.folded > _ARE)
    misfit = np.maximum(shown - own, hidden) * pixels * seen
    return np.asarray(np.sqrt(misfit / texture * along.folded / max(1.0 - along.folded, 1e-3)))


def along_edges(reference: Reference, point: int, noise: float) -> Along:
    """Tell how much of what resists the least resisted motion steps of edges may be.

    ``point``: usable point; ``noise``: float [grey²], variance of a pixel of one frame.

    Notes
    -----
    The profile is a cubic spline by least squares over the distance from a curve of third order, which is
    found with it. The motion is that which the subset resists least, turned and stretched as it may be; what the
    profile and what the rest resist of it are counted apart. Of ``n`` pixels and ``k`` knots, the profile
    takes ``k/n`` of everything that is none of its own, noise and texture alike.
    """
    across = reference.weakest_slopes(point) + 0.5 * math.pi
    x, y, half = reference.subsets.layout[point, :3].tolist()
    reach = half + _BORDER
    rows, columns = (
        np.clip(np.arange(c - reach, c + reach + 1), 0, n - 1)
        for c, n in zip((y, x), reference.mean.shape, strict=True)
    )
    image, inside = reference.mean[np.ix_(rows, columns)], reference.images.inside
    down, right = np.mgrid[-reach : reach + 1, -reach : reach + 1].astype(float)
    counts = np.maximum(np.abs(down), np.abs(right)) <= half
    if inside is not None:
        is_seen = inside[np.ix_(rows, columns)] > 0.0
        counts &= is_seen
    profile, steep, freedom = _profile(image, counts, right, down, half, across)
    if inside is not None:
        image = np.where(is_seen, image, profile)
    rest = image - profile
    rest = np.sign(rest) * np.maximum(np.abs(rest) - steep, 0.0)
    places = right[counts] / half, down[counts] / half
    is_rigid = bool(reference.subsets.rigid_in(0)[point])
    whole, own = (_motions(picture, counts, places, is_rigid) for picture in (image, rest))
    weights = _least_resisted(whole)
    texture, both = own @ weights, whole @ weights
    share = min(freedom / len(texture), 0.9)
    left = float(texture @ texture) / (1.0 - share)
    by_noise = noise / reference.noise.static_frames * float((_SLOPE**2).sum()) * _squares(weights, places, is_rigid)
    steps = max(float(((both - texture) ** 2).sum()) - share * left, 0.0)
    beyond = left - by_noise
    # where steps hardly count nothing is taken off, of noise neither
    flat = counts & (steep <= _FLAT * math.sqrt(noise / reference.noise.static_frames))
    seen = flat if 4 * flat.sum() > counts.sum() else counts
    return Along(
        steps / max(steps + max(beyond, 0.0), 1e-30),
        float(np.square(rest[seen]).mean()) / (1.0 - share),
        float(seen.sum() / counts.sum()),
    )


def _profile(
    image: Floats, counts: Flags, right: Floats, down: Floats, half: int, across: float
) -> tuple[Floats, Floats, float]:
    """Image (row, column) of the profile alone, what a misplaced one misses, and its degrees of freedom."""
    cosine, sine = math.cos(across), math.sin(across)
    along = (down * cosine - right * sine) / half
    straight = right * cosine + down * sine
    curve = half * np.stack([along, along**2 / 2.0, along**3 / 6.0], axis=-1)
    grey, own, bent = image[counts], straight[counts], curve[counts]
    finest = max(_PIXELS_OF_KNOT / (2 * half + 1), _FINEST)
    change = np.zeros(3)
    best = math.inf
    for k in range(_ROUNDS):
        apart = _COARSE[k] if k < len(_COARSE) and _COARSE[k] > finest else finest
        distance = own + bent @ change
        first = float(distance.min()) - 1e-3
        knot, weight, slope = _cubic(distance, first, apart)
        heights, told = _smooth_heights(knot, weight, grey)
        missed = grey - _of_profile(heights, knot, weight)
        squares = float(missed @ missed)
        if k >= len(_COARSE) and squares < best:
            best, kept = squares, (change, first, heights, told)
        columns = _of_profile(heights, knot, slope)[:, None] * bent
        normal = columns.T @ columns
        normal += (1e-6 * np.trace(normal) + 1e-30) * np.eye(3)
        change = change + np.clip(np.linalg.solve(normal, columns.T @ missed), -_MOST_CHANGE, _MOST_CHANGE)
    change, first, heights, told = kept
    last = first + (len(heights) - 3) * finest - 1e-6
    knot, weight, slope = _cubic(np.clip(straight + curve @ change, first, last), first, finest)
    steep = _MISPLACED * finest * np.abs(_of_profile(heights, knot, slope))
    return _of_profile(heights, knot, weight), steep, float((told > _TELLS).sum())


def _cubic(distance: Floats, first: float, apart: float) -> tuple[np.ndarray, Floats, Floats]:
    """First of the four knots that count at each distance, their weights (4, ...), and those in its slope."""
    knot = np.floor((distance - first) / apart).astype(int)
    t = (distance - first) / apart - knot
    s = 1.0 - t
    weight = np.stack([s**3, 3.0 * t**3 - 6.0 * t**2 + 4.0, 3.0 * s**3 - 6.0 * s**2 + 4.0, t**3]) / 6.0
    slope = np.stack([-(s**2), 3.0 * t**2 - 4.0 * t, 4.0 * s - 3.0 * s**2, t**2]) / (2.0 * apart)
    return knot, weight, slope


def _of_profile(heights: Floats, knot: np.ndarray, weight: Floats) -> Floats:
    return np.asarray(sum(weight[a] * heights[knot + a] for a in range(4)))


def _smooth_heights(knot: np.ndarray, weight: Floats, grey: Floats) -> tuple[Floats, Floats]:
    """Heights of the knots by least squares, and the sum of squared weights that tells each."""
    from scipy.linalg import solveh_banded

    count = int(knot.max()) + 4
    banded, moments = np.zeros((4, count)), np.zeros(count)
    for a in range(4):
        moments += np.bincount(knot + a, weight[a] * grey, count)
        for b in range(a, 4):
            banded[3 - b + a] += np.bincount(knot + b, weight[a] * weight[b], count)
    told = banded[3].copy()
    second = np.array([1.0, -2.0, 1.0])
    for a in range(3):
        for b in range(a, 3):
            banded[3 - b + a, b : count - 2 + b] += _SMOOTH * second[a] * second[b]
    banded[3] += 1e-9
    return np.asarray(solveh_banded(banded, moments)), told


def _motions(image: Floats, counts: Flags, places: tuple[Floats, Floats], is_rigid: bool) -> Floats:
    """Columns (pixel, motion) of the shifts along x and y and of the turn, or of what else an affine motion does."""
    from scipy.ndimage import correlate1d

    slope_x, slope_y = (correlate1d(image, _SLOPE, axis=axis, mode="nearest")[counts] for axis in (1, 0))
    x, y = places
    if is_rigid:
        return np.stack([slope_x, slope_y, slope_y * x - slope_x * y], axis=1)
    return np.stack([slope_x, slope_y, *(s * p for s in (slope_x, slope_y) for p in (x, y))], axis=1)


def _least_resisted(columns: Floats) -> Floats:
    """Weights of the motions whose shift is 1 px in the direction in which a subset resists it least."""
    normal = columns.T @ columns
    inverse = np.linalg.pinv(normal + (1e-9 * np.trace(normal) + 1e-30) * np.eye(len(normal)), hermitian=True)
    size, direction = np.linalg.eigh(inverse[:2, :2])
    return np.asarray(inverse[:, :2] @ direction[:, 1] / size[1])


def _squares(weights: Floats, places: tuple[Floats, Floats], is_rigid: bool) -> float:
    """Sum of the squares of the displacements [px²] of these motions."""
    x, y = places
    if is_rigid:
        moved = weights[0] - weights[2] * y, weights[1] + weights[2] * x
    else:
        moved = weights[0] + weights[2] * x + weights[3] * y, weights[1] + weights[4] * x + weights[5] * y
    return float((moved[0] ** 2 + moved[1] ** 2).sum())
