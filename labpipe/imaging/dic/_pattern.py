"""What frames of one blur are matched with: the reference, or the reference as soft as they are.

A change of blur is solved for to first order, as columns of the least squares. Where it is more than
that, whichever of the two is the sharper is blurred until they are alike, and the columns tell what
is left. Focus changes alike in all directions, by a Gaussian; motion within the exposure has one, and
adds the mean along a path.
"""

import math
from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Flags, Floats, Floats32, Integers
from labpipe.imaging.dic._film_window import smooth
from labpipe.imaging.dic._growth import NO_GROWTH, Growth, kernels
from labpipe.imaging.dic._motion_uncertainty import COARSE, NoiseModel, make_noise_model
from labpipe.imaging.dic._spline import LANES, PADDING, node_gradients, prefilter
from labpipe.imaging.dic._subset_cutting import cut_subsets, motion_matrices
from labpipe.imaging.dic._subset_solver import NoiseShown
from labpipe.imaging.dic._subsets import Images, Subsets

#: Patterns kept: that of a focus which swings to and fro, or of a shutter that is open in every other frame.
_KEPT = 18
#: Blur (px) of the image whose bend tells a change of the blur, and where its kernel is cut off.
_SOFT, _BEND_REACH = 0.8, 4
#: Share of the slopes that a growing blur leaves at least: beyond, the first order does not hold.
_LEAST_LEFT = 0.2
#: Share of the points up to which they alone are cut, and choices of points of which what was cut is kept.
_FEW, _KEPT_FEW = 0.25, 4


