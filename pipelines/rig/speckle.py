"""A speckled holder as the front camera sees it, every pixel from a formula.

Round blobs at random places are summed and sent through a saturating curve. Motion moves the
blobs themselves, and defocus widens them, so nothing is ever interpolated: the analysis, which
interpolates, meets images that know nothing of its method.
"""

import math
from dataclasses import dataclass

import numpy as np

from labpipe.arrays import Floats
from labpipe.compilation import compiled

_REACH = 5.5  # blob widths after which exp(-r²/2) is below 3e-7


@dataclass(frozen=True, slots=True)
class Holder:
    """Where the blobs are, in px of the first image; ``left``, ``right`` bound the holder, with edges ``edge`` px soft.

    Grey levels saturate at ``black`` and ``white``.
    """

    x: Floats
    y: Floats
    width: Floats
    offset: float
    gain: float
    left: float
    right: float
    black: float = 40.0
    white: float = 215.0
    edge: float = 1.2


@dataclass(frozen=True, slots=True)
class Pose:
    """Shift in px and rotation in rad (clockwise on the screen) about ``pivot``."""

    dx: float = 0.0
    dy: float = 0.0
    rotation: float = 0.0
    pivot: tuple[float, float] = (0.0, 0.0)

    def distance(self, other: "Pose") -> float:
        """Return how far [px] points at the ends of an image move from one pose to the other, about."""
        return abs(self.dx - other.dx) + abs(self.dy - other.dy) + 500.0 * abs(self.rotation - other.rotation)

    def moved(self, x: Floats, y: Floats) -> tuple[Floats, Floats]:
        """Where points of the first image are now."""
        c, s = math.cos(self.rotation), math.sin(self.rotation)
        u, v = x - self.pivot[0], y - self.pivot[1]
        return self.pivot[0] + self.dx + c * u - s * v, self.pivot[1] + self.dy + s * u + c * v


def make_holder(
    rows: int,
    columns: int,
    fall: float,
    seed: int,
    width: float | None = None,
    *,
    sizes: tuple[float, float] = (1.3, 2.2),
    spacing: float = 1.25,
    contrast: float = 0.78,
) -> Holder:
    """Scatter blobs over the image and everything that a downward motion of ``fall`` px at most brings into it.

    The holder is ``width`` px wide and centred in the image; it fills the image by default. Blobs have widths between
    two ``sizes`` [px], by default usual ones for correlation; ``spacing`` is their mean distance over the sum of both,
    ``contrast`` the argument of the saturating curve per standard deviation of their sum.
    """
    generator = np.random.default_rng(seed)
    margin = 16.0
    area = (rows + fall + 2 * margin) * (columns + 2 * margin)
    count = int(area / (spacing * sum(sizes)) ** 2)
    x = generator.uniform(-margin, columns + margin, count)
    y = generator.uniform(-fall - margin, rows + margin, count)
    blobs = generator.uniform(*sizes, count)
    field = np.zeros((min(rows, 200), min(columns, 200)))
    _add_blobs(field, x, y, blobs, np.ones(count))
    half = 0.5 * columns + 2 * margin if width is None else 0.5 * width
    middle = 0.5 * (columns - 1)
    return Holder(x, y, blobs, float(field.mean()), contrast / float(field.std()), middle - half, middle + half)


def draw(holder: Holder, rows: int, columns: int, pose: Pose, defocus: float = 0.0) -> Floats:
    """Return grey levels (row, column) of the holder in a pose.

    Defocus [px] is the standard deviation of a Gaussian blur; it widens the blobs and weakens them as the same light
    spreads.
    """
    x, y = pose.moved(holder.x, holder.y)
    widened = np.hypot(holder.width, defocus)
    field = np.zeros((rows, columns))
    _add_blobs(field, x, y, widened, (holder.width / widened) ** 2)
    level = 0.5 * (1.0 + np.tanh(holder.gain * (field - holder.offset)))
    grey = holder.black + (holder.white - holder.black) * level
    across = np.arange(columns) - pose.dx
    mask = 0.5 * (np.tanh((across - holder.left) / holder.edge) - np.tanh((across - holder.right) / holder.edge))
    return holder.black / 2 + mask * (grey - holder.black / 2)


@compiled(error_model="numpy", no_cfunc_wrapper=True)
def _add_blobs(field: Floats, x: Floats, y: Floats, width: Floats, weight: Floats) -> None:
    """Add round Gaussians; one is the product of a row and a column, so exp is rarely needed."""
    rows, columns = field.shape
    across = np.empty(columns)
    for k in range(len(x)):
        reach = _REACH * width[k]
        left, right = max(0, math.ceil(x[k] - reach)), min(columns - 1, math.floor(x[k] + reach))
        top, bottom = max(0, math.ceil(y[k] - reach)), min(rows - 1, math.floor(y[k] + reach))
        scale = -0.5 / width[k] ** 2
        for j in range(left, right + 1):
            across[j] = math.exp(scale * (j - x[k]) ** 2)
        for i in range(top, bottom + 1):
            down = weight[k] * math.exp(scale * (i - y[k]) ** 2)
            for j in range(left, right + 1):
                field[i, j] += down * across[j]
