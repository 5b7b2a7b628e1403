"""The images from which a camera is calibrated (appendix D): a ruler, and the holder's edges.

Lines and edges are blurred boxes and steps, evaluated in closed form at every pixel.
"""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.special import erf

from labpipe import files
from labpipe.arrays import Floats
from pipelines.rig.session_text import write_truth

UNDER_SCALE = 461e3  # px per m, table D.1, under the disc
HOLDER_PIXELS = 386.0  # table D.1: 30 mm of the holder in the front view
_GRADUATION = 1e-4  # m between lines
_LINE = 1e-5  # m, width of a line
_BLUR, _NOISE = 1.4, 2.0  # px, grey levels
_LIGHT, _INK = 190.0, 60.0


def ruler_image(rows: int, columns: int, tilt: float, seed: int, scale: float = UNDER_SCALE) -> NDArray[np.uint8]:
    """Draw a glass ruler with a line every 0.1 mm, tilted [rad] against the image axis; ``scale`` is in px/m."""
    across = _across(rows, columns, tilt)
    pitch, half = scale * _GRADUATION, 0.5 * scale * _LINE
    phase = np.mod(across + 0.5 * pitch, pitch) - 0.5 * pitch
    ink = _step(phase + half) - _step(phase - half)
    return _photograph(_LIGHT - (_LIGHT - _INK) * ink, seed)


def holder_image(rows: int, columns: int, tilt: float, seed: int, width: float = HOLDER_PIXELS) -> NDArray[np.uint8]:
    """Draw the bright holder, ``width`` px wide, before a dark ground."""
    across = _across(rows, columns, tilt)
    inside = _step(across + 0.5 * width) - _step(across - 0.5 * width)
    return _photograph(_INK + (_LIGHT - _INK) * inside, seed)


def write_calibration_images(folder: Path, seed: int = 71) -> list[str]:
    """Write both images as PNG and their truth; returns the names of the images."""
    tilts = {"ruler_under": 0.012, "holder_front": -0.006}
    images = {
        "ruler_under": ruler_image(240, 1280, tilts["ruler_under"], seed),
        "holder_front": holder_image(240, 640, tilts["holder_front"], seed + 1),
    }
    for name, image in images.items():
        files.write_bytes(folder / f"calibration/{name}.png", cv2.imencode(".png", image)[1].tobytes())
    sizes = {"pixels_per_m_under": UNDER_SCALE, "graduation": _GRADUATION, "holder_pixels": HOLDER_PIXELS}
    write_truth(folder, "calibration_images", {"tilt": tilts} | sizes)
    return [f"calibration/{name}.png" for name in images]


def _across(rows: int, columns: int, tilt: float) -> Floats:
    """Distance of every pixel from the middle line, at right angles to the lines."""
    x = np.arange(columns) - 0.5 * (columns - 1)
    y = np.arange(rows)[:, None] - 0.5 * (rows - 1)
    return np.asarray(x * np.cos(tilt) + y * np.sin(tilt))


def _step(distance: Floats) -> Floats:
    return np.asarray(0.5 * (1 + erf(distance / (np.sqrt(2) * _BLUR))))


def _photograph(grey: Floats, seed: int) -> NDArray[np.uint8]:
    noise = _NOISE * np.random.default_rng(seed).standard_normal(grey.shape)
    return np.clip(np.rint(grey + noise), 0, 255).astype(np.uint8)
