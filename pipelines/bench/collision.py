"""Appendix A's collision: an integrator of high order with events, steps as usual, a closed form.

Truth: the sphere with a Hertz spring and a dashpot, without gravity, to ten digits (contact ends
where the force does). The thesis does not say how it integrates; the usual explicit scheme with a
fixed step stands for it.
"""

from collections.abc import Mapping
from functools import partial
from math import sqrt

from labpipe import contact
from labpipe.contact.lumped import contact_stiffness
from labpipe.contact.sphere import hertz
from pipelines.bench.measure import OURS, THESIS, Extra, Suite, Timing, race

_RADIUS, _MASS, _MODULUS, _NU = 9.525e-3, 0.505, 3.2e9, 0.35
# So little gravity changes the restitution by 1e-7.
_SPEED, _GRAVITY = 0.5, 1e-4
#: Restitution over the dimensionless damping b = (c/m) (m/χ)^(3/5) v^(1/5).
_TRUTH = {0.05: 0.9443967792, 0.1: 0.8928588755, 0.5: 0.5952515011, 1.0: 0.3939306032}


def run(quick: bool) -> Suite:
    """Measure restitution by events, by fixed steps and by the closed form."""
    calls = {"events, eighth order": (OURS, _by_events), "closed form (Padé)": (OURS, _by_formula)}
    for step in (1e-5, 1e-6) if quick else (2e-5, 1e-5, 1e-6, 1e-7):
        calls[f"velocity Verlet, step {step:.0e} s"] = (THESIS, partial(_by_steps, step))

    def judge(name: str, timings: Mapping[str, Timing]) -> tuple[float, Extra]:
        return _error(timings[name].value), {}

    points = race(calls, 3 if quick else 7, judge, "events, eighth order", budget=30.0)
    title, error = (
        "Sphere with a Hertz spring and a dashpot: restitution at four dampings",
        "worst error of the restitution (1)",
    )
    notes = ["The closed form needs no motion; it holds without gravity and plasticity."]
    return Suite("collision", title, error, points, notes=notes, time_label="run time of four collisions (s)")


def _stiffness() -> float:
    return contact_stiffness(_RADIUS, _MODULUS, _NU)


def _damping(b: float) -> float:
    return float(b * _MASS * (_stiffness() / _MASS) ** 0.6 / _SPEED**0.2)


def _by_events() -> dict[float, float]:
    height = _SPEED**2 / (2.0 * _GRAVITY)
    fall = _SPEED / _GRAVITY
    return {
        b: float(
            contact.collision(
                _RADIUS,
                _MASS,
                height,
                youngs_modulus=_MODULUS,
                nu=_NU,
                damping=_damping(b),
                duration=fall + 5e-3,
                gravity=_GRAVITY,
                time=[fall],
            ).restitution[0]
        )
        for b in _TRUTH
    }


def _by_formula() -> dict[float, float]:
    return {b: float(hertz.dashpot_restitution(b)) for b in _TRUTH}


def _by_steps(step: float) -> dict[float, float]:
    return {b: _bounced(_stiffness() / _MASS, _damping(b) / _MASS, step) for b in _TRUTH}


def _bounced(stiffness: float, damping: float, step: float) -> float:
    """Velocity Verlet with the damping of the half step, until the force is gone."""
    depth, speed, push = 0.0, _SPEED, 0.0
    while True:
        half = speed - 0.5 * step * push
        depth += step * half
        if depth <= 0.0:
            return -half / _SPEED
        push = max(stiffness * depth**1.5 + damping * sqrt(depth) * half, 0.0)
        speed = half - 0.5 * step * push
        if push == 0.0 and speed < 0.0:
            return -speed / _SPEED


def _error(found: object) -> float:
    assert isinstance(found, dict)  # noqa: S101 - the calls above return nothing else
    return max(abs(found[b] - exact) for b, exact in _TRUTH.items())
