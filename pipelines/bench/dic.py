"""Image correlation: error against run time, beside OpenCV's pyramidal Lucas–Kanade.

The film is a random periodic pattern that is shifted exactly, by the phases of its Fourier
coefficients; 8 bit, white noise in every frame. Every row states the error against the known
shift and the time of the whole call, measured in turn with the other rows in the same process.
"""

import time
from collections.abc import Callable
from functools import partial
from itertools import product
from statistics import median

import numpy as np
from numpy.typing import NDArray

from labpipe.imaging import track

Floats = NDArray[np.float64]
Film = NDArray[np.uint8]
Method = Callable[[Film], Floats]

#: Noise of one frame (grey levels), as of a good high-speed camera.
_NOISE = 2.0
#: Width of the pattern's features (px): autocorrelation like that of a sprayed speckle.
_FEATURE = 1.9
_MEAN, _CONTRAST = 127.0, 40.0
#: Shift from frame to frame (px), that of a falling holder early on.
_STEP = (0.1, 0.05)
_BORDER = 26
#: Frames in which the pattern moves by one pixel.
_PIXEL = 11


def run(quick: bool) -> list[dict[str, object]]:
    """Measure error and time of every setting.

    Parameters
    ----------
    quick : bool
        A smaller film and fewer repeats, under a minute.

    Returns
    -------
    list of dict
        ``setting``, ``is_default``, ``error`` (RMS over points, frames and both directions, px),
        ``bias`` (largest mean error of a frame of the same film without noise, px),
        ``seconds`` (whole call per frame, median of the repeats), ``cpu_seconds`` (the same of
        processor time), ``ratio`` (of ``seconds`` to Lucas–Kanade with the same window),
        ``bound`` (Cramér–Rao, px).
    """
    size, frames, repeats = (320, 11, 3) if quick else (512, 41, 7)
    film, truth = make_film(size, frames, _NOISE)
    clean, exact = make_film(size, _PIXEL, 0.0)
    points = _grid(size)
    contenders: dict[str, tuple[int, Method]] = {}
    for subset in (31, 21):
        peer = partial(_lucas_kanade, points=points, window=subset)
        contenders[f"Lucas–Kanade, 3 levels, {subset} px"] = (subset, peer)
        for order, shape in product((5, 3), ("rigid", "affine")):
            name = f"{'quintic' if order == 5 else 'bicubic'}, {shape}, {subset} px"
            ours = partial(_correlate, points=points, subset=subset, order=order, shape=shape)
            contenders[name] = (subset, ours)
    errors = {name: call(film) - truth[:, None] for name, (_, call) in contenders.items()}
    biases = {name: call(clean) - exact[:, None] for name, (_, call) in contenders.items()}
    times: dict[str, list[tuple[float, float]]] = {name: [] for name in contenders}
    for _ in range(repeats):
        for name, (_, call) in contenders.items():
            times[name].append(_time(call, film))
    seconds = {name: median(wall for wall, _ in taken) / frames for name, taken in times.items()}
    rows = []
    for name, (subset, _) in contenders.items():
        reference = seconds[f"Lucas–Kanade, 3 levels, {subset} px"]
        rows.append(
            {
                "setting": name,
                "is_default": name == "quintic, rigid, 31 px",
                "error": float(np.sqrt(np.nanmean(errors[name][1:] ** 2))),
                "bias": float(np.abs(np.nanmean(biases[name], axis=1)).max()),
                "seconds": seconds[name],
                "cpu_seconds": median(cpu for _, cpu in times[name]) / frames,
                "ratio": seconds[name] / reference,
                "bound": _bound(film[0], subset),
            }
        )
    return rows


def make_film(size: int, frames: int, noise: float) -> tuple[Film, Floats]:
    """Film (frame, row, column) of a shifted pattern and its shifts (frame, 2) in px."""
    rng = np.random.default_rng(1)
    frequency_y = np.fft.fftfreq(size)[:, None]
    frequency_x = np.fft.rfftfreq(size)[None, :]
    envelope = np.exp(-0.5 * (2 * np.pi * _FEATURE) ** 2 * (frequency_x**2 + frequency_y**2))
    pattern = np.fft.rfft2(rng.standard_normal((size, size))) * envelope
    pattern[0, 0] = 0.0
    # The highest frequency of an even grid has no phase; the envelope has removed it anyway.
    pattern *= _CONTRAST / np.fft.irfft2(pattern, (size, size)).std()
    shifts = np.arange(frames)[:, None] * np.array(_STEP)
    film = np.empty((frames, size, size), np.uint8)
    for k, (dx, dy) in enumerate(shifts):
        phase = np.exp(-2j * np.pi * (frequency_x * dx + frequency_y * dy))
        grey = _MEAN + np.fft.irfft2(pattern * phase, (size, size))
        grey += noise * rng.standard_normal((size, size))
        film[k] = np.clip(np.rint(grey), 0, 255)
    return film, shifts


def _grid(size: int) -> Floats:
    """Points (point, 2) every 14 px, the usual spacing."""
    axis = np.arange(_BORDER, size - _BORDER, 14.0)
    x, y = np.meshgrid(axis, axis)
    return np.stack([x.ravel(), y.ravel()], axis=1)


def _correlate(film: Film, points: Floats, subset: int, order: int, shape: str) -> Floats:
    """Displacements (frame, point, 2) in px by :func:`labpipe.imaging.track`."""
    found = track(film, points, subset, shape, order)  # type: ignore[arg-type]
    return np.stack([found.dx.values, found.dy.values], axis=-1)


def _lucas_kanade(film: Film, points: Floats, window: int) -> Floats:
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


def _time(method: Method, film: Film) -> tuple[float, float]:
    """Wall and processor seconds of a call."""
    wall, cpu = time.perf_counter(), time.process_time()
    method(film)
    return time.perf_counter() - wall, time.process_time() - cpu


def _bound(image: Film, subset: int) -> float:
    """Cramér–Rao bound (px) of a translation from two noisy images, mean slope of the image."""
    grey = image.astype(float)
    slopes = np.mean([((np.diff(grey, axis=k)) ** 2).mean() - 2 * _NOISE**2 for k in (0, 1)])
    return float(np.sqrt(2 * (_NOISE**2 + 1 / 12) / (slopes * subset**2)))
