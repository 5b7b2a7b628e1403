"""Speckle images with known motion: every pixel is evaluated from the formula, never interpolated.

Gaussian blobs at random places are summed and sent through a saturating curve. A motion maps
reference coordinates to frame coordinates; the pixel at X shows the pattern at the point that
moved there. Rigid motions only move the (round) blobs, so the mapping is exact to float64.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

BLACK, WHITE = 40.0, 215.0
KINDS = {"fine": (0.7, 1.1), "medium": (1.3, 2.2), "coarse": (2.5, 4.0)}
_REACH = 5.5  # blob widths after which exp(-r²/2) is below 3e-7
_BLOBS_AT_ONCE = 10_000  # keeps the work arrays below 50 MB


@dataclass(frozen=True)
class Speckle:
    """Blob centres (x, y) and widths in reference px, and the contrast of the curve."""

    x: NDArray[np.float64]
    y: NDArray[np.float64]
    width: NDArray[np.float64]
    mean: float
    scale: float


@dataclass(frozen=True)
class Motion:
    """Rotation by ``angle`` (rad, from x towards y) or strain along x and y about ``centre``, then a shift, in px."""

    dx: float = 0.0
    dy: float = 0.0
    angle: float = 0.0
    centre: tuple[float, float] = (0.0, 0.0)
    strain: tuple[float, float] = (0.0, 0.0)

    def displacement(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Displacement of points (point, 2) in px."""
        return self.move(points) - points

    def move(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Position of points (point, 2) after the motion, in px."""
        cosine, sine = math.cos(self.angle), math.sin(self.angle)
        x, y = (points - np.array(self.centre)).T * (1.0 + np.array(self.strain))[:, None]
        moved = np.stack([cosine * x - sine * y, sine * x + cosine * y], axis=1)
        return moved + np.array(self.centre) + np.array([self.dx, self.dy])


def make_speckle(kind: str, shape: tuple[int, int], seed: int = 0, margin: int = 110) -> Speckle:
    """Scatter blobs over ``shape`` (row, column) and a margin that motion may bring into view."""
    rng = np.random.default_rng(seed)
    low, high = KINDS[kind]
    spacing = 1.25 * (low + high)
    rows, columns = shape
    count = int((rows + 2 * margin) * (columns + 2 * margin) / spacing**2)
    x = rng.uniform(-margin, columns + margin, count)
    y = rng.uniform(-margin, rows + margin, count)
    width = rng.uniform(low, high, count)
    raw = Speckle(x, y, width, 0.0, 1.0)
    field = _field(raw, (min(rows, 200), min(columns, 200)), Motion())
    return Speckle(x, y, width, float(field.mean()), 0.78 / float(field.std()))


def render(
    speckle: Speckle, shape: tuple[int, int], motion: Motion | None = None, noise: float = 0.0, seed: int = 0
) -> NDArray[np.uint8]:
    """One 8-bit image (row, column); ``noise`` is the standard deviation in grey levels."""
    return digitise(grey_levels(speckle, shape, motion), noise, seed)


def grey_levels(speckle: Speckle, shape: tuple[int, int], motion: Motion | None = None) -> NDArray[np.float64]:
    """Noise-free grey levels (row, column) before rounding."""
    field = _field(speckle, shape, motion or Motion())
    mid, half = (WHITE + BLACK) / 2, (WHITE - BLACK) / 2
    return np.asarray(mid + half * np.tanh(speckle.scale * (field - speckle.mean)))


def digitise(grey: NDArray[np.float64], noise: float, seed: int) -> NDArray[np.uint8]:
    """Add white noise and round to whole levels of 8 bit."""
    if noise:
        grey = grey + noise * np.random.default_rng(seed).standard_normal(grey.shape)
    return np.clip(np.rint(grey), 0, 255).astype(np.uint8)


def _field(speckle: Speckle, shape: tuple[int, int], motion: Motion) -> NDArray[np.float64]:
    """Sum of the blobs at every pixel of a frame; a strain stretches the blobs along the axes as well."""
    rows, columns = shape
    stretch = 1.0 + np.array(motion.strain)
    centres = motion.move(np.stack([speckle.x, speckle.y], axis=1))
    reach = math.ceil(_REACH * float(speckle.width.max()))
    x, y = centres.T
    seen = (x > -reach) & (x < columns + reach) & (y > -reach) & (y < rows + reach)
    x, y, width = x[seen], y[seen], speckle.width[seen]
    tall, wide = rows + 4 * reach + 1, columns + 4 * reach + 1
    steps = np.arange(-reach, reach + 1)
    total = np.zeros(tall * wide)
    for part in np.array_split(np.arange(len(x)), len(x) // _BLOBS_AT_ONCE + 1):
        row = np.rint(y[part]).astype(int)[:, None] + steps
        column = np.rint(x[part]).astype(int)[:, None] + steps
        along_y = np.exp(-0.5 * ((row - y[part, None]) / (width[part, None] * stretch[1])) ** 2)
        along_x = np.exp(-0.5 * ((column - x[part, None]) / (width[part, None] * stretch[0])) ** 2)
        place = (row[:, :, None] + 2 * reach) * wide + column[:, None, :] + 2 * reach
        weight = along_y[:, :, None] * along_x[:, None, :]
        total += np.bincount(place.ravel(), weight.ravel(), minlength=tall * wide)
    inside = total.reshape(tall, wide)[2 * reach : 2 * reach + rows, 2 * reach :]
    return inside[:, :columns].copy()


def grid(shape: tuple[int, int], margin: int, step: int) -> NDArray[np.float64]:
    """Points (point, 2) as (x, y) on a square grid that stays ``margin`` px inside."""
    rows, columns = shape
    x, y = np.meshgrid(np.arange(margin, columns - margin, step), np.arange(margin, rows - margin, step))
    return np.stack([x.ravel(), y.ravel()], axis=1).astype(float)


def cramer_rao_bound(
    image: NDArray[np.generic],
    points: NDArray[np.float64],
    subset: int,
    shape: str,
    noise: float,
    static_frames: int = 1,
) -> NDArray[np.float64]:
    """Least standard deviation (point, 2) of (dx, dy) in px that any estimator can have.

    By the Fisher information of the motion with gain and offset as further unknowns, and gradients of the noise-free
    image by the Fourier derivative. The noise of a frame is ``noise`` and the rounding to whole grey levels; the
    reference holds the mean of ``static_frames``.
    """
    variance = (noise**2 + 1 / 12) * (1 + 1 / static_frames)
    grey = np.asarray(image, float)
    gradient_y, gradient_x = (_fourier_slope(grey, axis) for axis in (0, 1))
    half = subset // 2
    i, j = np.mgrid[-half : half + 1, -half : half + 1]
    result = np.empty((len(points), 2))
    for n, (x, y) in enumerate(np.rint(points).astype(int)):
        area = np.s_[y - half : y + half + 1, x - half : x + half + 1]
        gx, gy, f = gradient_x[area], gradient_y[area], grey[area]
        affine = [g * offset for g in (gx, gy) for offset in (i, j)]
        motion = [gx, gy, *([gy * j - gx * i] if shape == "rigid" else affine)]
        jacobian = np.stack([*motion, f, np.ones_like(f)]).reshape(len(motion) + 2, -1)
        covariance = np.linalg.inv(jacobian @ jacobian.T)
        result[n] = np.sqrt(variance * np.diag(covariance)[:2])
    return result


def _fourier_slope(grey: NDArray[np.float64], axis: int) -> NDArray[np.float64]:
    """Band-limited derivative along one axis of the image mirrored to be periodic."""
    mirrored = np.concatenate([grey, np.flip(grey, axis)], axis)
    frequency = 2j * np.pi * np.fft.fftfreq(mirrored.shape[axis])
    weights = frequency[:, None] if axis == 0 else frequency[None, :]
    slope = np.fft.ifft(np.fft.fft(mirrored, axis=axis) * weights, axis=axis).real
    return slope[: grey.shape[0], : grey.shape[1]]


def waves(seed: int) -> Callable[[NDArray[np.float64], NDArray[np.float64]], NDArray[np.float64]]:
    """Texture (x, y in px) of standard deviation 1 and features of some 2.5 px: a sum of waves at random."""
    rng = np.random.default_rng(seed)
    wave = rng.uniform(0.4, 1.6, 80)
    angle, phase = rng.uniform(0.0, 2.0 * np.pi, (2, 80))

    def grey(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
        parts = zip(wave, angle, phase, strict=True)
        return np.asarray(sum(np.sin(k * (x * np.cos(a) + y * np.sin(a)) + p) for k, a, p in parts) / np.sqrt(40.0))

    return grey
