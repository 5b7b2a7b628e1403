"""Contacts through optics that are not simple: coatings, ghosts, bell-shaped beams, lenses that are not round.

Nothing here uses the package. Gaps come from :mod:`.contact_scenes`, whose springs are integrated numerically;
light is computed at 16 places in every pixel, and every point then spread by the lens.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, shift
from scipy.signal import fftconvolve

from labpipe.arrays import Floats
from tests.labpipe.imaging.fringe_film import Scene, expose, over_pixels

#: Places along the side of a pixel, those of a table in each px, and reach of a lens (px).
_SAMPLES, _FINE, _REACH = 4, 200, 15

Field = Callable[[Floats, Floats], Floats]


def even(x: Floats, y: Floats) -> Floats:
    return np.ones(np.broadcast_shapes(x.shape, y.shape))


@dataclass(frozen=True)
class Microscope:
    """What stands between a contact and the camera.

    ``faces`` are the amplitudes that both faces reflect, and the phase (rad) by which what goes to and fro is
    delayed in them; without, there are two beams. ``colours`` are wavelengths (m) and their shares, ``cone``
    the numerical aperture of the light. ``beam``, ``visibility`` and ``haze`` are functions of place, from -1 to 1
    across and down the frame; ``ghosts`` are strength and shift down and across (px); ``lens`` spreads a point.
    """

    scene: Scene = field(default_factory=lambda: Scene(rows=300, columns=360))
    faces: tuple[float, float, float] | None = None
    colours: tuple[tuple[float, float], ...] = ()
    cone: float = 0.0
    beam: Field = even
    visibility: Field = even
    haze: Field | None = None
    ghosts: tuple[tuple[float, float, float], ...] = ()
    lens: Field | None = None

    def light(self, gap: Floats, weakened: float) -> Floats:
        """Light of a gap, about 1 in the mean."""
        scene = self.scene
        if self.faces is not None:
            first, second, delay = self.faces
            wave = np.exp(4j * np.pi * gap / scene.wavelength)
            between = np.abs(1.0 - first * second * wave * np.exp(1j * delay)) ** 2
            share = np.abs(first - second * wave) ** 2 / between / (first + second) ** 2
            return np.asarray(0.1 + 1.5 * share)
        total = np.zeros(gap.shape)
        slants = (np.arange(9) + 0.5) / 9 if self.cone else np.zeros(1)
        for wavelength, share in self.colours or ((scene.wavelength, 1.0),):
            for slant in slants:
                path = 4.0 * np.pi * gap / wavelength * math.sqrt(1.0 - slant * self.cone**2)
                total += share / len(slants) * (1.0 + scene.visibility * weakened * np.cos(path + scene.phase))
        return total

    def image(self, r: Floats, gap: Floats, centre: tuple[float, float]) -> Floats:
        """Mean grey levels; ``r`` and ``gap`` (m) tabulate the contact."""
        scene = self.scene
        x, y = np.arange(scene.columns)[None, :], np.arange(scene.rows)[:, None]
        across, down = 2.0 * x / scene.columns - 1.0, 2.0 * y / scene.rows - 1.0
        # A function of the distance, tabulated to 1/200 px, and for two beams linear in the visibility.
        reach = math.hypot(scene.columns + abs(centre[0]), scene.rows + abs(centre[1])) + 2.0
        gaps = np.interp(np.arange(0.0, reach, 1.0 / _FINE) * scene.pixel_size, r, gap)
        lines = [self.light(gaps, weakened) for weakened in (0.0, 1.0)]
        dark, bright = over_pixels(lines, _FINE, scene, centre, _SAMPLES)
        light = (dark + self.visibility(across, down) * (bright - dark)) * self.beam(across, down)
        if self.haze is not None:
            light += self.haze(across, down)
        light = light + sum(s * shift(light, (dy, dx), order=1, mode="nearest") for s, dy, dx in self.ghosts)
        if self.lens is not None:
            places = np.arange(-_REACH, _REACH + 1.0)
            spread = self.lens(places[None, :], places[:, None])
            light = fftconvolve(np.pad(light, _REACH, mode="edge"), spread / spread.sum(), mode="valid")
        return np.asarray(scene.mean * light)

    def film(
        self, gap_of: Callable[[Floats, float], Floats], radii: list[float], centre: tuple[float, float], seed: int
    ) -> NDArray[np.integer]:
        """A film (frame, row, column): one contact radius (m) in every frame, and new noise."""
        scene, rng = self.scene, np.random.default_rng(seed)
        reach = 1.3 * (math.hypot(scene.rows, scene.columns) + math.hypot(*centre)) * scene.pixel_size
        frames = []
        for a in radii:
            r = np.concatenate([np.linspace(0.0, a, 20)[:-1], a + (reach - a) * np.linspace(0.0, 1.0, 4000) ** 2])
            frames.append(expose(self.image(r, gap_of(r, a), centre), scene, rng))
        return np.stack(frames)


def bell(width: float, x: float, y: float) -> Field:
    """Beam of a laser whose middle lies aside."""
    return lambda across, down: np.exp(-((across - x) ** 2 + (down - y) ** 2) / width)


def grainy(strength: float, size: float) -> Field:
    """Speckle that stands still, of grains so many pixels wide."""

    def beam(across: Floats, down: Floats) -> Floats:
        noise = np.random.default_rng(1).standard_normal((down.size, across.size))
        return np.asarray(1.0 + strength * 2.0 * math.sqrt(math.pi) * size * gaussian_filter(noise, size))

    return beam


def oval(first: float, second: float, turn: float) -> Field:
    """Astigmatic lens: a Gaussian of two widths (px)."""

    def spread(x: Floats, y: Floats) -> Floats:
        along, aside = math.cos(turn) * x + math.sin(turn) * y, math.cos(turn) * y - math.sin(turn) * x
        return np.asarray(np.exp(-0.5 * ((along / first) ** 2 + (aside / second) ** 2)))

    return spread


def comet(x: Floats, y: Floats) -> Floats:
    """Lens with a tail to one side."""
    parts = ((1.0, 0.0, 0.7), (0.6, 1.2, 1.1), (0.35, 2.6, 1.6))
    light = (w * np.exp(-0.5 * ((x - d) ** 2 + (y - 0.5 * d) ** 2) / s**2) / s**2 for w, d, s in parts)
    return np.asarray(sum(light))


def shaken(x: Floats, y: Floats) -> Floats:
    """Camera that moves by 6 px along its rows in the exposure."""
    return np.where(np.abs(x) < 3.0, 1.0, 0.0) * np.exp(-0.5 * (y / 0.6) ** 2)


def haloed(x: Floats, y: Floats) -> Floats:
    """Lens that spreads a fifth of the light over 5 px."""
    square = x**2 + y**2
    return np.asarray(0.8 * np.exp(-0.5 * square / 0.36) / 0.36 + 0.2 * np.exp(-0.5 * square / 25.0) / 25.0)
