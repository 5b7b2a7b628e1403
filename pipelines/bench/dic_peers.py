"""Peers of image correlation: OpenCV, the thesis's program, pyidi and pyvale.

The thesis used DICe (Sandia). It is no Python package, so its published default is stepped through
here with numpy: zero-normalised least squares, slopes of the reference, interpolation by the
fourth-order kernel of Keys. Its error is that of DICe; its run time is that of this emulation
(DICe itself took about 1 ms per point and frame in the tests that this project started from).
"""

import contextlib
import io
import tempfile
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Floats

Film = NDArray[np.uint8]
Peer = tuple[str, Callable[..., Floats], int]

_ITERATIONS, _TOLERANCE = 20, 1e-4
_TAPS = np.arange(-2, 4)
#: Largest displacement (px) that pyvale is asked to search.
_REACH = 16


def installed() -> list[Peer]:
    """Return the optional peers that are there: name, method, thinning of the points."""
    found: list[Peer] = []
    if find_spec("pyidi") is not None:
        found.append(("pyidi Lucas–Kanade", pyidi, 1))
    if find_spec("pyvale") is not None:
        found.append(("pyvale", pyvale, 1))
    return found


def notes() -> list[str]:
    """Name the peers that are missing."""
    text = "{0} is not installed; it is not compared."
    return [text.format(name) for name in ("pyidi", "pyvale") if find_spec(name) is None]


def lucas_kanade(film: Film, points: Floats, window: int) -> Floats:
    """Displacements (frame, point, 2) in px by OpenCV, each frame against the first."""
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
            maxLevel=2,
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


def pyvale(film: Film, points: Floats, subset: int) -> Floats:
    """Displacements (frame, point, 2) in px by pyvale (affine, bicubic, its own blur).

    It lays a grid of its own over the area of the points, at their spacing.
    """
    import pandas as pd
    from pyvale import dic  # type: ignore[import-not-found]

    spacing = round(float(np.diff(np.unique(points[:, 0])).min()))
    low, high = points.min(axis=0).astype(int), points.max(axis=0).astype(int)
    mask = np.zeros(film.shape[1:], bool)
    half = subset // 2
    mask[low[1] - half : high[1] + half + 1, low[0] - half : high[0] + half + 1] = True
    seed = points[len(points) // 2].astype(int).tolist()
    with tempfile.TemporaryDirectory() as folder, _quiet():
        dic.calculate_2d(
            film[0],
            film,
            mask,
            seed,
            subset_size=subset,
            subset_step=spacing,
            num_threads=1,
            max_displacement=_REACH,
            output_basepath=folder,
            output_below_threshold=True,
            print_level=0,
        )
        tables = [pd.read_csv(path) for path in sorted(Path(folder).glob("dic_results_*.csv"))]
    return np.stack([table[["disp_u", "disp_v"]].to_numpy() for table in tables])


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Keep the peers' progress out of our output."""
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        yield
