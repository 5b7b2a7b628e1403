"""Image correlation: error against run time on a plain film of sprayed speckle, compared with peers.

The film shows discs that are drawn analytically and shifted; 8 bit, white noise in every frame. Every row states the
error against the known shift and the processor time of the whole call, measured in turn with the other rows in the
same process. Peers: OpenCV, the settings of the thesis's program DICe, and pyidi.
"""

import contextlib
import tempfile
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from importlib.util import find_spec
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.special import erf

from labpipe.arrays import Floats
from labpipe.imaging import track
from pipelines.bench.measure import Bound, Extra, Suite, race

Film = NDArray[np.uint8]

_TAPS = np.arange(-2, 4)  # of the kernel of Keys
_DEFAULT = "quintic, 121 points"


def run(quick: bool, subset: int = 31, noise: float = 2.0) -> list[Suite]:
    """Measure error and time of the settings and of the peers; quick: 121 points only, and fewer repeats.

    ``subset`` is in px, ``noise`` in grey levels, by default that of a good high-speed camera.
    """
    frames = 11 if quick else 20
    film, truth = make_film(512, frames, noise)
    bound = cramer_rao(film[0], subset, noise)
    has_pyidi = find_spec("pyidi") is not None
    calls: dict[str, tuple[str, Callable[[], object]]] = {}
    counts: dict[str, int] = {}
    for side in (11,) if quick else (11, 41):
        axis = np.rint(np.linspace(subset - 1, 512 - subset, side))
        points = np.stack([axis.ravel() for axis in np.meshgrid(axis, axis)], axis=1)
        few = points[::16]
        methods: list[tuple[str, str, Callable[..., Floats], Floats]] = [
            ("", "quintic", partial(_correlate, order=5, shape="auto"), points),
            ("", "bicubic", partial(_correlate, order=3, shape="auto"), points),
            ("", "quintic, affine", partial(_correlate, order=5, shape="affine"), points),
            ("OpenCV", "Lucas–Kanade", lucas_kanade, points),
            ("thesis", "settings of DICe (Keys, 4th order)", keys_correlation, few),
            *([("pyidi", "pyidi Lucas–Kanade", pyidi, points)] if has_pyidi else []),
        ]
        for group, name, method, given in methods:
            setting = f"{name}, {side**2} points"
            calls[setting], counts[setting] = (group, partial(method, film, given, subset)), len(given)

    def judge(_: str, found: Any) -> tuple[float, Extra]:
        error = np.asarray(found) - truth[:, None]
        rms = float(np.sqrt(np.nanmean(error[1:] ** 2)))
        return rms, {"error / bound": rms / bound, "lost (%)": 100.0 * float(np.isnan(error).mean())}

    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)  # as the kernels of the others have only one
    try:
        timed = race(calls, 3 if quick else 7, judge, _DEFAULT, budget=40.0)
    finally:
        cv2.setNumThreads(threads)
    return [
        Suite(
            "dic",
            f"Displacement of subsets of {subset} px, {frames} frames of 512 × 512 px of sprayed speckle, noise of "
            f"{noise:g} grey levels",
            "RMS error (px)",
            [replace(p, seconds=p.seconds / (frames * counts[p.setting])) for p in timed],
            [Bound(f"Cramér–Rao, {subset} px", bound)],
            [] if has_pyidi else ["pyidi is not installed; it is not compared."],
            time_label="run time per point and frame (s)",
        )
    ]


def make_film(size: int, frames: int, noise: float, step: tuple[float, float] = (0.1, 0.05)) -> tuple[Film, Floats]:
    """Make a film (frame, row, column) of shifted sprayed speckle and its shifts (frame, 2) in px.

    The ``step`` [px] from frame to frame is that of a falling holder early on. Dark discs of 1.2 to 2.6 px radius have
    edges that lens and pixel blur by 0.8 px (standard deviation).
    """
    rng = np.random.default_rng(3)
    count = size * size // 14
    centre, radius = rng.uniform(-10.0, size + 10.0, (2, count)), rng.uniform(1.2, 2.6, count)
    shifts = np.arange(frames)[:, None] * np.array(step)
    steps, margin = np.arange(-6, 7), 24
    images = []
    for shift in shifts:
        x, y = centre + shift[:, None]
        column, row = np.rint(x).astype(int)[:, None] + steps, np.rint(y).astype(int)[:, None] + steps
        distance = np.hypot((column - x[:, None])[:, None, :], (row - y[:, None])[:, :, None])
        share = 0.5 - 0.5 * erf((distance - radius[:, None, None]) / (0.8 * np.sqrt(2.0)))
        image = np.zeros((size + 2 * margin, size + 2 * margin))
        np.add.at(image, (row[:, :, None] + margin, column[:, None, :] + margin), share)
        grey = 60.0 + 150.0 * np.exp(-image[margin:-margin, margin:-margin]) + noise * rng.standard_normal((size, size))
        images.append(np.clip(np.rint(grey), 0, 255).astype(np.uint8))
    return np.stack(images), shifts


