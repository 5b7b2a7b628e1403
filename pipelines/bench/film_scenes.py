"""Films of known motion for image correlation, made in another way than the speckles of its tests.

Random fields and photographs are moved by the phases of their Fourier coefficients, where blur is
a factor; Perlin noise, edges and gratings are formulas of the place, so that any motion is exact.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.special import j1

from labpipe.arrays import Floats

Film = NDArray[np.uint8]
#: Grey levels (about 0) at places x, y in px of the first frame.
Formula = Callable[[Floats, Floats], Floats]

_MEAN, _CONTRAST = 127.0, 38.0
#: Width of an edge (px, standard deviation of its blur), as of a lens in focus.
_SHARPNESS = 0.8


@dataclass(frozen=True, slots=True)
class View:
    """How one frame differs from the pattern itself.

    ``shift`` (float, float) [px]: to the right and downwards; ``scale``, ``angle`` [1] [rad]: about the middle of the
    image; for formulas only; ``defocus`` [px]: standard deviation of a Gaussian blur; for spectra only, as the next
    two; ``disc`` [px]: radius of a disc, as a lens out of focus makes it; ``smear`` (float, float) [px]: path during
    the exposure; ``light``: gain at the middle, and its change per px to the right and downwards.
    """

    shift: tuple[float, float] = (0.0, 0.0)
    scale: float = 1.0
    angle: float = 0.0
    defocus: float = 0.0
    disc: float = 0.0
    smear: tuple[float, float] = (0.0, 0.0)
    light: tuple[float, float, float] = (1.0, 0.0, 0.0)

    def displacement(self, points: Floats, size: int) -> Floats:
        """Displacement (point, 2) in px of points (point, 2) of the first frame."""
        middle = 0.5 * (size - 1)
        x, y = (points - middle).T
        cosine, sine = self.scale * math.cos(self.angle), self.scale * math.sin(self.angle)
        moved = np.stack([cosine * x - sine * y, sine * x + cosine * y], axis=1)
        return np.asarray(moved + middle + np.array(self.shift) - points)


def from_spectrum(pattern: Floats, view: View) -> Floats:
    """Grey levels of a periodic pattern (row, column) as seen in a view."""
    frequency_y = 2.0 * np.pi * np.fft.fftfreq(pattern.shape[0])[:, None]
    frequency_x = 2.0 * np.pi * np.fft.rfftfreq(pattern.shape[1])[None, :]
    along = frequency_x * view.shift[0] + frequency_y * view.shift[1]
    factor = np.exp(-1j * along - 0.5 * view.defocus**2 * (frequency_x**2 + frequency_y**2))
    radius = np.maximum(view.disc * np.hypot(frequency_x, frequency_y), 1e-9)
    factor *= (
        2.0 * j1(radius) / radius * np.sinc((frequency_x * view.smear[0] + frequency_y * view.smear[1]) / (2.0 * np.pi))
    )
    return _lit(np.fft.irfft2(np.fft.rfft2(pattern) * factor, pattern.shape), view)


def from_formula(formula: Formula, size: int, view: View) -> Floats:
    """Grey levels (row, column) of a formula as seen in a view."""
    middle = 0.5 * (size - 1)
    row, column = np.mgrid[:size, :size] - middle
    x, y = column - view.shift[0], row - view.shift[1]
    cosine, sine = math.cos(view.angle) / view.scale, math.sin(view.angle) / view.scale
    return _lit(formula(cosine * x + sine * y + middle, cosine * y - sine * x + middle), view)


def _lit(grey: Floats, view: View) -> Floats:
    """Illuminate a pattern about 0."""
    row, column = np.mgrid[: grey.shape[0], : grey.shape[1]]
    gain, along_x, along_y = view.light
    middle = 0.5 * (np.array(grey.shape) - 1.0)
    light = gain + along_x * (column - middle[1]) + along_y * (row - middle[0])
    return np.asarray((_MEAN + grey) * light)


def digitised(frames: Sequence[Floats], noise: float, seed: int) -> Film:
    """Film (frame, row, column) of 8 bit with white noise (grey levels)."""
    rng = np.random.default_rng(seed)
    noisy = [grey + noise * rng.standard_normal(grey.shape) for grey in frames]
    return np.stack([np.clip(np.rint(grey), 0, 255).astype(np.uint8) for grey in noisy])


def random_field(size: int, feature: float, seed: int) -> Floats:
    """Gaussian random field (row, column), periodic, about 0; ``feature`` is its blur in px."""
    rng = np.random.default_rng(seed)
    frequency = 2.0 * np.pi * np.fft.fftfreq(size)
    envelope = np.exp(-0.5 * feature**2 * (frequency[:, None] ** 2 + frequency[None, : size // 2 + 1] ** 2))
    field = np.fft.irfft2(np.fft.rfft2(rng.standard_normal((size, size))) * envelope, (size, size))
    return np.asarray(_CONTRAST * (field - field.mean()) / field.std())


@cache
def photograph(size: int) -> Floats:
    """Square part (row, column) of the photograph that matplotlib brings along, made periodic.

    It is reduced to half its size, which removes the traces of its compression, and mirrored, so
    that it can be moved by its spectrum.
    """
    import cv2
    import matplotlib

    path = Path(matplotlib.get_data_path()) / "sample_data" / "grace_hopper.jpg"
    grey = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    assert grey is not None  # noqa: S101 - a file of an installed package
    half = cv2.resize(cv2.GaussianBlur(grey.astype(np.float64), (0, 0), 1.4), None, fx=0.5, fy=0.5)
    part = half[: size // 2, : size // 2]
    whole = np.concatenate([part, part[:, ::-1]], axis=1)
    return np.asarray(np.concatenate([whole, whole[::-1]]) - _MEAN, float)


def perlin(cell: float, seed: int, octaves: int = 2) -> Formula:
    """Gradient noise of Perlin on cells of a width in px, about 0."""
    rng = np.random.default_rng(seed)
    angle = rng.uniform(0.0, 2.0 * np.pi, (octaves, 256 * 256))
    slopes = np.cos(angle), np.sin(angle)

    def noise(x: Floats, y: Floats) -> Floats:
        total = np.zeros(np.shape(x))
        for octave, (along_x, along_y) in enumerate(zip(*slopes, strict=True)):
            width = cell / 2.0**octave
            total += _gradient_noise(x / width, y / width, along_x, along_y) / 2.0**octave
        return np.asarray(160.0 * total)

    return noise


def _gradient_noise(x: Floats, y: Floats, along_x: Floats, along_y: Floats) -> Floats:
    """Noise of Perlin whose slopes at the corners of 256 rows of 256 cells are given, row after row."""
    column, row = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
    fx, fy = x - column, y - row
    columns, rows = (column & 255, (column + 1) & 255), ((row & 255) << 8, ((row + 1) & 255) << 8)

    def corner(across: int, down: int) -> Floats:
        place = rows[down] + columns[across]
        return np.asarray(along_x.take(place) * (fx - across) + along_y.take(place) * (fy - down))

    fade_x, fade_y = (t * t * t * (t * (6.0 * t - 15.0) + 10.0) for t in (fx, fy))
    upper, lower = ((1.0 - fade_x) * corner(0, down) + fade_x * corner(1, down) for down in (0, 1))
    return np.asarray(upper + fade_y * (lower - upper))


def edge(angle: float, place: tuple[float, float], grain: float, seed: int) -> Formula:
    """Bare straight edge through a place, with a grain (grey levels) of two pixels' width."""
    from scipy.special import erf

    texture = perlin(5.0, seed, octaves=1)

    def grey(x: Floats, y: Floats) -> Floats:
        across = (x - place[0]) * math.cos(angle) + (y - place[1]) * math.sin(angle)
        # 40 is the standard deviation of the texture as it is
        return np.asarray(60.0 * erf(across / (_SHARPNESS * math.sqrt(2.0))) + grain / 40.0 * texture(x, y))

    return grey


