"""Standard uncertainty of a subset's motion, predicted from its texture and its residual."""

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Flags, Floats
from labpipe.imaging.dic._spline import noise_gain
from labpipe.imaging.dic._subset_kernel import MOTIONS
from labpipe.imaging.dic._subset_solver import NoiseShown
from labpipe.imaging.dic._subsets import Subsets, invert_within, solved_columns

#: Places per axis at which a subset's sub-pixel positions are sampled.
_PLACES = np.linspace(-1.0, 1.0, 5)
#: Share of the squared slopes of the blurred reference that must be texture in every direction,
#: times the root of the subset's width in px: with less, the noise that is taken off may be all
#: of it. Along bare edges noise alone reached 0.36 in 31 px and 0.44 in 21 px.
_LEAST_TEXTURE = 3.0
#: Standard uncertainty (px) by noise of a shift along the direction in which the pattern is weakest, from which the
#: correlation has several tops, and only the points around tell the right one; and the largest that is given.
MOST_UNCERTAIN, MOST_VAGUE = 0.4, 0.8
#: Factor by which the texture must exceed noise where more than the motion is solved for.
_CLEARLY = 4.0
#: Ratio of the squared slopes along the strongest and the weakest direction from which a pattern
#: may be taken for an edge or a grating.
ONE_WAY = 10.0
#: Squared slopes that are left at least when those of noise are taken off.
_LEAST_LEFT = 0.05
#: Blur (px) at which texture is looked for: a pattern outlives it, noise does not.
COARSE = 1.0
#: Share of the contrast of the reference that noise is said to be at most.
_MOST_OF_NOISE = 0.5
#: Share of a pixel's noise variance that the residual must show to tell it.
_LEAST_NOISE_SEEN = 0.01


@dataclass(frozen=True)
class Directions:
    """Motions of every subset that neither texture nor noise of the reference couples.

    Attributes
    ----------
    root : array (point, 6, 6)
        Its columns are the motions, three of a rigid subset: ``root @ root.T`` is the inverse of
        the normal matrix.
    share : array (point, 6)
        Squared slopes of noise of slope variance 1, over those of the reference.
    coarse : array (point, 6)
        Squared slopes of the reference blurred by :data:`COARSE`, over those of the reference.
    coarse_share : array (point,)
        As ``share`` for the blurred reference, of the shift in the direction where it is largest.
    """

    root: Floats
    share: Floats
    coarse: Floats
    coarse_share: Floats


@dataclass(frozen=True)
class NoiseModel:
    """How noise of one pixel reaches the residual and the slopes.

    Attributes
    ----------
    fraction : array
        Sub-pixel positions.
    gain : array (2, fraction)
        Variance of the frame left along x and along y after blur and interpolation.
    own : float
        Variance left of the reference.
    slope : float [1/px²]
        Variance of the spline's slope in the reference per variance of a pixel, blur included.
    coarse_slope : float [1/px²]
        The same after a further blur by :data:`COARSE`.
    static_frames : int
        Frames averaged into the reference.
    smoothing : array (point, 2)
        Variance of the motion by noise of the frame, and by that of the reference, relative to unblurred
        noise of the same strength.
    coarse : array (point, 6, 6)
        Normal matrices of the motions of the reference blurred by :data:`COARSE`.
    bends : (float, array (3,)) [1/px²], [1/px⁴]
        Mean products of the noise of a blurred image and the sum of its bends, and of each of the
        bends and itself, over the variance of the noise.
    """

    fraction: Floats
    gain: Floats
    own: float
    slope: float
    coarse_slope: float
    static_frames: int
    smoothing: Floats
    coarse: Floats
    bends: tuple[float, Floats]
    _directions: dict[int, Directions] = field(default_factory=dict, repr=False)

    def directions(self, subsets: Subsets, model: int) -> Directions:
        """Directions of the motion in a model, see :meth:`.Subsets.model`."""
        if model not in self._directions:
            self._directions[model] = _directions(subsets, self.coarse, model)
        return self._directions[model]

    def most_noise(self, subsets: Subsets, model: int) -> Floats:
        """Variance (point,) [grey²] of a pixel up to which the texture of subsets exceeds noise."""
        least = _LEAST_TEXTURE / subsets.level[:, 2] ** 0.25
        share = self.coarse_slope * self.directions(subsets, model).coarse_share
        return np.asarray((1.0 - least) * self.static_frames / share)

    def most_misfit(self, subsets: Subsets) -> Floats:
        """Residual (point,) [grey²] up to which a change of light or blur may be read from it.

        Where there is hardly a pattern, the columns of light and blur would take noise for a change.
        """
        seen = float(self.gain.mean(axis=1).prod()) + self.own / self.static_frames
        return np.asarray(self.most_noise(subsets, 0) * seen * subsets.level[:, 2] / _CLEARLY)

    def shown(self, floor: float) -> NoiseShown:
        """Tell the solver how noise shows in a residual.

        ``floor``: float [grey²], variance of a pixel of the frames from rounding.
        """
        share = 1.0 / self.static_frames
        own = share * self.own
        seen = float(self.gain.mean(axis=1).prod()) + own
        return NoiseShown((1.0 + share) / seen, -own * self.bends[0] / seen, own / seen, floor * seen)


