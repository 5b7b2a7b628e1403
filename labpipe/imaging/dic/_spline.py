"""Exact B-spline interpolation of images: the recursive prefilter and what follows from it.

An image is turned once into B-spline coefficients; values between pixels are then short weighted
sums. The filter runs over the whole line in both directions (Unser 1999), because a truncated one
costs 0.0045 px of bias in image correlation. Importing this module imports numba.
"""

import math

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Floats, Floats32
from labpipe.compilation import njit
from labpipe.errors import InputError

#: Poles of the interpolating prefilter of each supported order.
POLES: dict[int, tuple[float, ...]] = {
    3: (math.sqrt(3.0) - 2.0,),
    5: (
        math.sqrt(67.5 - math.sqrt(4436.25)) + math.sqrt(26.25) - 6.5,
        math.sqrt(67.5 + math.sqrt(4436.25)) - math.sqrt(26.25) - 6.5,
    ),
}
#: B-spline and its derivative at the whole numbers: weights of a node and of its slope.
NODE_WEIGHTS: dict[int, tuple[float, ...]] = {
    3: (1 / 6, 4 / 6, 1 / 6),
    5: (1 / 120, 26 / 120, 66 / 120, 26 / 120, 1 / 120),
}
NODE_SLOPES: dict[int, tuple[float, ...]] = {3: (-1 / 2, 0.0, 1 / 2), 5: (-1 / 24, -10 / 24, 0.0, 10 / 24, 1 / 24)}
#: Mirrored coefficients on each side, so that a subset may touch the border of the frame.
PADDING = 8
#: The solver computes whole vectors of this many pixels; the surplus is read and dropped.
LANES = 8
#: Pixels after which a pole's influence is below the resolution of float32 (0.43^20 = 5e-8).
HORIZON = 20


@njit(cache=True, nogil=True, fastmath={"contract"})
def _filter_columns(block: Floats32, poles: Floats) -> None:
    """Run the recursive filter down every column, in place, mirrored at both ends."""
    rows, columns = block.shape
    width = np.uint64(columns)
    for pole in poles:
        z = np.float32(pole)
        first = block[0]
        power = pole
        period = 2 * rows - 2
        for k in range(1, HORIZON + 1):
            reflected = k % period
            source = block[reflected if reflected < rows else period - reflected]
            weight = np.float32(power)
            for c in range(width):
                first[c] += weight * source[c]
            power *= pole
        for r in range(1, rows):
            here, before = block[r], block[r - 1]
            for c in range(width):
                here[c] += z * before[c]
        last, before = block[rows - 1], block[rows - 2]
        end = np.float32(pole / (pole * pole - 1.0))
        for c in range(width):
            last[c] = end * (last[c] + z * before[c])
        for r in range(rows - 2, -1, -1):
            here, after = block[r], block[r + 1]
            for c in range(width):
                here[c] = z * (after[c] - here[c])


def prefilter(
    image: NDArray[np.generic], order: int, out: Floats32 | None = None, overwrite_image: bool = False
) -> Floats32:
    """Compute the B-spline coefficients of an image, with a mirrored border around them.

    Parameters
    ----------
    image : array (row, column)
        Grey levels of any real type; at least 9 by 9 pixels.
    order : 3 or 5
        Cubic or quintic.
    out : array (row + 17, column + 24), optional
        Array of an earlier call on the same shape, to be filled again.
    overwrite_image : bool
        ``image`` is contiguous float32 and may be destroyed: fresh memory costs as much as the filter.

    Returns
    -------
    array (row + 17, column + 24) of float32
        Coefficient of pixel (r, c) at ``[PADDING + r, PADDING + c]``; beyond the mirrored border
        lie one row and some columns of zeros that a vector load may touch.

    Raises
    ------
    InputError
        Another order, or an image smaller than the mirrored border needs.

    Notes
    -----
    Mirrored about the outermost pixels (``scipy.ndimage`` mode "mirror"). Computed in float32:
    the values at the pixels return to within 1e-6 of the grey range.

    References
    ----------
    M. Unser, Splines: a perfect fit for signal and image processing, IEEE Signal Processing
    Magazine 16 (1999) 22-38, https://doi.org/10.1109/79.799930

    Examples
    --------
    >>> coefficients = prefilter(np.full((9, 9), 7.0), 3)
    >>> float(round(coefficients[PADDING + 4, PADDING + 4], 4))
    7.0
    """
    if order not in POLES:
        message = f"spline order must be 3 (cubic) or 5 (quintic), found {order}"
        raise InputError(message)
    if image.ndim != 2 or min(image.shape) <= PADDING:
        message = (
            f"an image of at least {PADDING + 1} by {PADDING + 1} pixels is needed for spline "
            f"interpolation, found shape {image.shape}"
        )
        raise InputError(message)
    rows, columns = image.shape
    shape = (rows + 2 * PADDING + 1, columns + 2 * PADDING + LANES)
    if out is None or out.shape != shape:
        out = np.zeros(shape, np.float32)
    import cv2

    bottom, right = PADDING + rows, PADDING + columns
    poles = np.array(POLES[order])
    gain = np.prod((1.0 - poles) * (1.0 - 1.0 / poles))
    work = np.asarray(image, np.float32) if overwrite_image else np.array(image, np.float32, order="C")
    work *= np.float32(gain**2)
    _filter_columns(work, poles)
    across = out.reshape(-1)[: rows * columns].reshape(columns, rows)
    cv2.transpose(work, across)
    _filter_columns(across, poles)
    cv2.transpose(across, work)
    out[PADDING:bottom, PADDING:right] = work
    out[-1] = out[:, -LANES:] = 0.0
    out[PADDING:bottom, :PADDING] = out[PADDING:bottom, 2 * PADDING : PADDING : -1]
    out[PADDING:bottom, right : right + PADDING] = out[PADDING:bottom, right - 2 : right - 2 - PADDING : -1]
    out[:PADDING] = out[2 * PADDING : PADDING : -1]
    out[bottom : bottom + PADDING] = out[bottom - 2 : bottom - 2 - PADDING : -1]
    return out


