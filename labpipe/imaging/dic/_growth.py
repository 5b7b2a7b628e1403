"""By how much the blur of frames differs from that of the reference, and the kernels that make them alike."""

import math

import numpy as np

from labpipe.arrays import Floats
from labpipe.imaging.dic._subset_kernel import BLUR
from labpipe.imaging.dic._subset_solver import SOLVED, Solution

#: Share of the points whose light or blur has changed from which that of all has, and above which it is no chance.
COMMON, CHANCE = 0.5, 0.1
#: Weights of the three bends, in steps of :data:`STEP`, by which the blur of frames differs, and its shape.
Growth = tuple[int, int, int, int]
NO_GROWTH: Growth = (0, 0, 0, 0)
#: Step (px²) of these weights; by less the columns tell it.
STEP = 0.02
#: Weights of the patterns that are made: up to the first (px²) they are apart by it times the second, beyond
#: by themselves times the second, which is less of sharper frames, since the first order tells them worse.
#: Directions (rad, twice those of a path) are apart by the third; and the largest.
_FINE, _SPACING, _TURN, _MOST_GROWTH = 0.3, (0.15, 0.08), math.pi / 12.0, 24.0
#: Growth of the variance in one direction, over that in the other, which rounding to whole steps makes.
_ROUNDING = 0.15
#: Shapes of a blur that is alike in all directions: a Gaussian, a disc, a circle.
SHAPES = 3
#: Growth of the variance (px²) alike in all directions from which its shape tells, in one direction from which it
#: may turn the contrast round, and by how much more both tell more; and how much smaller others are.
_TELLS_SHAPE, _TURNS_ROUND, _TELLS_MORE = 0.3, 2.0, 2.0
_SCALES = 1.0, 0.75, 0.55
#: Weights (px²) of blurs so wide that most points are lost at once, of those alike in all directions and of paths, and
#: directions of these.
_WIDE, _LONG, _TURNS = (2.0, 6.0, 16.0), (3.0, 8.0), 6
#: Half width (px) of the kernels, beyond the standard deviations of the blur.
_REACH, _DEVIATIONS = 6, 5.0


def more_blur(found: Solution) -> Floats:
    """Tell the weights of the bends (3,) [px²] that most of the points show; 0 where most show no change of blur."""
    is_solved = found.code == SOLVED
    tell = is_solved & ((found.model & BLUR) > 0)
    if tell.sum() < COMMON * is_solved.sum() or ((found.needed[tell] & BLUR) > 0).sum() <= CHANCE * tell.sum():
        return np.zeros(3)
    return np.asarray(np.median(found.change[tell, 2:], axis=0))


def grown(growth: Growth, more: Floats, shape: int = 0) -> Growth:
    """Tell the growth of the blur after that of a pattern has grown by weights of the bends (3,) [px²].

    That is one of a grid, so that frames of like blur share a pattern; the columns tell what is left. Where
    there was none, it is of a ``shape``.
    """
    mean, apart, mixed = np.array(growth[:3]) * STEP + more
    spacing = _SPACING[int(mean < 0.0)]
    length, side = math.hypot(apart, 0.5 * mixed), math.copysign(1.0, mean)
    alike = _on_grid(float(np.clip(mean, -_MOST_GROWTH, _MOST_GROWTH)) - side * length, spacing)
    length = _on_grid(min(length, _MOST_GROWTH), spacing)
    turn = round(math.atan2(0.5 * mixed, apart) / _TURN) * _TURN
    weights = alike + side * length, length * math.cos(turn), 2.0 * length * math.sin(turn)
    first, second, third = (round(weight / STEP) for weight in weights)
    if not (first or second or third):
        return NO_GROWTH
    return first, second, third, shape if growth == NO_GROWTH else growth[3]


def sizes(growth: Growth) -> Floats:
    """Growth of the variance (2,) [px²] alike in all directions, and in the direction in which it is largest."""
    mean, apart, mixed = (STEP * step for step in growth[:3])
    length = math.hypot(apart, 0.5 * mixed)
    return np.array([2.0 * (abs(mean) - length), 2.0 * (abs(mean) + length)])