@dataclass(frozen=True)
class Variances:
    """How well the image tells the motions.

    Attributes
    ----------
    motion : array (result, 3) [px², px², rad²]
        Variance of (u, v, rotation); NaN where there is no texture.
    covariance : array (result,) [px²]
        Of u and v.
    texture : array (result,) [grey²/px²]
        Smallest eigenvalue of the texture matrix: the sum of the squared slopes along the direction in
        which the pattern is weakest, without those of noise and those that another motion explains.
    strongest : array (result,) [grey²/px²]
        Largest eigenvalue of the same matrix.
    is_told, is_vague : bool arrays (result,)
        Whether noise leaves the motion certain enough in every direction to be given, and so uncertain that
        it may be another, see :data:`MOST_UNCERTAIN`.
    noise, most_noise : arrays (result,) [grey²]
        Variance of a pixel as the residual shows it, and the largest for which the texture exceeds
        noise.
    """

    motion: Floats
    covariance: Floats
    texture: Floats
    strongest: Floats
    is_told: NDArray[np.bool_]
    is_vague: NDArray[np.bool_]
    noise: Floats
    most_noise: Floats


def make_noise_model(
    order: int, blur: float, static_frames: int, frame: Floats, reference: Floats, along: float, squares: Floats
) -> NoiseModel:
    """Tabulate the noise model, but for what depends on the subsets.

    ``order``: spline order; ``blur``: float [px], gaussian blur before interpolation; ``static_frames``: frames
    averaged into the reference; ``frame``: (3,) [1, px², px²], variance left at a pixel of the frame, and how
    much variance its blur has beyond ``blur`` along x and along y; ``reference``: (3,) [1, 1/px², 1/px²],
    variance left at a pixel, of the slope there, and of the slope after a further blur by :data:`COARSE`;
    ``along``, ``squares``: float [1/px²], array (3,) [1/px⁴], see ``bends`` of :class:`NoiseModel`.
    """
    fraction = np.linspace(0.0, 1.0, 33)
    gain = np.stack([noise_gain(order, fraction, math.sqrt(blur**2 + more)) for more in frame[1:]])
    gain *= math.sqrt(frame[0] / gain[:, 0].prod())
    own, slope, coarse_slope = reference.tolist()
    none = np.zeros((0, 2)), np.zeros((0, MOTIONS, MOTIONS))
    return NoiseModel(fraction, gain, own, slope, coarse_slope, static_frames, *none, (along, squares))


def _directions(subsets: Subsets, coarse: Floats, model: int) -> Directions:
    """Make the normal matrices and those of noise alone diagonal together."""
    alone = np.zeros((len(subsets), MOTIONS, MOTIONS))
    alone[:, :3, :3] = alone[:, 3:, 3:] = subsets.spread
    root, share = _joint(subsets.model(model).inverse[:, :MOTIONS, :MOTIONS], alone)
    seen = np.einsum("nik,nij,njk->nk", root, coarse, root)
    shifts = invert_within(coarse, subsets.rigid_in(model))[:, [0, 0, 3], [0, 3, 3]]
    largest = subsets.level[:, 2] * _largest(shifts[:, 0], shifts[:, 2], shifts[:, 1])
    # a shift that even the noise of the reference does not resist
    largest[~(largest > 0.0)] = np.inf
    return Directions(root, share, seen, largest)


