"""Time–temperature superposition: error of the shifts against run time, on known materials."""

import time
import warnings
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, cast

import numpy as np
from threadpoolctl import threadpool_limits

from labpipe.materials import MasterCurve, master_curve
from pipelines.bench import rheology_peers
from pipelines.bench.measure import Extra, Point, Suite, Timing, paired, race
from pipelines.bench.rheology_scenes import scenes
from pipelines.bench.rheology_truth import FRACTIONAL, GLASS, MAXWELL, SINGLE_TIMES, Measured, Truth, measured

_FIRST_SEED = 700
_QUICK_SEEDS = 2
_LONGEST = 20.0  # processor time (s) that a peer may take on the records of one scene
_DEFAULT = "free shifts"
_OTHER_DATA: tuple[tuple[str, dict[str, Any]], ...] = (
    ("6 temperatures", {"temperatures": 6}),
    ("17 temperatures", {"temperatures": 17}),
    ("4 points a sweep", {"points": 4}),
    ("21 points a sweep", {"points": 21}),
    ("noise 0.5 %", {"noise": 0.005}),
    ("noise 5 %", {"noise": 0.05}),
)


def run(quick: bool) -> tuple[Suite, ...]:
    """Measure settings and peers on two truths, and our default on more and poorer data."""
    return (
        _against_peers("master-curve", MAXWELL, quick),
        _against_peers("master-curve-fractional", FRACTIONAL, quick),
        _other_truths(quick),
        _other_data(quick),
        _ten_scenes(quick),
    )


def _ten_scenes(quick: bool) -> Suite:
    """Compare ours with peers on ten kinds of record: errors, what the bars hold, processor time."""
    points = []
    for scene in scenes():
        sets = [scene.build(_FIRST_SEED + k) for k in range(1 if quick else 10)]
        runs = [_timed(partial(_result, made, {})) for made in sets]
        found = [cast(MasterCurve, value) for value, _ in runs]
        errors = [made.error(one.log10_aT.values) for made, one in zip(sets, found, strict=True)]
        verdicts = [one.verdict.level for one in found]
        points.append(
            Point(
                scene.name,
                float(np.mean(errors)),
                float(np.median([seconds for _, seconds in runs])),
                is_default=True,
                extra={
                    "worst (decades)": float(np.max(errors)),
                    "95 % bars that hold (%)": 100.0 * _covered(sets, found),
                    "verdicts": ", ".join(f"{verdicts.count(v)} {v}" for v in dict.fromkeys(verdicts)),
                },
            )
        )
        points += [] if quick else _peers_on(scene.name, sets)
    notes = [f"{1 if quick else 10} records of each kind, processor time of one call, one thread"]
    notes += ["peers are left out of the quick run"] if quick else rheology_peers.missing()
    error, taken = "RMS error of log10 a_T (decades)", "processor time of a call (s)"
    return Suite("master-curve-scenes", "Shifts of ten kinds of record", error, points, notes=notes, time_label=taken)


def _peers_on(name: str, sets: list[Measured]) -> list[Point]:
    """Run every peer on the records of a scene, on fewer of them where it takes long."""
    points = []
    for label, (group, _) in rheology_peers.shifters(sets[0]).items():
        errors: list[float] = []
        seconds: list[float] = []
        for made in sets:
            if sum(seconds) > _LONGEST:
                break
            answer = _answered(rheology_peers.shifters(made)[label][1])
            if answer is not None:
                seconds.append(answer[1])
                errors.append(made.error(_shifts(answer[0])))
        finite = [error for error in errors if np.isfinite(error)]
        points.append(
            Point(
                f"{name}: {label}",
                float(np.mean(finite)) if finite else float("nan"),
                float(np.median(seconds)) if seconds else float("nan"),
                group,
                extra={
                    "worst (decades)": float(np.max(finite)) if finite else None,
                    "records with an answer": f"{len(finite)} of {len(sets)}",
                },
            )
        )
    return points


def _answered(call: Callable[[], object]) -> tuple[object, float] | None:
    """Return the answer of a peer and its processor time; None whatever it raises instead."""
    try:
        return _timed(call)
    except Exception:
        return None


def _timed(call: Callable[[], object]) -> tuple[object, float]:
    """Return what a call returns, and its processor time (s) on one thread of linear algebra."""
    with threadpool_limits(limits=1, user_api="blas"):
        start = time.process_time()
        value = call()
        return value, time.process_time() - start


