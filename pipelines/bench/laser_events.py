"""Contacts, bounces and restitution from laser records, compared with level crossings.

The level is that of rest, as one would read it from a plot of the record, or the true one of
the first touch, which no measurement knows.
"""

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from labpipe import signals
from labpipe.arrays import Floats
from pipelines.bench.laser_truth import Record, record
from pipelines.bench.measure import THESIS, Extra, Suite, Timing, race

_MATERIALS = ("acrylic", "ptfe", "nylon", "peek")
_MATCH = 1.5e-3  # s within which a touch counts as the true one
_DURATION = 0.7  # s; acrylic is at rest then
_REST_SHARE = 0.02  # of the end of a record, whose mean is the rest level
_SHORTEST = 2e-3  # s from touch to touch: shorter flights are below the noise
_AVERAGE = 15  # samples of the moving average before levels are crossed
_DEFAULT = "any solid"
_HYSTERESIS = 3e-6  # m over the level that ends a contact: three times the noise


@dataclass(frozen=True, slots=True)
class Events:
    """Touch times (s) and restitutions of one record."""

    touch: Floats
    restitution: Floats


def run(quick: bool) -> list[Suite]:
    """Measure touch times and restitutions of every method on bouncing records.

    A quick run has one material, runs once, and traces the memory of the default alone.
    """
    names = _MATERIALS[:1] if quick else _MATERIALS
    made = [record(name, _DURATION) for name in names]
    contenders = _contenders(made)
    if quick:
        del contenders["noise given"]
    title = f"{', '.join(names)} dropped from 1.5 mm, 20 kHz, 1 µm noise"
    ratios: dict[str, Floats] = {}

    def judge(name: str, timings: Mapping[str, Timing]) -> tuple[float, Extra]:
        answers: Any = timings[name].value
        late, ratios[name], missed, false = _errors(answers, made)
        largest = float(np.abs(late).max(initial=0.0))
        return _rms(late), {"largest (s)": largest, "touches missed": missed, "touches invented": false}

    traced = (_DEFAULT,) if quick else contenders
    touches = race(contenders, 1 if quick else 7, judge, _DEFAULT, budget=25.0, per=len(made), traced=traced)
    restitutions = [
        replace(point, error=_rms(wrong), extra={"largest (1)": float(np.abs(wrong).max(initial=0.0))})
        for point, wrong in zip(touches, ratios.values(), strict=True)
    ]
    label = "run time of a record (s)"
    return [
        Suite("touch-times", f"Touch times: {title}", "RMS error (s)", touches, time_label=label),
        Suite("restitution", f"Restitution: {title}", "RMS error (1)", restitutions, time_label=label),
    ]


def _contenders(made: Sequence[Record]) -> dict[str, tuple[str, Callable[[], object]]]:
    """Name every method: group and call."""
    return {
        _DEFAULT: ("", lambda: [_bounces(m) for m in made]),
        "a polymer": ("", lambda: [_bounces(m, contact="polymer") for m in made]),
        "noise given": ("", lambda: [_bounces(m, noise=1e-6) for m in made]),
        "rest level crossed": (THESIS, lambda: [crossings(m, 1) for m in made]),
        f"rest level crossed, {_AVERAGE} samples averaged": (THESIS, lambda: [crossings(m, _AVERAGE) for m in made]),
        f"true level crossed, {_AVERAGE} samples averaged": (
            "known level",
            lambda: [crossings(m, _AVERAGE, m.level) for m in made],
        ),
    }


def _bounces(made: Record, **options: Any) -> Events:
    with warnings.catch_warnings(action="ignore", category=UserWarning):
        # a short record ends before rest, on purpose
        found = signals.bounces(made.displacement, **options)
    return Events(found["touch_time"].values, found["restitution"].values)


def crossings(made: Record, window: int, level: float | None = None) -> Events:
    """Find contacts where a level [m] is crossed, and speeds by differences there, in heights that grow upwards.

    ``window`` is that of a moving average in samples, 1 for none; the level is the mean of the record's end if none is
    given.
    """
    time, height = made.displacement.time.values, made.displacement.values
    smooth = np.convolve(height, np.ones(window) / window, "same")
    if level is None:
        level = float(height[-round(_REST_SHARE * len(height)) :].mean())
    above = smooth - level
    is_high, touch, ratio, incoming = True, [], [], np.nan
    speed = np.gradient(smooth, time)
    for k in range(window, len(above) - window):
        if is_high and above[k] <= 0:
            is_high, incoming = False, -speed[k - 1]
            share = above[k - 1] / (above[k - 1] - above[k])
            touch.append(time[k - 1] + share * (time[k] - time[k - 1]))
        elif not is_high and above[k] > _HYSTERESIS:
            is_high = True
            ratio.append(speed[k] / incoming if incoming > 0 else np.nan)
    return Events(np.array(touch), np.array(ratio))


def _errors(answers: Sequence[Events], made: Sequence[Record]) -> tuple[Floats, Floats, int, int]:
    """Compare with the truth: errors of touches (s) and restitutions, missed, invented."""
    late, wrong, missed, false = [], [], 0, 0
    for found, true in zip(answers, made, strict=True):
        matched = set()
        for place, touch in enumerate(found.touch):
            nearest = int(np.argmin(np.abs(true.touch - touch)))
            if abs(true.touch[nearest] - touch) > _MATCH or nearest in matched:
                false += 1
                continue
            matched.add(nearest)
            late.append(touch - true.touch[nearest])
            if place < len(found.restitution) and nearest < len(true.restitution):
                wrong.append(found.restitution[place] - true.restitution[nearest])
        resolvable = np.diff(true.touch, append=np.inf) > _SHORTEST
        missed += int(resolvable.sum() - sum(resolvable[k] for k in matched))
    return np.array(late), np.array(wrong), missed, false


def _rms(error: Floats) -> float:
    return float(np.sqrt(np.nanmean(error**2))) if error.size else float("nan")
