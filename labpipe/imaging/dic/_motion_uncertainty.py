"""Standard uncertainty of a subset's motion, predicted from its texture and its residual."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Floats
from labpipe.imaging.dic._spline import noise_gain, slope_noise_gain
from labpipe.imaging.dic._subset_solver import Subsets

#: Places per axis at which a subset's sub-pixel positions are sampled.
_PLACES = np.linspace(-1.0, 1.0, 5)
#: Share of the squared slopes that must be texture; below it the subset shows nothing but noise.
_LEAST_TEXTURE = 0.1

#: Share of a pixel's noise variance that the residual must show to tell it.
_LEAST_NOISE_SEEN = 0.01


@dataclass(frozen=True)
class NoiseModel:
    """How noise of one pixel reaches the residual and the slopes.

    Attributes
    ----------
    fraction, gain : arrays
        Variance left along one axis after blur and interpolation, by sub-pixel position.
    slope : float [1/px²]
        Variance of the spline's slope per variance of a pixel, blur included.
    static_frames : int
        Frames averaged into the reference.
    smoothing : array (point,)
        Variance of the motion relative to unblurred noise of the same strength.
    """

    fraction: Floats
    gain: Floats
    slope: float
    static_frames: int
    smoothing: Floats


def make_noise_model(order: int, blur: float, static_frames: int, smoothing: Floats) -> NoiseModel:
    """Tabulate the noise model.

    Parameters
    ----------
    order : 3 or 5
        Spline order.
    blur : float [px]
        Gaussian blur before interpolation.
    static_frames : int
        Frames averaged into the reference.
    smoothing : array (point,)
        See :class:`NoiseModel`.
    """
    fraction = np.linspace(0.0, 1.0, 33)
    gain = noise_gain(order, fraction, blur)
    return NoiseModel(fraction, gain, slope_noise_gain(order, blur), static_frames, smoothing)


def motion_variance(
    model: NoiseModel,
    subsets: Subsets,
    chosen: NDArray[np.int64],
    motion: Floats,
    gain: Floats,
    residual: Floats,
    is_static: NDArray[np.bool_],
) -> tuple[Floats, NDArray[np.bool_]]:
    """Variance of (u, v, rotation) and whether the subset has texture beyond noise.

    Parameters
    ----------
    model : NoiseModel
        How noise is passed on.
    subsets : Subsets
        The reference.
    chosen : integer array (result,)
        Subset of each result.
    motion : array (result, 6)
        As in :class:`.Solution`, like the next two.
    gain, residual : arrays (result,)
    is_static : bool array (result,)
        The frame is one of those averaged into the reference.

    Returns
    -------
    variance : array (result, 3) [px², px², rad²]
        NaN where there is no texture.
    has_texture : bool array (result,)

    Notes
    -----
    The covariance is the inverse normal matrix times the noise variance of the difference of
    frame and reference. The residual shows that variance reduced, because interpolation between
    pixels averages noise; the reduction is known from the positions. Noise also adds to the
    squared slopes of the reference, which makes the normal matrix too large; the surplus is known
    from the noise.
    """
    half = subsets.half[chosen].astype(float)
    pixels = (2.0 * half + 1.0) ** 2
    freedom = pixels - np.where(subsets.is_rigid[chosen], 3, 6) - 2
    variance = residual / np.maximum(freedom, 1.0)
    sampled = _interpolation_gain(model, half, motion)
    shared = np.where(is_static, -1.0, 1.0) / model.static_frames
    square = gain**2
    at_pixels = model.gain[0] ** 2
    # A static frame and the reference share noise; unmoved, their difference is not reduced.
    sampled = np.where(is_static, at_pixels, sampled)
    seen = square * sampled + shared * at_pixels
    passed = square + shared
    # A single static frame is its own reference: their difference shows no noise at all.
    shows_noise = seen > _LEAST_NOISE_SEEN
    pixel_noise = np.where(shows_noise, variance / np.where(shows_noise, seen, 1.0), 0.0)
    passed = np.maximum(passed, 0.0)
    inverse = subsets.inverse[chosen]
    covariance = (pixel_noise * passed * model.smoothing[chosen])[:, None] * np.stack(
        [inverse[:, 0, 0], inverse[:, 3, 3], 0.25 * (inverse[:, 4, 4] + inverse[:, 2, 2] - 2.0 * inverse[:, 2, 4])],
        axis=1,
    )
    slopes = subsets.normal[chosen][:, (0, 3), (0, 3)]
    noise_slopes = pixels * pixel_noise * model.slope / model.static_frames
    texture = 1.0 - noise_slopes[:, None] / np.maximum(slopes, 1e-30)
    has_texture = texture.min(axis=1) > _LEAST_TEXTURE
    texture = np.where(has_texture[:, None], texture, np.nan)
    texture = np.column_stack([texture, texture.mean(axis=1)])
    # Noise of the slopes meets the noise of the frame only: with its own it cancels, because the
    # slope of a pixel does not depend on that pixel and the weights are odd.
    by_frame = np.divide(square, passed, out=np.zeros_like(passed), where=passed > 0)[:, None]
    covariance *= (texture + by_frame * (1.0 - texture)) / texture**2
    return covariance, has_texture


def _interpolation_gain(model: NoiseModel, half: Floats, motion: Floats) -> Floats:
    """Mean over each subset of the variance left after interpolation along both axes."""
    j = half[:, None, None] * _PLACES[None, None, :]
    i = half[:, None, None] * _PLACES[None, :, None]
    u, u_x, u_y, v, v_x, v_y = (motion[:, k, None, None] for k in range(6))
    along_x = np.interp((u + u_x * j + u_y * i) % 1.0, model.fraction, model.gain)
    along_y = np.interp((v + v_x * j + v_y * i) % 1.0, model.fraction, model.gain)
    return np.asarray((along_x * along_y).mean(axis=(1, 2)))