@dataclass(frozen=True)
class Pattern:
    """What frames of one blur are matched with.

    Attributes
    ----------
    images : Images
        The reference, as soft as the frames where they are softer.
    centres, half, is_rigid : arrays (point, 2) [px], (point,) [px], (point,)
        Of the subsets, see :func:`.cut_subsets`.
    table : NoiseModel
        How noise of one pixel is passed on, not yet of which subsets.
    shown : NoiseShown
        For the solver.
    order : 3 or 5
        Spline order.
    blur : float [px]
        Gaussian blur of reference and frames.
    growth : (int, int, int)
        Weights of the bends, in steps of :data:`STEP`.
    kernel : array (row, column), optional
        By which the frames are blurred where they are sharper.
    """

    images: Images
    centres: Integers
    half: Integers
    is_rigid: Flags
    table: NoiseModel
    shown: NoiseShown
    order: int
    blur: float
    growth: Growth = NO_GROWTH
    kernel: Floats | None = None
    _few: dict[bytes, Subsets] = field(default_factory=dict, repr=False)

    @cached_property
    def subsets(self) -> Subsets:
        """Subsets cut out of the images."""
        return cut_subsets(self.images, self.centres, self.half, self.is_rigid)

    def of(self, chosen: Integers) -> tuple[Subsets, Integers]:
        """Subsets that hold chosen points, and the places of these: of few points they alone are cut, until all are."""
        if "subsets" in vars(self) or len(chosen) > _FEW * len(self.half):
            return self.subsets, chosen
        key = chosen.tobytes()
        if key not in self._few:
            if len(self._few) == _KEPT_FEW:
                self._few.clear()
            self._few[key] = cut_subsets(self.images, self.centres[chosen], self.half[chosen], self.is_rigid[chosen])
        return self._few[key], np.arange(len(chosen))

    @cached_property
    def noise(self) -> NoiseModel:
        """How noise is passed on, for the uncertainties; solving does without."""
        of_frame = self._resisted(self.kernel)
        of_reference = of_frame if self.growth == NO_GROWTH else self._resisted(kernels(self.growth)[0])
        coarse = motion_matrices(*self._coarse, self.subsets, self.images.inside)
        return replace(self.table, smoothing=np.stack([of_frame, of_reference], axis=1), coarse=coarse)

    @cached_property
    def _coarse(self) -> tuple[Floats32, Floats32, Floats32]:
        """Slopes and grey levels blurred by :data:`COARSE`."""
        images = self.images
        return smooth(images.slope_x, COARSE), smooth(images.slope_y, COARSE), smooth(images.grey, COARSE)

    def _resisted(self, kernel: Floats | None) -> Floats:
        """Variance (point,) of a shift by noise of pixels that is blurred, relative to noise that is not."""
        if self.blur <= 0.0 and kernel is None:
            return np.ones(len(self.half))
        # The noise of the motion is that of the slopes blurred once more.
        own = self.images.slope_x, self.images.slope_y
        again = [_convolved(smooth(slope, self.blur), kernel) for slope in own]
        normal = self.subsets.normal
        both = normal[:, 0, 0] + normal[:, 3, 3]
        return np.asarray(sum(self._squares(slope) for slope in again) / np.where(both > 0.0, both, 1.0))

    def _squares(self, slope: Floats32) -> Floats:
        """Squares (point,) of slopes summed over the subsets, gain and offset of the grey levels taken off."""
        inside = np.float32(1.0) if self.images.inside is None else self.images.inside
        mean, energy, pixels = self.subsets.level.T
        own = slope * inside
        total, like = (sums_over(own * part, self.subsets) for part in (np.float32(1.0), self.images.grey))
        like -= mean * total
        squares = sums_over(own * slope, self.subsets) - total**2 / np.maximum(pixels, 1.0)
        return np.asarray(squares - like**2 / np.where(energy > 0.0, energy, 1.0))

    def blurred(self, coefficients: Floats32) -> Floats32:
        """Coefficients of a frame, blurred where the frame is sharper than the reference."""
        import cv2

        if self.kernel is None:
            return coefficients
        rows, columns = coefficients.shape[0] - 2 * PADDING - 1, coefficients.shape[1] - 2 * PADDING - LANES
        inner = coefficients[PADDING : PADDING + rows, PADDING : PADDING + columns]
        found = _convolved(inner, self.kernel)
        after = PADDING + 1, PADDING + LANES
        padded = cv2.copyMakeBorder(found, PADDING, after[0], PADDING, after[1], cv2.BORDER_REFLECT_101)
        return np.asarray(padded, np.float32)

    @cached_property
    def _shares(self) -> Floats:
        """Slopes of the bends (point, 2, 3) [1/px²] along x and along y, as far as they are those of the reference."""
        inside = np.float32(1.0) if self.images.inside is None else self.images.inside
        own = self.images.slope_x * inside, self.images.slope_y * inside
        shares = np.empty((len(self.subsets), 2, 3))
        squares = [sums_over(slope * slope, self.subsets) for slope in own]
        for bend, image in enumerate(self.images.bend):
            for axis, slope in enumerate(node_gradients(prefilter(image, self.order), self.order)):
                shares[:, axis, bend] = sums_over(own[axis] * slope, self.subsets) / squares[axis]
        return shares

    def cut(self, chosen: Integers, counts: Sequence[Flags]) -> Subsets:
        """Cut chosen subsets anew, of which some pixels do not count in a frame, see :func:`.cut_subsets`."""
        own = self.centres[chosen], self.half[chosen], self.is_rigid[chosen]
        return cut_subsets(self.images, *own, counts=counts)

    def noise_in(self, cut: Subsets, chosen: Integers, counts: Sequence[Flags]) -> NoiseModel:
        """Tell how noise is passed on in subsets of :meth:`cut`."""
        coarse = motion_matrices(*self._coarse, cut, self.images.inside, counts)
        return replace(self.noise, smoothing=self.noise.smoothing[chosen], coarse=coarse, _directions={})

    def softened(self, chosen: Integers, weights: Floats) -> tuple[Floats, Floats]:
        """Slopes and noise of frames whose blur has grown beyond that of the pattern, over those of the pattern.

        ``chosen``: integer (result,), usable point of each result; ``weights``: (result, 3) [px²], of the
        bends.

        Returns ``left``: (result, 2), slopes along x and along y of the frame, in the contrast of the
        reference; ``kept``: (result,), variance of the noise of the reference where it is blurred as the
        frame is.

        Notes
        -----
        What the bends have in common with the grey levels themselves is part of the gain.
        """
        if not weights.any():
            return np.ones((len(chosen), 2)), np.ones(len(chosen))
        level, kept = self._kept(chosen, weights)
        left = level[:, None] + np.einsum("nab,nb->na", self._shares[chosen], weights)
        return np.maximum(left, _LEAST_LEFT), kept

    def _kept(self, chosen: Integers, weights: Floats) -> tuple[Floats, Floats]:
        """Contrast (result,) that a growth of the blur leaves, and ``kept`` of :meth:`softened`."""
        subsets, places = self.of(chosen)
        common = subsets.moments[places, 1, -3:] / np.maximum(subsets.level[places, 1:2], 1e-30)
        level = 1.0 - (common * weights).sum(axis=1)
        along, squares = self.table.bends
        kept = level**2 + 2.0 * level * weights[:, 0] * along + (weights**2 * squares).sum(axis=1)
        return level, np.maximum(kept, 0.0)

    @cached_property
    def _of_noise(self) -> tuple[float, float]:
        """Variance of a pixel of the residual, of the frame and of the reference, over that of a pixel."""
        return float(self.table.gain.mean(axis=1).prod()), self.table.own / self.table.static_frames

    def seen_at(self, gain: Floats, kept: Floats | float = 1.0) -> Floats:
        """Variance (point,) of a pixel of the residual over that of a pixel, at gains and what is ``kept``."""
        of_frame, own = self._of_noise
        return np.asarray(gain**2 * of_frame + own * kept)

    def seen(self, chosen: Integers, gain: Floats, weights: Floats) -> Floats:
        """Variance (result,) of a pixel of the residual over that of a pixel, at gains and weights of the bends."""
        return self.seen_at(gain, self._kept(chosen, weights)[1])


