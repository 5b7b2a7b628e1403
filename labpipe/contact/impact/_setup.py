"""How finely to simulate a drop: its scales, and the springs and steps they ask for."""

from dataclasses import dataclass
from math import inf, pi, sqrt
from typing import NamedTuple

import numpy as np

from labpipe.contact.impact._setting import Setting
from labpipe.contact.impact._springs import Springs, line_springs, ring_springs
from labpipe.contact.impact._stepping import MOST_RINGING
from labpipe.contact.memory import Creep, step_weights
from labpipe.units import require_positive

# Hertz impact: duration = 2.943 approach / speed.
_HERTZ_DURATION = 2.9432751843
# Step error for an error of rtol: restitution errs by 0.55 (step error)^(2/3), of which a whole
# train of bounces may add up some ten; the constants here are measured on Ting's solutions.
_STEP_SHARE = 0.117
# Springs per contact radius at rtol = 1e-4; their error falls with the square.
_SPRINGS_PER_RADIUS = 80
# Where the instantaneous compliance is too small to matter within one step, the pressure ends in a
# step at the edge: the error then falls only with the number of springs, so take more.
_FINER_FOR_A_STEP = 12.0
_STEPS_LOOKED_AT = 8
# Rings per radius of the first contact: later ones are smaller, so it takes more.
_RINGS_PER_RADIUS, _MOST_RINGS_PER_RADIUS = 120, 1200
# Even spacing of the springs up to this part of the smallest contact expected.
_CORE = 0.25
# Springs are laid out and taken into a contact this far beyond the radius expected.
MARGIN = 1.1
# First step after touch, and longest step, as fractions of the time scale of the contact.
FIRST_STEP, LONGEST_STEP = 1e-4, 0.05
# Steps per decade of time at rest, at rtol = 1e-4.
_STEPS_PER_DECADE = 12
# Steps of one contact at a step tolerance: 1.7 tolerance^(-1/3), measured.
_STEPS_PER_CONTACT = 1.7


@dataclass(frozen=True, slots=True)
class Scales:
    """Estimated sizes of an impact and of the rest of this sphere.

    ``duration`` [s]: of the first contact; ``radius`` [m]: largest contact radius; ``rest_radius`` [m]: contact radius
    under the weight, at first; ``rest_period``, ``rest_speed`` [s, m/s]: of small oscillations on the static sag, and
    the speed of an amplitude of one sag.
    """

    duration: float
    radius: float
    rest_radius: float
    rest_period: float
    rest_speed: float


class Shortcuts(NamedTuple):
    """Work that a drop leaves out because no result needs it; each can be switched off for comparison.

    Attributes
    ----------
    flights : bool
        A flight is one step, exact, and a contact up to a lift-off is collocated; otherwise all is stepped, flights in
        steps as long as those of a contact.
    rest : bool
        Once a contact has come to rest its creep is followed in few steps; otherwise its motion is
        followed to the end, and no time of rest is found.
    """

    flights: bool = True
    rest: bool = True

    @classmethod
    def chosen(cls, *, full: bool) -> "Shortcuts":
        """All of them, or none for a run that leaves nothing out."""
        return cls(flights=not full, rest=not full)


ALL_SHORTCUTS = Shortcuts()


@dataclass(frozen=True, slots=True)
class Effort:
    """How finely to simulate; ``rtol`` starts as asked for and is refined when that is too coarse.

    With ``rows_only`` a run ends where the sphere swings too little to lift off again, and its rest is
    not followed. The other fields are as in :func:`drop`.
    """

    rtol: float
    ring_width: float | None
    fold: bool
    max_steps: int
    shortcuts: Shortcuts = ALL_SHORTCUTS
    rows_only: bool = False


def scales(creep: Creep, radius: float, mass: float, gravity: float, speed: float) -> Scales:
    """Estimate the scales from Hertz, with the compliance at the time scale itself."""
    weight = mass * gravity

    def at_rest(compliance: float) -> tuple[float, float]:
        contact = (0.75 * weight * radius * compliance) ** (1 / 3)
        return contact, 2.0 * pi * sqrt(0.5 * mass * compliance / contact)

    period = at_rest(creep.instantaneous)[1]
    for _ in range(3):
        period = at_rest(float(creep.compliance(period / 4)))[1]
    duration, approach, compliance = period, 0.0, creep.instantaneous
    for _ in range(4):
        compliance = float(creep.compliance(duration / 2))
        approach = (15.0 / 16.0 * mass * speed**2 * compliance / sqrt(radius)) ** 0.4
        ballistic = _HERTZ_DURATION * approach / speed if speed > 0.0 else inf
        duration = 1.0 / (1.0 / ballistic + 2.0 / period)
    rest_approach = at_rest(compliance)[0] ** 2 / radius
    return Scales(
        duration=duration,
        radius=sqrt(radius * (approach + 2.0 * rest_approach)),
        rest_radius=at_rest(creep.instantaneous)[0],
        rest_period=period,
        rest_speed=gravity * period / (2.0 * pi),
    )


def _ends_in_a_step(creep: Creep, expected: Scales, duration: float) -> bool:
    """Look whether steps of an impact, or of rest, are long against the fastest relaxation."""
    shortest = expected.duration / 400.0
    longest = max(expected.rest_period / 4.0, duration / 10.0)
    steps = np.geomspace(shortest, longest, _STEPS_LOOKED_AT).tolist()
    looks = [step_weights(creep, dt) for dt in steps]
    return any(look.old_total > MOST_RINGING * look.compliance for look in looks)


def springs_for(setting: Setting, creep: Creep, expected: Scales, effort: Effort, reach: float) -> Springs:
    """Springs of the solver out to a radius [m], as fine as rtol asks."""
    finer = sqrt(1e-4 / effort.rtol)
    after = setting.duration - setting.fall_time
    finer *= _FINER_FOR_A_STEP if _ends_in_a_step(creep, expected, after) else 1.0
    if setting.solver == "rings":
        # Rings cannot be made so fine: their number is limited.
        finer = min(finer, _MOST_RINGS_PER_RADIUS / _RINGS_PER_RADIUS)
        width = effort.ring_width or expected.radius / (_RINGS_PER_RADIUS * finer)
        require_positive("m", ring_width=width)
        return ring_springs(reach, setting.radius, width, setting.profile)
    core = _CORE * min(expected.rest_radius, expected.radius)
    return line_springs(reach, setting.radius, core, _SPRINGS_PER_RADIUS * finer, setting.profile)


def step_tolerance(rtol: float) -> float:
    """Error in velocity that a step may make, relative to the speed of the bounce."""
    return (_STEP_SHARE * rtol) ** 1.5


def steps_per_contact(rtol: float) -> float:
    """About how many steps a contact takes."""
    return _STEPS_PER_CONTACT * step_tolerance(rtol) ** (-1 / 3)


def growth(rtol: float) -> float:
    """Factor between steps at rest."""
    return float(10.0 ** (sqrt(rtol / 1e-4) / _STEPS_PER_DECADE))
