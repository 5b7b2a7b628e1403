"""A sphere that falls and bounces: error against run time of three solvers, and of Ting's equations in SciPy.

Truth: Ting's integral for the first impact of a polymer of eleven terms (ten digits), and a train
of 34 bounces of one of fifteen terms by springs at a hundred times finer steps than the default.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from math import inf, isnan, nan, sqrt
from statistics import median
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from labpipe import contact
from labpipe.materials import Prony
from pipelines.bench import impact_peer
from pipelines.bench.measure import OURS, THESIS, Extra, Point, Suite, Timing, race

_RADIUS, _MASS, _HEIGHT, _GRAVITY = 9.525e-3, 0.505, 1.5e-3, 9.81
_FALL = sqrt(2.0 * _HEIGHT / _GRAVITY)
_TAU = np.logspace(-10, 2, 15)
_SHARE = (1 / 2e9 - 1 / 6e9) / 15
#: Ting's integral for the first impact of the polymer without its four fastest terms.
_FIRST = {
    "restitution": 0.938881646,
    "peak_force": 259.5168018,
    "peak_approach": 7.243709307e-5,
    "contact_duration": 1.2344948e-3,
}
#: Some bounces of the train: number: touch since the first (s), restitution, largest force (N).
_TRAIN = {
    0: (nan, 0.938866, 259.514693),
    1: (0.034046427, 0.938783, 240.709239),
    2: (0.066052398, 0.938675, 223.234283),
    3: (0.096140314, 0.938567, 207.004401),
    31: (0.484611580, 0.90733, 22.415490),
}
_BOUNCES = 34

Error = Callable[[Any], float]


class _Setting(NamedTuple):
    """What one point does."""

    name: str
    group: str
    options: Mapping[str, Any]
    is_default: bool = False


def run(quick: bool) -> list[Suite]:
    """Measure the first impact and the train of bounces."""
    return [_first_impact(quick), _train(quick)]


def _first_impact(quick: bool) -> Suite:
    settings = [*_ours((1e-3, 1e-4, 1e-5, 1e-6) if quick else (1e-2, 1e-3, 1e-4, 1e-5, 1e-6))]
    steps = (2e-4, 2e-5, 4e-6) if quick else (2e-4, 5e-5, 2e-5, 8e-6, 4e-6, 2e-6, 1e-6)
    settings += [_thesis(step) for step in steps]
    solid = Prony.from_creep(2e9, np.full(11, _SHARE), _TAU[4:], nu=0.35)
    peers = {
        f"{impact_peer.NAME}, rtol {rtol:.0e}": (
            impact_peer.NAME,
            partial(impact_peer.first_impact, solid, _RADIUS, _MASS, _HEIGHT, _GRAVITY, rtol),
        )
        for rtol in ((1e-6, 1e-10) if quick else (1e-4, 1e-6, 1e-8, 1e-10))
    }
    points, note = _measure(settings, solid, 2e-3, _first_error, 3 if quick else 7, peers)
    title = "First impact of an acrylic-like sphere, 1.5 mm: against Ting's integral"
    error = "worst relative error of restitution, force, approach, duration (1)"
    return Suite("drop-first", title, error, points, notes=[note])


def _train(quick: bool) -> Suite:
    duration = 0.5
    settings = [*_ours((1e-3, 1e-4) if quick else (1e-2, 1e-3, 1e-4, 1e-5))]
    steps = (2e-4,) if quick else (2e-4, 1e-4, 5e-5)
    settings += [_thesis(step) for step in steps]
    solid = Prony.from_creep(2e9, np.full(15, _SHARE), _TAU, nu=0.35)
    points, note = _measure(settings, solid, duration, _train_error, 1 if quick else 3)
    return Suite(
        "drop-train",
        "34 bounces in 0.5 s of an acrylic-like sphere, 15 terms from 1e-10 to 1e2 s",
        "worst relative error of touch times, forces, restitutions (1)",
        points,
        notes=[note, "A wrong number of bounces counts as an error of 1."],
    )


def _ours(tolerances: Sequence[float]) -> list[_Setting]:
    named = [(solver, name, rtol) for solver, name in (("mdr", "springs"), ("rings", "rings")) for rtol in tolerances]
    return [
        _Setting(f"{n}, rtol {r:.0e}", OURS, {"solver": s, "rtol": r}, is_default=s == "mdr" and r == 1e-4)
        for s, n, r in named
    ]


def _thesis(step: float) -> _Setting:
    return _Setting(f"thesis's scheme, step {step:.0e} s", THESIS, {"solver": "thesis", "time_step": step})


def _measure(
    settings: Sequence[_Setting],
    solid: Prony,
    after: float,
    error: Error,
    repeats: int,
    peers: Mapping[str, tuple[str, Callable[[], object]]] = MappingProxyType({}),
) -> tuple[list[Point], str]:
    """Time all settings and peers in turn; the note compares with the thesis's scheme at equal error."""

    def call(options: Mapping[str, Any]) -> Callable[[], object]:
        return lambda: contact.drop(solid, _RADIUS, _MASS, _HEIGHT, _FALL + after, **options)

    def judge(name: str, timings: Mapping[str, Timing]) -> tuple[float, Extra]:
        found: Any = timings[name].value
        return error(found), {"bounces": int(found.sizes["impact"])}

    default = next(s.name for s in settings if s.is_default)
    calls = {s.name: (s.group, call(s.options)) for s in settings} | dict(peers)
    points = race(calls, repeats, judge, default, budget=60.0)
    return points, speed_up(points)


def speed_up(points: Sequence[Point]) -> str:
    """Say how much faster the cheapest setting is that errs no more than the thesis's best."""
    theirs = [p for p in points if p.group == THESIS and not isnan(p.error)]
    best = min(theirs, key=lambda p: p.error)
    ours = [p for p in points if p.group == OURS and p.error <= best.error]
    if not ours:
        return f"No setting of ours errs as little as {best.setting} ({best.error:.1e})."
    fast = min(ours, key=lambda p: p.seconds)
    ratio = median(a / b for a, b in zip(best.samples, fast.samples, strict=True))
    return (
        f"{best.setting} errs by {best.error:.1e}; {fast.setting} errs by {fast.error:.1e} in a "
        f"{ratio:,.1f}th of its time."
    )


def _first_error(found: Any) -> float:
    if not found.sizes["impact"]:
        return 1.0
    return max(abs(float(found[name][0]) / exact - 1.0) for name, exact in _FIRST.items())


def _train_error(found: Any) -> float:
    if found.sizes["impact"] != _BOUNCES:
        return 1.0
    touch = found.impact_time.values - found.impact_time.values[0]
    worst = -inf
    for n, (time, restitution, force) in _TRAIN.items():
        errors = [abs(float(found.restitution[n]) - restitution), abs(float(found.peak_force[n]) / force - 1.0)]
        errors += [] if isnan(time) else [abs(touch[n] / time - 1.0)]
        worst = max(worst, *errors)
    return worst
