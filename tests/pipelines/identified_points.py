"""What random sessions say together: errors over uncertainties, by quantity."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from scipy.stats import norm

from pipelines.bench.measure import Point
from tests.pipelines.identified_trial import Score, Trial

_SURE = float(norm.ppf(0.975))


def points(trials: Sequence[Trial]) -> list[Point]:
    """Return one point per quantity of every kind of session."""
    made = []
    for kind in dict.fromkeys(t.kind for t in trials):
        own = [t for t in trials if t.kind == kind]
        done = [t for t in own if t.failure is None]
        for group in ("symmetric", "skewed"):
            made += _of_moduli(f"{kind}, {group}", [t for t in done if t.group == group])
        made += _of_unknowns(kind, done)
        made += _of_evidence(kind, done)
        made.append(_verdicts(kind, own))
    return made


def _of_moduli(name: str, trials: Sequence[Trial]) -> list[Point]:
    made = []
    for quantity in _keys(t.moduli for t in trials):
        scores = [t.moduli[quantity] for t in trials]
        known = [s for s in scores if s is not None]
        extra = {"truths": len(scores), "determined": len(known)}
        if known:
            made.append(_point(f"{name}: {quantity}", known, trials, extra, in_percent=True))
    return made


def _of_unknowns(name: str, trials: Sequence[Trial]) -> list[Point]:
    made = []
    for role in _keys(t.unknowns for t in trials):
        scores = [t.unknowns[role] for t in trials if role in t.unknowns]
        stated = [s.truth for s in scores if s.truth is not None]
        extra = {
            "truths": len(scores),
            "uncertainty over the prior's, median": float(np.median([s.u for s in scores])),
            "RMS of the truth over the prior": _rms(stated),
        }
        made.append(_point(f"{name}: {role}", scores, trials, extra, in_percent=False))
    return made


def _of_evidence(name: str, trials: Sequence[Trial]) -> list[Point]:
    made = []
    for group in _keys(t.evidence for t in trials):
        wrong = [z for t in trials for z in t.evidence.get(group, [])]
        early = [t.evidence[group][0] for t in trials if t.evidence.get(group)]
        extra = {
            "truths": len(early),
            "coverage (%)": _coverage(wrong),
            "bias over uncertainty": float(np.mean(wrong)),
            "the same of the first number": float(np.mean(early)),
        }
        made.append(Point(f"{name}: observed, {group}", _rms(wrong), float("nan"), extra=extra))
    return made


def _verdicts(name: str, trials: Sequence[Trial]) -> Point:
    """Return what was said of long-time moduli, how many fits settled and how many failed."""
    said = [t.relaxed for t in trials if t.relaxed is not None]
    share = float(np.mean([r.is_held for r in said])) if said else float("nan")
    widths = [r.u for r in said if r.u is not None]
    extra: dict[str, float | int] = {
        "truths": len(trials),
        "failed": sum(t.failure is not None for t in trials),
        "not settled": sum(t.failure is None and not t.is_settled for t in trials),
        "with a discrepancy": sum(bool(t.misfits) for t in trials),
        "limits hold the truth (%)": 100.0 * share,
        "called identified": len(widths),
    }
    if widths:
        extra["standard uncertainty, median (%)"] = 100.0 * float(np.median(widths))
    return Point(f"{name}: verdict on E_relaxed", 1.0 - share, _seconds(trials), is_default=True, extra=extra)


def _point(
    setting: str, scores: Sequence[Score], trials: Sequence[Trial], extra: Mapping[str, float], *, in_percent: bool
) -> Point:
    errors = [s.error for s in scores]
    spread = _rms(errors)
    told = {
        "coverage (%)": _coverage(errors),
        "bias over uncertainty": float(np.mean(errors)),
        "standard error of the bias": float(np.std(errors) / np.sqrt(len(errors))),
    }
    if in_percent:
        told["uncertainty over bound, median"] = float(np.median([s.u / s.bound for s in scores]))
        told["error over bound, RMS"] = _rms([s.error * s.u / s.bound for s in scores])
        told["standard uncertainty, median (%)"] = 100.0 * float(np.median([s.u for s in scores]))
    return Point(setting, spread, _seconds(trials), is_default=True, extra={**extra, **told})


def _seconds(trials: Sequence[Trial]) -> float:
    taken = [t.seconds for t in trials if t.seconds is not None]
    return float(np.median(taken)) if taken else float("nan")


def _coverage(errors: Sequence[float]) -> float:
    return 100.0 * float(np.mean(np.abs(errors) < _SURE))


def _rms(errors: Sequence[float]) -> float:
    return float(np.sqrt(np.mean(np.square(errors))))


def _keys(tables: Iterable[Mapping[str, object]]) -> list[str]:
    return list(dict.fromkeys(key for table in tables for key in table))
