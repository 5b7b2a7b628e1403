"""The images from which a camera is calibrated (appendix D): a ruler, and the holder's edges.

Lines and edges are blurred boxes and steps, evaluated in closed form at every pixel.
"""

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.special import erf

from labpipe import files
from labpipe.arrays import Floats
from pipelines.rig.apparatus import VIEWS
from pipelines.rig.film_under import taken
from pipelines.rig.session_text import write_truth


@dataclass(frozen=True, slots=True)
class Photograph:
    """An image with blur and noise, tilted [rad] against the lines that it shows; px and grey levels.

    A glass ruler has a line of ``width`` every ``graduation``, in m.
    """

    rows: int
    columns: int
    tilt: float
    seed: int
    blur: float = 1.4
    noise: float = 2.0
    light: float = 190.0
    ink: float = 60.0
    graduation: float = 1e-4
    width: float = 1e-5

    def ruler(self, scale: float = 1e3 * VIEWS.under) -> NDArray[np.uint8]:
        """Draw a ruler; ``scale`` is in px/m."""
        pitch, half = scale * self.graduation, 0.5 * scale * self.width
        phase = np.mod(self._across() + 0.5 * pitch, pitch) - 0.5 * pitch
        return self._taken(self.light - (self.light - self.ink) * self._between(phase, half))

    def holder(self, width: float = VIEWS.holder) -> NDArray[np.uint8]:
        """Draw the bright holder, ``width`` px wide, before a dark ground."""
        return self._taken(self.ink + (self.light - self.ink) * self._between(self._across(), 0.5 * width))

    def _across(self) -> Floats:
        """Distance of every pixel from the middle line, at right angles to the lines."""
        x = np.arange(self.columns) - 0.5 * (self.columns - 1)
        y = np.arange(self.rows)[:, None] - 0.5 * (self.rows - 1)
        return np.asarray(x * np.cos(self.tilt) + y * np.sin(self.tilt))

    def _between(self, place: Floats, half: float) -> Floats:
        """Share of every pixel that lies within half a width of a line."""
        low, high = (0.5 * (1 + erf((place + edge) / (np.sqrt(2) * self.blur))) for edge in (-half, half))
        return np.asarray(high - low)

    def _taken(self, grey: Floats) -> NDArray[np.uint8]:
        return taken(grey, self.noise, np.random.default_rng(self.seed))


def write_calibration_images(folder: Path, seed: int = 71) -> list[str]:
    """Write both images as PNG and their truth; returns the names of the images."""
    tilts = {"ruler_under": 0.012, "holder_front": -0.006}
    ruler = Photograph(240, 1280, tilts["ruler_under"], seed)
    holder = Photograph(240, 640, tilts["holder_front"], seed + 1)
    images = {"ruler_under": ruler.ruler(), "holder_front": holder.holder()}
    for name, image in images.items():
        files.write_bytes(folder / f"calibration/{name}.png", cv2.imencode(".png", image)[1].tobytes())
    sizes = {"pixels_per_m_under": 1e3 * VIEWS.under, "graduation": ruler.graduation, "holder_pixels": VIEWS.holder}
    write_truth(folder, "calibration_images", {"tilt": tilts} | sizes)
    return [f"calibration/{name}.png" for name in images]