def others_like(growth: Growth, weighed: Floats) -> list[list[Growth]]:
    """Growths of each shape, other or smaller, to compare with one whose :func:`sizes` are beyond those ``weighed``.

    Where a blur is so wide that it turns the contrast of the pattern round, the columns lead elsewhere.
    """
    tells, turns = sizes(growth) > np.maximum(_TELLS_MORE * weighed, (_TELLS_SHAPE, _TURNS_ROUND))
    shapes = range(SHAPES) if tells else [growth[3]]
    scales = _SCALES if turns else _SCALES[:1]
    first, second, third = growth[:3]
    every = [
        [(round(first * scale), round(second * scale), round(third * scale), shape) for scale in scales]
        for shape in shapes
    ]
    return [others for others in ([one for one in same if one != growth] for same in every) if others]


def wide_blurs() -> list[Growth]:
    """Tell growths from which those lead on whose blur is so wide that nothing is found without it."""
    turns = [(1.0, math.cos(turn), 2.0 * math.sin(turn)) for turn in np.arange(_TURNS) * (2.0 * math.pi / _TURNS)]
    paths = [weight * np.array(turn) for weight in _LONG for turn in turns]
    return [grown(NO_GROWTH, weights) for weights in [weight * np.array([1.0, 0.0, 0.0]) for weight in _WIDE] + paths]


def _on_grid(weight: float, spacing: float) -> float:
    """Nearest weight of those that patterns have; the softer a pattern is, the less it matters."""
    return _FINE * math.sinh(spacing * round(math.asinh(weight / _FINE) / spacing))


def kernels(growth: Growth) -> tuple[Floats | None, Floats | None]:
    """Kernels that make the reference, and the frames, as soft as the other; None where nothing is to be done."""
    if growth == NO_GROWTH:
        return None, None
    mean, apart, mixed = (step * STEP for step in growth[:3])
    tensor = 2.0 * np.array([[mean + apart, 0.5 * mixed], [0.5 * mixed, mean - apart]])
    values, vectors = np.linalg.eigh(tensor)
    # one direction as little softer as whole steps cannot tell it, where the other is much sharper
    values[values * values.sum() < 0.0] *= np.abs(values).min() > _ROUNDING * np.abs(values).max()
    return _kernel(np.maximum(values, 0.0), vectors, growth[3]), _kernel(np.maximum(-values, 0.0), vectors, growth[3])


def _kernel(variances: Floats, directions: Floats, shape: int) -> Floats | None:
    """Kernel (row, column) of a shape and of the lesser variance (px²), and a path along the other direction."""
    low, high = float(variances.min()), float(variances.max())
    if high <= 0.0:
        return None
    path = math.sqrt(12.0 * (high - low)) * directions[:, int(variances.argmax())]
    reach = _REACH + math.ceil(_DEVIATIONS * math.sqrt(high))
    frequency = 2.0 * np.pi * np.fft.fftfreq(4 * reach)
    x, y = frequency[None, :], frequency[:, None]
    alike = _transfer(math.sqrt(low) * np.hypot(x, y), shape)
    transfer = alike * np.sinc((x * path[0] + y * path[1]) / (2.0 * np.pi))
    whole = np.fft.fftshift(np.fft.ifft2(transfer).real)
    middle = 2 * reach
    kernel = whole[middle - reach : middle + reach + 1, middle - reach : middle + reach + 1]
    return np.asarray(kernel / kernel.sum())


def _transfer(frequency: Floats, shape: int) -> Floats:
    """Transfer function of a blur at frequencies times its standard deviation: of a Gaussian, a disc, or a circle."""
    from scipy.special import j0, j1

    if shape == 0:
        return np.asarray(np.exp(-0.5 * frequency**2))
    if shape == 2:
        return np.asarray(j0(math.sqrt(2.0) * frequency))
    radius = np.maximum(2.0 * frequency, 1e-9)
    return np.asarray(2.0 * j1(radius) / radius)
