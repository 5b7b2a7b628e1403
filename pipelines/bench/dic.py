"""Image correlation: error against run time, compared with the thesis's program and peers.

The film is a random periodic pattern that is shifted exactly, by the phases of its Fourier
coefficients; 8 bit, white noise in every frame. Every row states the error against the known
shift and the time of the whole call, measured in turn with the other rows in the same process.
"""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from itertools import product

import cv2
import numpy as np

from labpipe.arrays import Floats
from labpipe.imaging import track
from pipelines.bench import dic_peers
from pipelines.bench.dic_scenes import disturbances
from pipelines.bench.film_scenes import Film, View, digitised, from_spectrum, random_field
from pipelines.bench.measure import Bound, Extra, Suite, Timing, race

Method = Callable[[Film, Floats], Floats]

#: Noise of one frame (grey levels), as of a good high-speed camera.
_NOISE = 2.0
#: Width of the pattern's features (px): autocorrelation like that of a sprayed speckle.
_FEATURE = 1.9
_CONTRAST = 40.0
#: Shift from frame to frame (px), that of a falling holder early on.
_STEP = (0.1, 0.05)
_BORDER = 26
_SPACING = 14
#: Frames in which the pattern moves by one pixel.
_PIXEL = 11
_DEFAULT = "quintic, rigid, 31 px"


@dataclass(frozen=True, slots=True)
class Contender:
    """One method with its window; dear ones get every ``thinning``-th point only."""

    group: str
    subset: int
    method: Method
    thinning: int = 1


def run(quick: bool) -> list[Suite]:
    """Measure error and time of every setting, and of the default in scenes of other making.

    Parameters
    ----------
    quick : bool
        A smaller film and fewer repeats; only the default's memory is traced.
    """
    return [_settings(quick), disturbances(quick)]


def _settings(quick: bool) -> Suite:
    size, frames, repeats = (320, _PIXEL, 3) if quick else (512, 41, 7)
    film, truth = make_film(size, frames, _NOISE)
    clean, exact = make_film(size, _PIXEL, 0.0)
    contenders = _contenders(quick)
    points = {name: _grid(size)[:: c.thinning] for name, c in contenders.items()}
    calls = {name: (c.group, partial(c.method, film, points[name])) for name, c in contenders.items()}

    def judge(name: str, timings: Mapping[str, Timing]) -> tuple[float, Extra]:
        contender, timing = contenders[name], timings[name]
        window = contender.subset
        error = np.asarray(timing.value) - truth[:, None]
        bias = contender.method(clean, points[name]) - exact[:, None]
        mine = error.shape[1]
        reference = timings[f"3 levels, {window} px"]
        ratio, low, high = timing.ratio(reference)
        share = len(points[f"3 levels, {window} px"]) / mine
        rms = float(np.sqrt(np.nanmean(error[1:] ** 2)))
        return rms, {
            "bias (px)": float(np.abs(np.nanmean(bias, axis=1)).max()),
            "error / bound": rms / cramer_rao(film[0], window),
            "time / Lucas–Kanade": ratio * share,
            "lowest": low * share,
            "highest": high * share,
            "lost (%)": 100.0 * float(np.isnan(error).mean()),
        }

    with _one_thread():
        timed = race(calls, repeats, judge, _DEFAULT, budget=40.0, traced=(_DEFAULT,) if quick else calls)
    rows = [replace(p, seconds=p.seconds / (frames * len(points[p.setting]))) for p in timed]
    return Suite(
        "dic",
        f"Displacement of subsets, {frames} frames of {size} × {size} px, noise of "
        f"{_NOISE:g} grey levels; the bias is that of a film without noise",
        "RMS error (px)",
        rows,
        [Bound(f"Cramér–Rao, {w} px", cramer_rao(film[0], w)) for w in (21, 31)],
        dic_peers.notes(),
        time_label="run time per point and frame (s)",
    )


def _contenders(quick: bool) -> dict[str, Contender]:
    found: dict[str, Contender] = {}
    for subset in (31, 21):
        peer = partial(dic_peers.lucas_kanade, window=subset)
        found[f"3 levels, {subset} px"] = Contender("OpenCV Lucas–Kanade", subset, peer)
        for order, shape in product((5, 3), ("rigid", "affine")):
            name = f"{'quintic' if order == 5 else 'bicubic'}, {shape}, {subset} px"
            ours = partial(_correlate, subset=subset, order=order, shape=shape)
            found[name] = Contender("", subset, ours)
        if not quick:
            blurred = partial(_correlate, subset=subset, order=5, shape="rigid", blur=0.0)
            found[f"quintic, rigid, {subset} px, not blurred"] = Contender("", subset, blurred)
        keys = partial(dic_peers.keys_correlation, subset=subset)
        found[f"settings of DICe (Keys, 4th order), {subset} px"] = Contender("thesis", subset, keys, thinning=16)
        for group, method, thinning in dic_peers.installed():
            found[f"{group}, {subset} px"] = Contender(group, subset, partial(method, subset=subset), thinning)
    return found


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
    """Film (frame, row, column) of a shifted pattern and its shifts (frame, 2) in px."""
    pattern = random_field(size, _FEATURE, 1)
    pattern *= _CONTRAST / pattern.std()
    shifts = np.arange(frames)[:, None] * np.array(_STEP)
    return digitised([from_spectrum(pattern, View((x, y))) for x, y in shifts], noise, 2), shifts


def cramer_rao(image: Film, subset: int) -> float:
    """Bound (px) of a translation from two noisy images, mean slope of the image."""
    grey = image.astype(float)
    slopes = np.mean([((np.diff(grey, axis=k)) ** 2).mean() - 2 * _NOISE**2 for k in (0, 1)])
    return float(np.sqrt(2 * (_NOISE**2 + 1 / 12) / (slopes * subset**2)))


def _grid(size: int) -> Floats:
    """Points (point, 2) at the usual spacing."""
    axis = np.arange(_BORDER, size - _BORDER, float(_SPACING))
    x, y = np.meshgrid(axis, axis)
    return np.stack([x.ravel(), y.ravel()], axis=1)


def _correlate(film: Film, points: Floats, subset: int, order: int, shape: str, blur: float = 0.5) -> Floats:
    """Displacements (frame, point, 2) in px by :func:`labpipe.imaging.track`."""
    found = track(film, points, subset, shape, order, blur=blur)  # type: ignore[arg-type]
    return np.stack([found.dx.values, found.dy.values], axis=-1)