def node_gradients(coefficients: Floats32, order: int) -> tuple[Floats32, Floats32]:
    """Differentiate the spline at the pixels themselves.

    Parameters
    ----------
    coefficients : array from :func:`prefilter`
        Coefficients with border.
    order : 3 or 5
        The order they were made for.

    Returns
    -------
    gradient_x, gradient_y : arrays (row, column) of float32
        Slope along the row (x, to the right) and down the column (y), grey levels per pixel.
    """
    import cv2

    inner = slice(PADDING, coefficients.shape[0] - PADDING - 1), slice(PADDING, coefficients.shape[1] - PADDING - LANES)
    node, slope = np.array(NODE_WEIGHTS[order], np.float32), np.array(NODE_SLOPES[order], np.float32)
    gradient_x = cv2.sepFilter2D(coefficients, cv2.CV_32F, slope, node)[inner]
    gradient_y = cv2.sepFilter2D(coefficients, cv2.CV_32F, node, slope)[inner]
    return np.asarray(gradient_x, np.float32), np.asarray(gradient_y, np.float32)


def _impulse_response(order: int, blur: float) -> Floats:
    """Spline coefficients of a blurred single pixel along one axis."""
    from scipy.ndimage import gaussian_filter1d, spline_filter1d

    impulse = np.zeros(6 * HORIZON + 1)
    impulse[3 * HORIZON] = 1.0
    if blur > 0.0:
        impulse = gaussian_filter1d(impulse, blur, truncate=4.0)
    return np.asarray(spline_filter1d(impulse, order, mode="mirror"))


def noise_gain(order: int, fraction: Floats, blur: float = 0.0) -> Floats:
    """How much of a pixel's noise variance is left after interpolation along one axis.

    Parameters
    ----------
    order : 3 or 5
        Spline order.
    fraction : array [px]
        Position between two pixels, 0 to 1.
    blur : float [px]
        Gaussian blur before interpolation.

    Returns
    -------
    array
        Variance of the interpolated value for white noise of variance 1. Without blur 1 at the
        pixels, 0.76 (cubic) or 0.84 (quintic) half-way. Along two axes the factors multiply.
    """
    from scipy.ndimage import map_coordinates

    coefficients = _impulse_response(order, blur)
    nodes = np.arange(HORIZON, 5 * HORIZON)[:, None] + np.asarray(fraction)[None, :]
    values = map_coordinates(coefficients, nodes.reshape(1, -1), order=order, prefilter=False, mode="mirror")
    return np.asarray((values.reshape(nodes.shape) ** 2).sum(axis=0))


def slope_noise_gain(order: int, blur: float = 0.0) -> float:
    """Variance of the spline's slope at a pixel for white noise of variance 1.

    Parameters
    ----------
    order : 3 or 5
        Spline order.
    blur : float [px]
        Gaussian blur before interpolation.

    Returns
    -------
    float [1/px²]
        Without blur 1.4 (cubic) or 1.9 (quintic): noise looks like texture to a gradient, and
        this is how much.
    """
    slope = np.convolve(_impulse_response(order, blur), NODE_SLOPES[order])
    return float((slope**2).sum() * noise_gain(order, np.zeros(1), blur)[0])
