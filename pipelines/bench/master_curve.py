"""Time–temperature superposition: error of the shifts against run time, on known materials."""

import warnings
from collections.abc import Callable
from typing import Any, cast

import numpy as np

from labpipe.materials import MasterCurve, master_curve
from pipelines.bench import rheology_peers
from pipelines.bench.measure import Point, Suite, Timing, paired, peak_bytes
from pipelines.bench.rheology_truth import FRACTIONAL, GLASS, MAXWELL, SINGLE_TIMES, Measured, Truth, measured

_FIRST_SEED = 700
_QUICK_SEEDS = 2
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
    )


def _against_peers(name: str, truth: Truth, quick: bool) -> Suite:
    sets = [measured(truth, _FIRST_SEED + k) for k in range(_QUICK_SEEDS if quick else 10)]
    settings = _settings(truth)
    calls: dict[str, Callable[[], object]] = {label: _ours(sets[0], options) for label, options in settings.items()}
    peers = {} if quick else rheology_peers.shifters(sets[0])
    calls |= {label: call for label, (_, call) in peers.items()}
    timings = paired(calls, 2 if quick else 5, budget=20.0)
    points = []
    for label, timing in timings.items():
        errors = [sets[0].error(_shifts(timing.value))]
        for made in sets[1:]:
            call = _ours(made, settings[label]) if label in settings else rheology_peers.shifters(made)[label][1]
            errors.append(made.error(_shifts(call())))
        points.append(
            Point(
                label,
                float(np.mean(errors)),
                timing.seconds,
                peers[label][0] if label in peers else "",
                is_default=label == _DEFAULT,
                cold_seconds=timing.cold_seconds,
                samples=timing.samples,
                peak_bytes=None if quick and label != _DEFAULT else peak_bytes(calls[label]),
                extra={"worst (decades)": float(np.max(errors))},
            )
        )
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
        sets = [measured(truth, seed, **options) for seed in seeds]
        timing = paired({label: _ours(sets[0], {})}, 1 if quick else 3)[label]
        found = _found(sets, timing)
        errors = [made.error(one.log10_aT.values) for made, one in zip(sets, found, strict=True)]
        points.append(
            Point(
                label,
                float(np.mean(errors)),
                timing.seconds,
                is_default=truth is MAXWELL and not options,
                extra={
                    "worst (decades)": float(np.max(errors)),
                    "95 % bars that hold (%)": 100.0 * _covered(sets, found),
                },
            )
        )
    return Suite(
        "master-curve-truths",
        "Shifts of other materials",
        "RMS error of log10 a_T (decades)",
        points,
        notes=[f"the default over {len(seeds)} seeds; 12 temperatures, 2 % noise"],
    )


def _found(sets: list[Measured], timing: Timing) -> list[MasterCurve]:
    """Return the default's answer to every set, the first one from the runs that were timed."""
    return [cast(MasterCurve, timing.value), *(_result(made, {}) for made in sets[1:])]


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
        sets = [measured(MAXWELL, seed, **options) for seed in seeds]
        timing = paired({label: _ours(sets[0], {})}, 1 if quick else 3)[label]
        found = _found(sets, timing)
        errors = [made.error(one.log10_aT.values) for made, one in zip(sets, found, strict=True)]
        storage = [
            float(np.sqrt(np.mean((one.data["storage_fitted"].values / made.exact.real - 1) ** 2)))
            for made, one in zip(sets, found, strict=True)
        ]
        points.append(
            Point(
                label,
                float(np.mean(errors)),
                timing.seconds,
                is_default=not options,
                extra={
                    "worst (decades)": float(np.max(errors)),
                    "storage modulus (%)": 100.0 * float(np.mean(storage)),
                },
            )
        )
    return Suite(
        "master-curve-data",
        f"Shifts of {MAXWELL.name}: what the data buy",
        "RMS error of log10 a_T (decades)",
        points,
        notes=[f"the default over {len(seeds)} seeds; −40 to 120 °C, 0.1 to 10 Hz"],
    )


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
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        return master_curve(made.sweeps, T_ref=made.reference, **options)


def _shifts(found: Any) -> Any:
    return found.log10_aT.values if isinstance(found, MasterCurve) else found
