"""Covariance of a subset's displacement, from its texture, the noise and the residual.

Noise of the pixels gives the covariance of least squares: the inverse of the normal matrix times
the variance of the noise, which the residual shows. Where more than noise is left over (aliasing, compression,
a motion that the shape does not follow) the residual is correlated from pixel to pixel and with the slopes;
the sandwich estimator over blocks of pixels takes both as they are. The larger of the two counts, along either
principal direction of the texture.

References
----------
H. White, Econometrica 48 (1980) 817-838, https://doi.org/10.2307/1912934 (sandwich estimator);
M. A. Sutton, J.-J. Orteu, H. Schreier, Image Correlation for Shape, Motion and Deformation
Measurements, Springer 2009, section 5.6 (noise).
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Flags, Floats, Floats32, Integers
from labpipe.compilation import njit
from labpipe.imaging.dic._solver import Solution
from labpipe.imaging.dic._spline import noise_gain, slope_noise_gain
from labpipe.imaging.dic._subsets import Subsets

#: Standard deviations of the squared slopes of noise by which those along the weakest direction must exceed them.
_SIGNIFICANT = 4.0
#: Share of a pixel's noise variance that the residual must show to tell it.
_LEAST_NOISE_SEEN = 0.01


@dataclass(frozen=True)
class NoiseModel:
    """Propagation of the noise of one pixel to the residual and the slopes.

    Attributes
    ----------
    gain : array (33,)
        Variance left along one axis after blur and interpolation, at sub-pixel positions 0 to 1.
    slope : float [1/px²]
        Variance of the spline's slope per variance of a pixel, blur included.
    static_frames : int
        Frames averaged into the reference.
    """

    gain: Floats
    slope: float
    static_frames: int

    @property
    def left(self) -> float:
        """Share of the variance of a pixel that the residual shows, mean over all sub-pixel positions."""
        return 0.5 * float(self.gain[0] ** 2 + self.gain.mean() ** 2)

    @classmethod
    def of(cls, order: int, blur: float, static_frames: int) -> "NoiseModel":
        """Tabulate the model for a spline order (3 or 5), a blur (px) and a number of static frames."""
        return cls(noise_gain(order, np.linspace(0.0, 1.0, 33), blur), slope_noise_gain(order, blur), static_frames)


def covariance(
    model: NoiseModel,
    subsets: Subsets,
    smoothing: Floats,
    edges: Floats,
    chosen: Integers,
    found: Solution,
    is_static: bool,
) -> Floats:
    """Covariance of (dx, dy, rotation).

    Parameters
    ----------
    model : NoiseModel
        Propagation of noise.
    subsets : Subsets
        The reference.
    smoothing : array (point,)
        Variance of the motion relative to unblurred noise of the same strength.
    edges : array (point,) [grey²/px²]
        Squared slopes along the weakest direction that are no texture, see :mod:`._aperture_problem`.
    chosen : integer array (result,)
        Subset of each result.
    found : Solution
        The results.
    is_static : bool
        The frame is one of those averaged into the reference.

    Returns
    -------
    array (result, 4) [px², px², px², rad²]
        Of dx dx, dy dy, dx dy, and of the rotation; NaN where there is no texture along the weakest direction.

    Notes
    -----
    The residual shows the variance of the noise reduced, because interpolation between
    pixels averages noise; the reduction is known from the positions. Noise also adds to the
    squared slopes of the reference, which makes the normal matrix too large; the surplus is known
    from the noise.
    """
    result = np.full((len(chosen), 4), np.nan)
    if len(chosen):
        _covariance(
            (model.gain, model.slope, float(model.static_frames), is_static), subsets.arrays, smoothing, edges,
            np.ascontiguousarray(chosen, np.int64),
            (found.motion, found.quality, found.covariance, found.is_affine), result,
        )  # fmt: skip
    return result


@njit(cache=True)
def _covariance(
    model: tuple[Floats, float, float, bool],
    subsets: tuple[Integers, NDArray[np.int8], Floats32, Floats, Floats, Floats, Floats, Floats],
    smoothing: Floats,
    edges: Floats,
    chosen: Integers,
    found: tuple[Floats, Floats, Floats, Flags],
    result: Floats,
) -> None:
    """Fill ``result``, see :func:`covariance`."""
    gain, slope, static_frames, is_static = model
    layout, _, _, level, _, _, rigid, affine = subsets
    motion, quality, scores, is_affine = found
    at_pixels = gain[0] * gain[0]
    shared = (-1.0 if is_static else 1.0) / static_frames
    for q in range(len(chosen)):
        n = chosen[q]
        if not quality[q, 1] >= 0.0:
            continue
        inverse = affine[n] if is_affine[q] else rigid[n]
        square = quality[q, 0] ** 2
        # A static frame and the reference share noise; unmoved, their difference is not reduced.
        sampled = at_pixels if is_static else _interpolated(gain, layout[n, 2], motion[q])
        seen = square * sampled + shared * at_pixels
        passed = max(square + shared, 0.0)
        variance = quality[q, 1] / max(level[n, 2] - (8.0 if is_affine[q] else 5.0), 1.0)
        # A single static frame is its own reference: their difference shows no noise at all.
        noise = variance / seen if seen > _LEAST_NOISE_SEEN else 0.0
        # slopes of neighbouring pixels are correlated: half as many are independent
        least = _SIGNIFICANT * math.sqrt(4.0 / max(level[n, 2], 1.0))
        by_frame = square / passed if passed > 0.0 else 0.0
        no_texture = level[n, 2] * noise * slope / static_frames
        # principal directions of the covariance of (dx, dy)
        xx, yy, xy = inverse[0, 0], inverse[3, 3], inverse[0, 3]
        angle = 0.5 * math.atan2(2.0 * xy, xx - yy)
        cosine, sine = math.cos(angle), math.sin(angle)
        along = np.zeros(2)
        widest = 1.0
        for k in range(2):
            x, y = (cosine, sine) if k == 0 else (-sine, cosine)
            spread = x * x * xx + y * y * yy + 2.0 * x * y * xy  # the first is the weakest direction
            texture = 1.0 - (no_texture + (edges[n] if k == 0 else 0.0)) * spread
            if not texture > least * (1.0 - texture):
                along[k] = np.nan
                break
            shown = x * x * scores[q, 0] + y * y * scores[q, 1] + 2.0 * x * y * scores[q, 2]
            # Noise of the slopes meets the noise of the frame only: with its own it cancels, because the
            # slope of a pixel does not depend on that pixel and the weights are odd.
            widening = (texture + by_frame * (1.0 - texture)) / texture**2
            along[k] = widening * max(noise * passed * smoothing[n] * spread, shown)
            widest = max(widest, widening)
        result[q, 0] = cosine * cosine * along[0] + sine * sine * along[1]
        result[q, 1] = sine * sine * along[0] + cosine * cosine * along[1]
        result[q, 2] = cosine * sine * (along[0] - along[1])
        turn = 0.25 * (inverse[4, 4] + inverse[2, 2] - 2.0 * inverse[2, 4])
        result[q, 3] = widest * max(noise * passed * smoothing[n] * turn, scores[q, 3])


@njit(cache=True)
def _interpolated(gain: Floats, half: int, p: Floats) -> float:
    """Mean over a subset of the variance of noise that is left after interpolation along both axes."""
    total = 0.0
    for row in range(5):
        for column in range(5):
            j, i = half * (0.5 * column - 1.0), half * (0.5 * row - 1.0)
            factor = 1.0
            for shift in (p[0] + p[1] * j + p[2] * i, p[3] + p[4] * j + p[5] * i):
                place = (shift - math.floor(shift)) * (len(gain) - 1)
                left = min(int(place), len(gain) - 2)
                factor *= gain[left] + (place - left) * (gain[left + 1] - gain[left])
            total += factor
    return total / 25.0