@dataclass
class Patterns:
    """Patterns by growth of the blur; those used last are kept.

    Attributes
    ----------
    make : callable
        Makes the pattern of a growth.
    used : set of growths
        Those of frames, which the uncertainties need again; the others were tried only.
    """

    make: Callable[[Growth], Pattern]
    used: set[Growth] = field(default_factory=set)
    _kept: OrderedDict[Growth, Pattern] = field(default_factory=OrderedDict)

    def of(self, growth: Growth) -> Pattern:
        """Pattern for frames whose blur has grown by so much."""
        if growth not in self._kept:
            self._kept[growth] = self.make(growth)
            others = [key for key in self._kept if key not in (NO_GROWTH, growth)]
            if len(others) >= _KEPT:
                del self._kept[next((key for key in others if key not in self.used), others[0])]
        self._kept.move_to_end(growth)
        return self._kept[growth]


def make_pattern(
    grey: Floats32,
    order: int,
    blur: float,
    static_frames: int,
    centres: Integers,
    half: Integers,
    is_rigid: Flags,
    inside: Floats32 | None,
    rounding: float,
    growth: Growth = NO_GROWTH,
) -> Pattern:
    """Cut a pattern out of the mean of the static frames.

    ``grey``: float32 (row, column), that mean, blurred by ``blur``; ``order``: spline order; ``blur``: float
    [px], gaussian blur of reference and frames; ``static_frames``: frames that were averaged; ``centres``:
    integer (point, 2) [px], centre pixels (x, y); ``half``: integer (point,) [px], half widths; ``is_rigid``:
    bool (point,), motion allowed; ``inside``: float32 (row, column), optional, 0 where a mask covers it;
    ``rounding``: float [grey²], variance of a pixel from rounding; ``growth``: (int, int, int), see
    :class:`Pattern`.
    """
    softer, sharper = kernels(growth)
    grey = _convolved(grey, softer)
    images = Images(grey, *node_gradients(prefilter(grey, order), order), _bends(grey), inside)
    table = make_noise_model(order, blur, static_frames, *_noise_of(order, blur, growth))
    return Pattern(images, centres, half, is_rigid, table, table.shown(rounding), order, blur, growth, sharper)


def sums_over(values: NDArray[Any], subsets: Subsets) -> Floats:
    """Sum an image over every subset, from a table of sums."""
    import cv2

    table = cv2.integral(np.asarray(values, np.float64), sdepth=cv2.CV_64F)
    x, y, half = subsets.layout[:, :3].T
    low_x, high_x, low_y, high_y = x - half, x + half + 1, y - half, y + half + 1
    count = table[high_y, high_x] - table[low_y, high_x]
    count += table[low_y, low_x] - table[high_y, low_x]
    return np.asarray(count)


