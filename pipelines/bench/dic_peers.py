"""Peers of image correlation: OpenCV, the thesis's program and pyidi.

The thesis used DICe (Sandia). It is no Python package, so its published default is stepped through
here with numpy: zero-normalised least squares, slopes of the reference, interpolation by the
fourth-order kernel of Keys. Its error is that of DICe; its run time is that of this emulation.
"""

import contextlib
import io
import tempfile
from collections.abc import Iterator
from importlib.util import find_spec

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Floats

Film = NDArray[np.uint8]
_ITERATIONS, _TOLERANCE = 20, 1e-4
_TAPS = np.arange(-2, 4)


def has_pyidi() -> bool:
    """Tell whether the optional peer is installed."""
    return find_spec("pyidi") is not None


def lucas_kanade(film: Film, points: Floats, window: int) -> Floats:
    """Displacements (frame, point, 2) in px by OpenCV on one level, from the frame before."""
    import cv2

    start = points.astype(np.float32)[:, None]
    moved = start.copy()
    result = np.zeros((len(film), len(points), 2))
    for k in range(1, len(film)):
        flow, found, _ = cv2.calcOpticalFlowPyrLK(
            film[0],
            film[k],
            start,
            moved.copy(),
            winSize=(window, window),
            maxLevel=0,
            flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
        )
        moved = np.asarray(flow, np.float32)
        result[k] = np.where(found > 0, (moved - start)[:, 0], np.nan)
    return result


def keys_correlation(film: Film, points: Floats, subset: int) -> Floats:
    """Displacements (frame, point, 2) in px with the interpolation of DICe's default.

    References
    ----------
    R. G. Keys, IEEE Trans. Acoust. Speech Signal Process. 29 (1981) 1153-1160,
    https://doi.org/10.1109/TASSP.1981.1163711;
    D. Z. Turner, DICe reference manual, SAND2015-10606 O (2015).
    """
    half = subset // 2
    offset = np.arange(-half, half + 1)
    result = np.zeros((len(film), len(points), 2))
    first = film[0].astype(float)
    # DICe takes its slopes from the reference with this five-point rule
    slope_y, slope_x = (
        (np.roll(first, 2, k) - 8 * np.roll(first, 1, k) + 8 * np.roll(first, -1, k) - np.roll(first, -2, k)) / 12.0
        for k in (0, 1)
    )
    for n, (x, y) in enumerate(np.rint(points).astype(int)):
        area = np.ix_(y + offset, x + offset)
        f = first[area] - first[area].mean()
        slopes = np.stack([slope_x[area].ravel(), slope_y[area].ravel()])
        slopes -= slopes.mean(axis=1, keepdims=True)
        inverse = np.linalg.inv(slopes @ slopes.T)
        shift = np.zeros(2)
        for k in range(1, len(film)):
            for _ in range(_ITERATIONS):
                g = _shifted(film[k], x, y, half, shift)
                g -= g.mean()
                g *= np.sqrt((f**2).sum() / (g**2).sum())
                step = inverse @ (slopes @ (f - g).ravel())
                shift = shift + step
                if np.hypot(*step) < _TOLERANCE:
                    break
            result[k, n] = shift
    return result


def _shifted(image: Film, x: int, y: int, half: int, shift: Floats) -> Floats:
    """Grey levels of a subset between the pixels."""
    whole = np.floor(shift).astype(int)
    rows = np.arange(-half + _TAPS[0], half + _TAPS[-1] + 1) + y + whole[1]
    columns = np.arange(-half + _TAPS[0], half + _TAPS[-1] + 1) + x + whole[0]
    part = image[np.ix_(rows, columns)].astype(float)
    weights_x, weights_y = (_keys(part_of - _TAPS) for part_of in shift - whole)
    size = 2 * half + 1
    along = sum(w * part[:, k : k + size] for k, w in enumerate(weights_x))
    return np.asarray(sum(w * along[k : k + size] for k, w in enumerate(weights_y)))


def _keys(distance: Floats) -> Floats:
    """Kernel of Keys of the fourth order (six points)."""
    s = np.abs(distance)
    near = (4 / 3 * s - 7 / 3) * s**2 + 1
    middle = ((-7 / 12 * s + 3) * s - 59 / 12) * s + 15 / 6
    far = ((s / 12 - 2 / 3) * s + 21 / 12) * s - 3 / 2
    return np.where(s < 1, near, np.where(s < 2, middle, np.where(s < 3, far, 0.0)))


def pyidi(film: Film, points: Floats, subset: int) -> Floats:
    """Displacements (frame, point, 2) in px by pyidi's compiled Lucas–Kanade (translation)."""
    from pyidi import LucasKanade, VideoReader  # type: ignore[import-not-found]

    with tempfile.TemporaryDirectory() as folder, _quiet():
        method = LucasKanade(VideoReader(film, root=folder))
        method.set_points(points[:, ::-1])
        method.configure(roi_size=(subset, subset), verbose=0, show_pbar=False)
        found = np.asarray(method.get_displacements(autosave=False))
    # (point, frame, (y, x))
    return found.transpose(1, 0, 2)[..., ::-1]


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Keep the peers' progress out of our output."""
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        yield