def _against_peers(name: str, truth: Truth, quick: bool) -> Suite:
    sets = [measured(truth, _FIRST_SEED + k) for k in range(_QUICK_SEEDS if quick else 10)]
    settings = _settings(truth)
    calls = {label: ("", _ours(sets[0], options)) for label, options in settings.items()}
    calls |= {} if quick else rheology_peers.shifters(sets[0])

    def judge(label: str, timings: Mapping[str, Timing]) -> tuple[float, Extra]:
        errors = [sets[0].error(_shifts(timings[label].value))]
        for made in sets[1:]:
            call = _ours(made, settings[label]) if label in settings else rheology_peers.shifters(made)[label][1]
            errors.append(made.error(_shifts(call())))
        return float(np.mean(errors)), {"worst (decades)": float(np.max(errors))}

    traced = (_DEFAULT,) if quick else calls
    points = race(calls, 2 if quick else 5, judge, _DEFAULT, budget=20.0, traced=traced)
    notes = [f"mean over {len(sets)} seeds; 12 temperatures, 11 points each, 2 % noise"]
    notes += ["peers are left out of the quick run"] if quick else rheology_peers.missing()
    return Suite(name, f"Shifts of {truth.name}", "RMS error of log10 a_T (decades)", points, notes=notes)


def _other_truths(quick: bool) -> Suite:
    """Show the default on hard materials: how far it errs, and whether its bars say so."""
    seeds = range(_FIRST_SEED, _FIRST_SEED + (_QUICK_SEEDS if quick else 20))
    points = []
    for truth, options in (
        (MAXWELL, {}),
        (FRACTIONAL, {}),
        (SINGLE_TIMES, {}),
        (GLASS, {}),
        (MAXWELL, {"points": 3}),
        (FRACTIONAL, {"points": 3}),
    ):
        label = truth.name + (f", {options['points']} points a sweep" if options else "")
        is_default = truth is MAXWELL and not options
        points.append(_of_default(label, truth, seeds, options, quick, is_default, "95 % bars that hold (%)", _covered))
    note = f"the default over {len(seeds)} seeds; 12 temperatures, 2 % noise"
    error = "RMS error of log10 a_T (decades)"
    return Suite("master-curve-truths", "Shifts of other materials", error, points, notes=[note])


def _of_default(
    label: str,
    truth: Truth,
    seeds: range,
    options: Mapping[str, Any],
    quick: bool,
    is_default: bool,
    name: str,
    share: Callable[[list[Measured], list[MasterCurve]], float],
) -> Point:
    """Return how far the default errs over some seeds, and a share in % of what it found."""
    sets = [measured(truth, seed, **options) for seed in seeds]
    timing = paired({label: _ours(sets[0], {})}, 1 if quick else 3)[label]
    found = [cast(MasterCurve, timing.value), *(_result(made, {}) for made in sets[1:])]
    errors = [made.error(one.log10_aT.values) for made, one in zip(sets, found, strict=True)]
    extra = {"worst (decades)": float(np.max(errors)), name: 100.0 * share(sets, found)}
    return Point(label, float(np.mean(errors)), timing.seconds, is_default=is_default, extra=extra)


def _storage(sets: list[Measured], found: list[MasterCurve]) -> float:
    """Return the relative error of the fitted storage modulus, mean over the sets."""
    ratios = [one.data["storage_fitted"].values / made.exact.real for made, one in zip(sets, found, strict=True)]
    return float(np.mean([np.sqrt(np.mean((ratio - 1) ** 2)) for ratio in ratios]))


def _covered(sets: list[Measured], found: list[MasterCurve]) -> float:
    """Return how often the true shift lies within 1.96 stated standard uncertainties."""
    hits: list[bool] = []
    for made, one in zip(sets, found, strict=True):
        off = np.abs(one.log10_aT.values - made.log10_aT)
        at = int(np.argmin(np.abs(made.sweeps["temperature"].values - made.reference)))
        hits += np.delete(off <= 1.96 * one.u_log10_aT.values, at).tolist()
    return float(np.mean(hits))


def _other_data(quick: bool) -> Suite:
    """Show what more temperatures, more points and less noise buy."""
    seeds = range(_FIRST_SEED, _FIRST_SEED + (_QUICK_SEEDS if quick else 10))
    points = []
    for label, options in (("12 temperatures, 11 points, noise 2 %", {}), *_OTHER_DATA):
        points.append(_of_default(label, MAXWELL, seeds, options, quick, not options, "storage modulus (%)", _storage))
    note = f"the default over {len(seeds)} seeds; −40 to 120 °C, 0.1 to 10 Hz"
    title, error = f"Shifts of {MAXWELL.name}: what the data buy", "RMS error of log10 a_T (decades)"
    return Suite("master-curve-data", title, error, points, notes=[note])


def _settings(truth: Truth) -> dict[str, dict[str, Any]]:
    plain = {"vertical": "none", "delay": False, "levels": False}
    found: dict[str, dict[str, Any]] = {
        _DEFAULT: {},
        "free shifts, laws asked for": {"vertical": "linear", "delay": True},
        "free shifts, no laws tried": plain,
    }
    if truth is MAXWELL:
        found["WLF inside the fit"] = {"law": "wlf"}
    return found


def _ours(made: Measured, options: dict[str, Any]) -> Callable[[], object]:
    return lambda: _result(made, options)


def _result(made: Measured, options: dict[str, Any]) -> MasterCurve:
    with warnings.catch_warnings(action="ignore", category=UserWarning):
        return master_curve(made.sweeps, T_ref=made.reference, **options)


def _shifts(found: Any) -> Any:
    return found.log10_aT.values if isinstance(found, MasterCurve) else found