def quickly_changing(grey: Floats | Floats32, subsets: Subsets) -> Floats:
    """Squares (point,) [grey²] of what changes from pixel to pixel, summed over subsets: those of white noise, or more.

    Source: J. Immerkaer, Comput. Vis. Image Underst. 64 (1996) 300-302, https://doi.org/10.1006/cviu.1996.0060.
    """
    import cv2

    across = np.array([1.0, -2.0, 1.0]) / math.sqrt(6.0)
    found = cv2.sepFilter2D(grey.astype(np.float32), cv2.CV_32F, across, across, borderType=cv2.BORDER_REFLECT_101)
    return sums_over(np.square(found), subsets)


def _convolved(image: Floats32, kernel: Floats | None) -> Floats32:
    """Image convolved with a symmetric kernel, mirrored at its border."""
    import cv2

    if kernel is None:
        return image
    middle = len(kernel) // 2
    row, column = kernel[middle], kernel[:, middle]
    if np.abs(np.outer(column, row) - kernel * kernel[middle, middle]).max() < 1e-9:
        along = row / row.sum(), column / column.sum()
        found = cv2.sepFilter2D(image, cv2.CV_32F, *along, borderType=cv2.BORDER_REFLECT_101)
    else:
        found = cv2.filter2D(image, cv2.CV_32F, kernel, borderType=cv2.BORDER_REFLECT_101)
    return np.asarray(found, np.float32)


def _bends(grey: Floats32) -> Floats32:
    """Second derivatives (3, row, column) [1/px²]: sum, difference along x and y, mixed.

    They are those of a softened image: where the blur grows by a variance ``c``, the change of the
    image is to second order ``c / 2`` times the bend of the image blurred by half of ``c``.
    """
    import cv2

    x = np.arange(-_BEND_REACH, _BEND_REACH + 1.0)
    even = np.exp(-0.5 * (x / _SOFT) ** 2)
    even /= even.sum()
    odd = x * even / (x**2 * even).sum()
    twice = (x**2 - (x**2 * even).sum()) * even
    twice *= 2.0 / (x**2 * twice).sum()

    def along(kernel_x: NDArray[np.float64], kernel_y: NDArray[np.float64]) -> NDArray[np.float32]:
        found = cv2.sepFilter2D(grey, cv2.CV_32F, kernel_x, kernel_y, borderType=cv2.BORDER_REFLECT_101)
        return np.asarray(found, np.float32)

    xx, yy, xy = along(twice, even), along(even, twice), along(odd, odd)
    return np.stack([xx + yy, xx - yy, xy])


@lru_cache(maxsize=64)
def _noise_of(order: int, blur: float, growth: Growth) -> tuple[Floats, Floats, float, Floats]:
    """Tell what blur makes of white noise of variance 1 in one image.

    Returns ``frame``: (3,) [1, px², px²], variance of a pixel of the frame, and by how much the variance of its
    blur has grown along x and along y; ``reference``: (3,) [1, 1/px², 1/px²], variance of a pixel, of the slope
    there, and of the slope after a further blur by ``COARSE``; ``along``: float [1/px²]; ``squares``: (3,)
    [1/px⁴], mean products of a pixel of the reference and the sum of its bends, and of each bend and itself, over
    the variance of the pixel.
    """
    softer, sharper = kernels(growth)
    reach = math.ceil(4.0 * math.hypot(blur, COARSE)) + _BEND_REACH + 4 * PADDING
    reach += max(0 if kernel is None else len(kernel) // 2 for kernel in (softer, sharper))
    impulse = np.zeros((2 * reach + 1, 2 * reach + 1))
    impulse[reach, reach] = 1.0
    blurred = smooth(impulse, blur)
    frame, reference = (_convolved(blurred, kernel).astype(np.float64) for kernel in (sharper, softer))
    bends = _bends(reference.astype(np.float32)).astype(np.float64)
    variance = float((reference**2).sum())

    def slope(image: NDArray[np.float64]) -> float:
        return 0.5 * sum(float((found**2).sum()) for found in node_gradients(prefilter(image, order), order))

    place = np.arange(-reach, reach + 1.0) ** 2
    own = blurred.astype(np.float64)
    wider = [float(((frame - own).sum(axis=axis) * place).sum()) for axis in (0, 1)]
    return (
        np.array([(frame**2).sum(), *np.maximum(wider, 0.0)]),
        np.array([variance, slope(reference), slope(smooth(reference, COARSE).astype(np.float64))]),
        float((reference * bends[0]).sum()) / variance,
        (bends**2).sum(axis=(1, 2)) / variance,
    )