def _joint(inverse: Floats, alone: Floats) -> tuple[Floats, Floats]:
    """Columns that make both matrices diagonal, and the second one's diagonal, (point, 6)."""
    values, vectors = np.linalg.eigh(inverse)
    root = vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :]
    share, turned = np.linalg.eigh(root.transpose(0, 2, 1) @ (alone @ root))
    return root @ turned, share


def motion_variance(
    model: NoiseModel,
    subsets: Subsets,
    chosen: NDArray[np.int64],
    motion: Floats,
    gain: Floats,
    residual: Floats,
    is_static: NDArray[np.bool_],
    solved: int = 0,
    left: Floats | None = None,
    kept: Floats | None = None,
) -> Variances:
    """Variance of the motions, and whether noise leaves them certain enough.

    ``model``: how noise is passed on; ``subsets``: the reference; ``chosen``: integer (result,), subset of each
    result; ``motion``: (result, 6), as in :class:`.Solution`, like the next two; ``gain``, ``residual``:
    (result,); ``is_static``: bool (result,), the frame is one of those averaged into the reference; ``solved``:
    the model of all results, see :meth:`.Subsets.model`; ``left``, ``kept``: (result, 2) and (result,), optional,
    see :meth:`.Reference.softened`; 1 by default.

    Notes
    -----
    The residual shows the noise of the difference of frame and reference reduced, because
    interpolation between pixels averages noise; the reduction is known from the positions.

    Noise also adds to the squared slopes of the reference, in all directions alike. With the
    normal matrix ``A`` of the allowed motions and the noise in it ``N``, an error of the motion
    meets the resistance ``A - N`` only, so that the covariance is ``(A - N)⁻¹ (a A + b (A - N)) (A - N)⁻¹``,
    with ``a`` the variance of the frame and ``b`` that of the reference: noise of the slopes meets
    the noise of the frame only; with its own it cancels, because the slope of a pixel does not
    depend on that pixel and the weights are odd. ``A`` and ``N`` are made diagonal together, once for
    each subset.
    """
    half = subsets.half[chosen].astype(float)
    freedom = subsets.level[chosen, 2] - solved_columns(solved) - np.where(subsets.rigid_in(solved)[chosen], 3, 6) - 2
    variance = residual / np.maximum(freedom, 1.0)
    sampled = _interpolation_gain(model, half, motion)
    shared = np.where(is_static, -1.0, 1.0) / model.static_frames
    square = gain**2
    # A static frame and the reference share noise; unmoved, their difference is not reduced.
    sampled = np.where(is_static, model.own, sampled)
    left = np.ones((len(chosen), 2)) if left is None else left
    seen = square * sampled + shared * model.own * (1.0 if kept is None else kept)
    # A single static frame is its own reference: their difference shows no noise at all.
    shows_noise = seen > _LEAST_NOISE_SEEN
    pixel_noise = np.where(shows_noise, variance / np.where(shows_noise, seen, 1.0), 0.0)
    # Noise of the reference, which no frame shows, makes frames look weaker than they are.
    of_noise = model.own / model.static_frames * pixel_noise * subsets.level[chosen, 2]
    of_noise /= np.maximum(subsets.level[chosen, 1], 1e-30)
    square = square * np.where(is_static, 1.0, 1.0 - np.minimum(of_noise, _MOST_OF_NOISE)) ** 2
    seen_by = model.directions(subsets, solved)
    slope_noise = (pixel_noise / model.static_frames)[:, None]
    noise_share = slope_noise * model.slope * seen_by.share[chosen]
    coarse_share = slope_noise * model.coarse_slope * seen_by.share[chosen]
    # The pattern has at least the slopes that it has when it is blurred.
    texture = np.maximum(1.0 - noise_share, seen_by.coarse[chosen] - coarse_share)
    texture = np.maximum(texture, _LEAST_LEFT)
    most_noise = model.most_noise(subsets, solved)[chosen]
    of_frame, of_reference = model.smoothing[chosen].T
    reference_noise = (of_reference * shared * left.prod(axis=1))[:, None] * texture
    along = pixel_noise[:, None] * np.maximum((of_frame * square)[:, None] + reference_noise, 0.0) / texture**2
    root = seen_by.root[chosen]
    turn = 0.5 * (root[:, 4] - root[:, 2])
    found = np.stack([(row**2 * along).sum(axis=1) for row in (root[:, 0], root[:, 3], turn)], axis=1)
    # A frame that is softer than the reference resists an error less.
    found /= np.column_stack([left, left.mean(axis=1)]) ** 2
    both = np.asarray((root[:, 0] * root[:, 3] * along).sum(axis=1)) / left.prod(axis=1)
    worst = _largest(found[:, 0], found[:, 1], both)
    is_told, is_vague = worst < MOST_VAGUE**2, worst >= MOST_UNCERTAIN**2
    resisted = [(root[:, a] * root[:, b] / texture).sum(axis=1) for a, b in ((0, 0), (3, 3), (0, 3))]
    largest = _largest(*resisted)
    weakest, strongest = (1.0 / np.maximum(value, 1e-30) for value in (largest, resisted[0] + resisted[1] - largest))
    values = np.where(is_told[:, None], found, np.nan)
    return Variances(values, both, weakest, strongest, is_told, is_vague, pixel_noise, most_noise)


