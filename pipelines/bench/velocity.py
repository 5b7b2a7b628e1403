"""Velocity from displacement: error against run time, compared with the thesis's moving average."""

from collections.abc import Callable, Mapping

import numpy as np
import xarray as xr

from labpipe import signals
from labpipe.arrays import Floats
from pipelines.bench.laser_truth import Record, record
from pipelines.bench.measure import THESIS, Calls, Extra, Suite, Timing, race

_DEFAULT = "spline"
_WINDOWS = (7, 15, 31, 61)
_NEAR = 1e-3  # s around a touch or lift-off that counts as contact


def run(quick: bool) -> Suite:
    """Measure every method on one bouncing record (acrylic, 1.5 mm, 20 kHz, 1 µm noise)."""
    made = record("acrylic", 0.2 if quick else 0.5)
    contenders = _contenders(made.displacement, made, quick)

    def judge(name: str, timings: Mapping[str, Timing]) -> tuple[float, Extra]:
        found = np.asarray(timings[name].value, float)
        contact, flight = _parts(found, made)
        return _rms(found - made.velocity), {
            "near contacts (m/s)": contact,
            "in flight (m/s)": flight,
            "largest (m/s)": float(np.nanmax(np.abs(found - made.velocity))),
            "time / thesis, median": timings[name].ratio(timings["moving average, default"])[0],
        }

    traced = (_DEFAULT,) if quick else contenders
    points = race(contenders, 3 if quick else 9, judge, _DEFAULT, budget=20.0, traced=traced)
    samples = len(made.velocity)
    title = f"Velocity of a bouncing sphere, {samples} samples at 20 kHz, 1 µm noise, 0.1 µm steps"
    return Suite("velocity", title, "RMS error (m/s)", points, notes=_notes())


def _contenders(displacement: xr.DataArray, made: Record, quick: bool) -> Calls:
    """Name every method: group and call."""
    breaks = np.sort(np.concatenate([made.touch, made.liftoff]))
    found: dict[str, tuple[str, Callable[[], object]]] = {
        _DEFAULT: ("", lambda: signals.velocity(displacement)),
        "spline, contacts given": ("", lambda: signals.velocity(displacement, breaks=breaks)),
        "spline, noise given": ("", lambda: signals.velocity(displacement, noise=1e-6)),
        "moving average, default": (THESIS, lambda: signals.velocity(displacement, "thesis")),
        "central differences": (THESIS, lambda: signals.velocity(displacement, "difference")),
    }
    for window in _WINDOWS:
        found[f"moving average, {window} samples"] = (THESIS, _averaged(displacement, window))
        found[f"Savitzky–Golay, cubic, {window} samples"] = (
            "SciPy Savitzky–Golay",
            _savitzky_golay(displacement, window),
        )
    if not quick:  # it takes seconds
        found["cross-validated"] = ("SciPy smoothing spline", _gcv(displacement))
    return found


def _averaged(displacement: xr.DataArray, window: int) -> Callable[[], object]:
    return lambda: signals.velocity(displacement, "thesis", window=window)


def _savitzky_golay(displacement: xr.DataArray, window: int) -> Callable[[], object]:
    from scipy.signal import savgol_filter

    step = float(displacement.time[1] - displacement.time[0])
    return lambda: savgol_filter(displacement.values, window, 3, deriv=1, delta=step)


def _gcv(displacement: xr.DataArray) -> Callable[[], object]:
    from scipy.interpolate import make_smoothing_spline

    time, values = displacement.time.values, displacement.values
    # the fit is badly scaled in seconds and metres; samples and micrometres it can bear
    step = float(time[1] - time[0])
    place = np.arange(len(time), dtype=float)

    def call() -> Floats:
        return np.asarray(make_smoothing_spline(place, values * 1e6)(place, 1) * 1e-6 / step)

    return call


def _parts(found: Floats, made: Record) -> tuple[float, float]:
    """RMS error near contacts and away from them, in m/s."""
    time = made.displacement.time.values
    events = np.concatenate([made.touch, made.liftoff])
    near = (np.abs(time[:, None] - events[None, :]) < _NEAR).any(axis=1)
    error = found - made.velocity
    return _rms(error[near]), _rms(error[~near])


def _rms(error: Floats) -> float:
    return float(np.sqrt(np.nanmean(error**2)))


def _notes() -> list[str]:
    """Say what was not compared."""
    from importlib.util import find_spec

    if find_spec("pynumdiff") is None:
        return ["PyNumDiff is not installed; it is not compared."]
    return ["PyNumDiff is installed but searches its settings for minutes; it is not compared."]
