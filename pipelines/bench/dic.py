"""Image correlation: error against run time on a plain film of sprayed speckle, compared with peers.

The film shows discs that are drawn analytically and shifted; 8 bit, white noise in every frame. Every row states the
error against the known shift and the processor time of the whole call, measured in turn with the other rows in the
same process.
"""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from functools import partial

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.special import erf

from labpipe.arrays import Floats
from labpipe.imaging import track
from pipelines.bench import dic_peers
from pipelines.bench.measure import Bound, Extra, Suite, Timing, race

Film = NDArray[np.uint8]

_NOISE = 2.0  # grey levels, as of a good high-speed camera
_STEP = (0.1, 0.05)  # px from frame to frame, that of a falling holder early on
_SUBSET = 31
_BORDER = 30  # px
_DEFAULT = "quintic, 121 points"
_LUCAS_KANADE = "Lucas–Kanade, 121 points"


def run(quick: bool) -> Suite:
    """Measure error and time of the settings and of the peers.

    Parameters
    ----------
    quick : bool
        121 points only, and fewer repeats.
    """
    frames = 11 if quick else 20
    film, truth = make_film(512, frames, _NOISE)
    calls: dict[str, tuple[str, Callable[[], Floats]]] = {}
    counts: dict[str, int] = {}
    for side in (11,) if quick else (11, 41):
        axis = np.rint(np.linspace(_BORDER, 511 - _BORDER, side))
        points = np.stack([axis.ravel() for axis in np.meshgrid(axis, axis)], axis=1)
        methods: list[tuple[str, str, Callable[[], Floats], int]] = [
            ("", "quintic", partial(_correlate, film, points, 5, "auto"), 1),
            ("", "bicubic", partial(_correlate, film, points, 3, "auto"), 1),
            ("", "quintic, affine", partial(_correlate, film, points, 5, "affine"), 1),
            ("OpenCV", "Lucas–Kanade", partial(dic_peers.lucas_kanade, film, points, _SUBSET), 1),
            (
                "thesis",
                "settings of DICe (Keys, 4th order)",
                partial(dic_peers.keys_correlation, film, points[::16], _SUBSET),
                16,
            ),
        ]
        if dic_peers.has_pyidi():
            methods.append(("pyidi", "pyidi Lucas–Kanade", partial(dic_peers.pyidi, film, points, _SUBSET), 1))
        for group, name, method, thinning in methods:
            setting = f"{name}, {side**2} points"
            calls[setting], counts[setting] = (group, method), len(points[::thinning])

    def judge(name: str, timings: Mapping[str, Timing]) -> tuple[float, Extra]:
        error = np.asarray(timings[name].value) - truth[:, None]
        ratio, low, high = timings[name].ratio(timings[_LUCAS_KANADE])
        share = counts[_LUCAS_KANADE] / counts[name]
        rms = float(np.sqrt(np.nanmean(error[1:] ** 2)))
        return rms, {
            "error / bound": rms / cramer_rao(film[0], _SUBSET),
            "time / Lucas–Kanade, per point": ratio * share,
            "lowest": low * share,
            "highest": high * share,
            "lost (%)": 100.0 * float(np.isnan(error).mean()),
        }

    with _one_thread():
        timed = race(calls, 3 if quick else 7, judge, _DEFAULT, budget=40.0, traced=(_DEFAULT,))
    return Suite(
        "dic",
        f"Displacement of subsets of {_SUBSET} px, {frames} frames of 512 × 512 px of sprayed speckle, noise of "
        f"{_NOISE:g} grey levels",
        "RMS error (px)",
        [replace(p, seconds=p.seconds / (frames * counts[p.setting])) for p in timed],
        [Bound(f"Cramér–Rao, {_SUBSET} px", cramer_rao(film[0], _SUBSET))],
        [] if dic_peers.has_pyidi() else ["pyidi is not installed; it is not compared."],
        time_label="run time per point and frame (s)",
    )


@contextmanager
def _one_thread() -> Iterator[None]:
    """Hold OpenCV to one thread, as the kernels of the others have only one."""
    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(before)


def make_film(size: int, frames: int, noise: float) -> tuple[Film, Floats]:
    """Film (frame, row, column) of shifted sprayed speckle and its shifts (frame, 2) in px.

    Dark discs of 1.2 to 2.6 px radius with edges that lens and pixel blur by 0.8 px (standard deviation).
    """
    rng = np.random.default_rng(3)
    count = size * size // 14
    centre, radius = rng.uniform(-10.0, size + 10.0, (2, count)), rng.uniform(1.2, 2.6, count)
    shifts = np.arange(frames)[:, None] * np.array(_STEP)
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


def cramer_rao(image: Film, subset: int) -> float:
    """Bound (px) of a translation from two noisy images, mean slope of the image."""
    grey = image.astype(float)
    slopes = np.mean([((np.diff(grey, axis=k)) ** 2).mean() - 2 * _NOISE**2 for k in (0, 1)])
    return float(np.sqrt(2 * (_NOISE**2 + 1 / 12) / (slopes * subset**2)))


def _correlate(film: Film, points: Floats, order: int, shape: str) -> Floats:
    """Displacements (frame, point, 2) in px by :func:`labpipe.imaging.track`."""
    found = track(film, points, _SUBSET, shape, order)  # type: ignore[arg-type]
    return np.stack([found.dx.values, found.dy.values], axis=-1)