def least_told(deviation: Floats, covariance: Floats) -> Floats:
    """Direction (rad, from x towards y) in which motions are told least."""
    return np.asarray(0.5 * np.arctan2(2.0 * covariance, deviation[..., 0] ** 2 - deviation[..., 1] ** 2))


def one_way(subsets: Subsets, ratio: float = ONE_WAY) -> Flags:
    """Tell which subsets (point,) hold hardly more than an edge or a grating, by the ratio of their squared slopes."""
    strongest = strongest_slopes(subsets)
    both = subsets.normal[:, 0, 0] + subsets.normal[:, 3, 3]
    return np.asarray(strongest > ratio * np.maximum(both - strongest, 0.0))


def strongest_slopes(subsets: Subsets) -> Floats:
    """Squared slopes (point,) [grey²/px²] of the reference along the direction in which they are largest."""
    return _largest(subsets.normal[:, 0, 0], subsets.normal[:, 3, 3], subsets.normal[:, 0, 3])


def weakest_told(subsets: Subsets, model: int) -> Floats:
    """Texture (point,) [grey²/px²] of subsets in a model with the noise in it, see :class:`Variances`."""
    inverse = subsets.model(model).inverse
    return np.asarray(1.0 / np.maximum(_largest(inverse[:, 0, 0], inverse[:, 3, 3], inverse[:, 0, 3]), 1e-30))


def _largest(xx: Floats, yy: Floats, xy: Floats) -> Floats:
    """Larger eigenvalue of symmetric matrices of two rows."""
    return np.asarray(0.5 * (xx + yy) + np.hypot(0.5 * (xx - yy), xy))


def _interpolation_gain(model: NoiseModel, half: Floats, motion: Floats) -> Floats:
    """Mean over each subset of the variance left after interpolation along both axes."""
    right, down = (places.ravel()[:, None] for places in np.meshgrid(_PLACES, _PLACES))
    left = np.ones((1, len(half)))
    for axis, gain in zip((0, 3), model.gain, strict=True):
        shift, by_x, by_y = motion[:, axis : axis + 3].T
        place = shift + (by_x * half) * right + (by_y * half) * down
        place -= np.floor(place)
        place *= len(gain) - 1  # of fractions that are evenly spaced
        node = place.astype(np.intp)
        place -= node
        left = left * (gain.take(node) + np.diff(gain, append=gain[-1]).take(node) * place)
    return np.asarray(left.mean(axis=0))