def cramer_rao(image: Film, subset: int, noise: float) -> float:
    """Bound (px) of a translation from two noisy images, mean slope of the image."""
    grey = image.astype(float)
    slopes = np.mean([((np.diff(grey, axis=k)) ** 2).mean() - 2 * noise**2 for k in (0, 1)])
    return float(np.sqrt(2 * (noise**2 + 1 / 12) / (slopes * subset**2)))


def _correlate(film: Film, points: Floats, subset: int, order: Any, shape: Any) -> Floats:
    """Displacements (frame, point, 2) in px by :func:`labpipe.imaging.track`."""
    found = track(film, points, subset, shape, order)
    return np.stack([found.dx.values, found.dy.values], axis=-1)


def lucas_kanade(film: Film, points: Floats, window: int) -> Floats:
    """Displacements (frame, point, 2) in px by OpenCV on one level, from the frame before."""
    start = points.astype(np.float32)[:, None]
    moved = start.copy()
    result = np.zeros((len(film), len(points), 2))
    for k in range(1, len(film)):
        options: dict[str, Any] = {"winSize": (window, window), "maxLevel": 0, "flags": cv2.OPTFLOW_USE_INITIAL_FLOW}
        flow, found, _ = cv2.calcOpticalFlowPyrLK(film[0], film[k], start, moved.copy(), **options)
        moved = np.asarray(flow, np.float32)
        result[k] = np.where(found > 0, (moved - start)[:, 0], np.nan)
    return result


def keys_correlation(film: Film, points: Floats, subset: int) -> Floats:
    """Displacements (frame, point, 2) in px with the interpolation of DICe's default.

    DICe (Sandia), which the thesis used, is no Python package: its published default is written out here in NumPy:
    zero-normalised least squares, slopes of the reference, interpolation by the fourth-order kernel of Keys. Its
    error is that of DICe; its run time is that of this emulation.

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
            for _ in range(20):
                g = _shifted(film[k], x, y, half, shift)
                g -= g.mean()
                g *= np.sqrt((f**2).sum() / (g**2).sum())
                step = inverse @ (slopes @ (f - g).ravel())
                shift = shift + step
                if np.hypot(*step) < 1e-4:
                    break
            result[k, n] = shift
    return result


def _shifted(image: Film, x: int, y: int, half: int, shift: Floats) -> Floats:
    """Grey levels of a subset between the pixels, by the kernel of Keys of the fourth order (six points)."""
    whole = np.floor(shift).astype(int)
    rows = np.arange(-half + _TAPS[0], half + _TAPS[-1] + 1) + y + whole[1]
    columns = np.arange(-half + _TAPS[0], half + _TAPS[-1] + 1) + x + whole[0]
    part = image[np.ix_(rows, columns)].astype(float)
    s = np.abs((shift - whole)[:, None] - _TAPS)
    near = (4 / 3 * s - 7 / 3) * s**2 + 1
    middle = ((-7 / 12 * s + 3) * s - 59 / 12) * s + 15 / 6
    far = ((s / 12 - 2 / 3) * s + 21 / 12) * s - 3 / 2
    weights_x, weights_y = np.where(s < 1, near, np.where(s < 2, middle, np.where(s < 3, far, 0.0)))
    size = 2 * half + 1
    along = sum(w * part[:, k : k + size] for k, w in enumerate(weights_x))
    return np.asarray(sum(w * along[k : k + size] for k, w in enumerate(weights_y)))


def pyidi(film: Film, points: Floats, subset: int) -> Floats:
    """Displacements (frame, point, 2) in px by pyidi's compiled Lucas–Kanade (translation)."""
    from pyidi import LucasKanade, VideoReader  # type: ignore[import-not-found]

    with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(None), contextlib.redirect_stderr(None):
        method = LucasKanade(VideoReader(film, root=folder))
        method.set_points(points[:, ::-1])
        method.configure(roi_size=(subset, subset), verbose=0, show_pbar=False)
        found = np.asarray(method.get_displacements(autosave=False))
    # (point, frame, (y, x))
    return found.transpose(1, 0, 2)[..., ::-1]