def bars(angle: float, period: float, sharpness: float) -> Formula:
    """Square wave along one direction; ``sharpness`` is the share of its period in which it rises."""

    def grey(x: Floats, y: Floats) -> Floats:
        along = x * math.cos(angle) + y * math.sin(angle)
        return np.asarray(60.0 * np.tanh(np.sin(2.0 * np.pi / period * along) / sharpness))

    return grey


def cells(angle: float, width: float, seed: int) -> Formula:
    """Square cells, black or white, with edges sharper than any lens shows."""
    dark = np.random.default_rng(seed).random((128, 128)) < 0.5

    def grey(x: Floats, y: Floats) -> Floats:
        across, along = x * math.cos(angle) + y * math.sin(angle), y * math.cos(angle) - x * math.sin(angle)
        row, column = (np.floor(place / width).astype(np.int64) % 128 for place in (along, across))
        return np.where(dark[row, column], -50.0, 50.0)

    return grey


def bricks(angle: float, height: float, joint: float, seed: int) -> Formula:
    """Bricks of twice their height, each of its own grey, between dark joints."""
    tones = np.random.default_rng(seed).uniform(-15.0, 20.0, (256, 256))

    def grey(x: Floats, y: Floats) -> Floats:
        across, along = x * math.cos(angle) + y * math.sin(angle), y * math.cos(angle) - x * math.sin(angle)
        course = np.floor(across / height).astype(np.int64)
        along = along + height * (course % 2)
        tone = 20.0 + tones[course % 256, np.floor(along / (2.0 * height)).astype(np.int64) % 256]
        return np.where((across % height < joint) | (along % (2.0 * height) < joint), -50.0, tone)

    return grey


def seen_by_pixels(formula: Formula, size: int, view: View) -> Floats:
    """Grey levels (row, column) of a formula behind a lens that blurs by ``view.defocus``, mean over each pixel.

    The places of a lattice have as many columns as there are places: of a square of as many, an edge along the
    columns would be seen in steps. They are alike on both sides of its middle: of others a blur would shift edges.
    """
    from scipy.special import ndtr

    count, blur = 89, max(view.defocus, 1e-3)
    share = (np.arange(count) + 0.5) / count
    z = np.linspace(-8.0, 8.0, 8001)
    within = ndtr((z + 0.5) / blur) - ndtr((z - 0.5) / blur)
    within = within.cumsum() - 0.5 * within
    column = np.interp(share, within / within[-1], z)
    row = column[(np.arange(count) * 55 + 27) % count]
    lattice = list(zip(column, row, strict=True))
    return from_formula(lambda x, y: np.asarray(sum(formula(x + a, y + b) for a, b in lattice) / count), size, view)


def blurred_by_camera(formula: Formula, size: int, view: View) -> Floats:
    """Grey levels (row, column) of a formula at the middles of the pixels, blurred by ``view.defocus`` after that."""
    from scipy.ndimage import gaussian_filter

    return np.asarray(gaussian_filter(from_formula(formula, size, view), view.defocus))


def dots(angle: float, period: float, sharpness: float) -> Formula:
    """Grid of spots of one size."""

    def grey(x: Floats, y: Floats) -> Floats:
        wave = 2.0 * np.pi / period
        along = np.sin(wave * (x * math.cos(angle) + y * math.sin(angle)))
        across = np.sin(wave * (y * math.cos(angle) - x * math.sin(angle)))
        return np.asarray(60.0 * np.tanh((along * across - 0.3) / sharpness))

    return grey
