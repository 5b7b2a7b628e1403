"""One impact, fitted: ballistic arcs on both sides and a contact pulse between them.

The acceleration that the contact adds is

    a(t) = c [s (1 - s)]^(3/2) (1 + r1 T1 + r2 T2 + r3 T3 + r4 T4)(2 s - 1) + c r5 N(s)
    s = (t - touch) / (liftoff - touch)

with Chebyshev polynomials T. The exponent is Hertz's: any smooth convex body meets and leaves an elastic flat so. A
solid that relaxes as t^-alpha while it is met begins as s^(3/2 - alpha), with alpha up to 0.45 for a rubber in its
transition; it always leaves with 3/2. N(s) is s (1 - s)^(3/2) less its part in the others, without which the touch of
soft spheres was off by seven times its uncertainty. The position is the double integral plus the incoming arc; the
outgoing arc follows from the pulse, so that both flights determine its impulse and its centre of gravity, and the
samples inside its width. Touch and lift-off are where the force begins and ends, whatever dent is left.

The shape r1..r5 has a prior, from simulated impacts whose force is fitted without noise. Where less than 0.6 of
the speed returns polymers scatter more about it and the stated uncertainty is enlarged.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.polynomial import chebyshev
from scipy.integrate import cumulative_simpson
from scipy.linalg import block_diag
from scipy.optimize import leastsq

from labpipe.arrays import Floats
from labpipe.signals._noise_spectrum import WHITE, Colour, coloured_covariance
from labpipe.signals._shape_prior import PRIORS, SHAPE, Character, Floor, ShapePrior, expected_shape
from labpipe.uncertainty import propagated_covariance

NAMES = ("level", "speed", "pulse", *SHAPE, "touch", "liftoff", "gravity")
"""Parameters: arc's position and speed at the reference time, the pulse, and the fall's g."""

_EXPONENT, _N_CHEBYSHEV = 1.5, 5
_NODES, _STRIDE = 4001, 10  # linear between them is good to 1e-8; the path in contact is followed by every tenth
_SHAPE = [NAMES.index(name) for name in SHAPE]
_TOUCH, _LIFTOFF, _GRAVITY = (NAMES.index(name) for name in ("touch", "liftoff", "gravity"))
_WITH_PRIOR = [*_SHAPE, _GRAVITY]
_LOSS_UPDATES, _LOSS_SETTLED = 3, 0.02
_MOST_EVALUATIONS, _SHORTER = 200, 0.5
_TESTED_LOSS, _UNTESTED_SCALE = 0.4, 0.1  # beyond, polymers scatter: u grows to threefold at e = 0.3
_HIDING, _GAP = 0.3, 3.0  # parts of a contact, and usual intervals, that a gap which hides it exceeds
_CLEAR = 0.8  # of the guessed duration from its middle: surely out of contact


@dataclass(frozen=True, slots=True)
class ImpactFit:
    """Result of :func:`fit_impact`: ``value`` and ``covariance`` in the order of :data:`OUTPUTS`.

    ``by_shape`` (output, :data:`SHAPE`) is the contribution of one deviation of each unknown of the pulse's shape, a
    part of ``covariance`` in which other impacts and drops of the same body err by the same (correlation 0.97 in
    simulated impacts of polymers). ``chi_square`` is the reduced sum of squares, ``n_evaluations`` the number of model
    evaluations; ``unread`` are begin and end [s] of the gap among the readings that hides the contact, if any.
    """

    value: Floats
    covariance: Floats
    by_shape: Floats
    chi_square: float
    n_evaluations: int
    unread: tuple[float, float] | None = None

    @property
    def u(self) -> Floats:
        """Standard uncertainties (output,); a variance that rounding leaves below zero is none."""
        return np.sqrt(np.maximum(np.diagonal(self.covariance), 0.0))


LABELS = {
    "touch_time": ("s", "time of touch"),
    "liftoff_time": ("s", "time of lift-off"),
    "incoming_speed": ("m/s", "speed at touch"),
    "outgoing_speed": ("m/s", "speed at lift-off"),
    "touch_level": ("m", "displacement at touch"),
    "liftoff_level": ("m", "displacement at lift-off"),
    "deepest_level": ("m", "displacement at the deepest point"),
    "apex_time": ("s", "time of the highest point after the bounce"),
    "apex_height": ("m", "height of the flight above lift-off"),
    "penetration": ("m", "depth from touch to the deepest point"),
    "contact_duration": ("s", "time from touch to lift-off"),
    "peak_acceleration": ("m/s2", "largest acceleration by the contact force"),
    "restitution": ("1", "coefficient of restitution"),
}
"""Reported quantities of an impact: units and meaning."""

OUTPUTS = (*LABELS, "gravity")


def _tables() -> tuple[Floats, Floats, Floats, Floats]:
    s = np.linspace(0.0, 1.0, _NODES)
    window = (s * (1.0 - s)) ** _EXPONENT
    shapes = window * chebyshev.chebvander(2.0 * s - 1.0, _N_CHEBYSHEV - 1).T
    onset = s * (1.0 - s) ** _EXPONENT
    shared = np.linalg.lstsq(shapes.T, onset, rcond=None)[0]
    shapes = np.vstack([shapes, onset - shared @ shapes])
    first = cumulative_simpson(shapes, x=s, initial=0.0)
    second = cumulative_simpson(first, x=s, initial=0.0)
    return s, shapes, first, second


_S, _SHAPES, _FIRST, _SECOND = _tables()


def fit_impact(
    time: Floats,
    position: Floats,
    sigma: float,
    guess: tuple[float, float],
    gravity: float,
    u_gravity: float,
    prior: ShapePrior = PRIORS["any"],
    colour: Colour = WHITE,
    floor: Floor | None = None,
    swing: float = 0.0,
) -> ImpactFit:
    """Fit arcs and pulse to the samples around one impact.

    ``time`` [s] and ``position`` [m] (n,) run from the flight before to the flight after, upwards positive, with the
    standard deviation ``sigma`` of a sample; ``guess`` are touch and lift-off time, roughly; ``floor`` is the plate
    under the contact, and ``swing`` [m/s] the amplitude of its speed after earlier impacts.
    """
    reference, duration = 0.5 * (guess[0] + guess[1]), guess[1] - guess[0]
    t = time - reference
    height = float(np.median(position))
    y = position - height
    start = _start(t, y, duration, gravity)
    scale = np.array([sigma, sigma / duration, start[2], *np.ones(len(_SHAPE)), duration, duration, gravity])
    character = _character(start, floor, swing)
    n_evaluations = 0
    for _ in range(_LOSS_UPDATES):
        mean, spread = expected_shape(prior, character)
        if n_evaluations == 0:
            start[_SHAPE] = mean
        expected = np.append(mean, gravity)
        whitening = block_diag(np.linalg.inv(spread[:, None] * prior.root), 1.0 / u_gravity)
        p, jacobian, misfit, n = _minimise(t, y, sigma, expected, whitening, start, scale)
        n_evaluations += n
        previous, character = character, _character(p, floor, swing)
        start = p
        if abs(character.loss - previous.loss) < _LOSS_SETTLED:
            break
    chi_square = misfit / max(len(t) - len(NAMES) + len(_WITH_PRIOR), 1)
    # of residuals whose noise is not white
    frequency = np.fft.rfftfreq(len(t), float(np.median(np.diff(t))))[2:]
    excess = chi_square / (1.0 + colour.corner * float(np.mean(1.0 / frequency)))
    # More scatter than the noise means a motion that the model lacks (a vibrating plate).
    factor = max(excess, 1.0) * (1.0 + (max(character.loss - _TESTED_LOSS, 0.0) / _UNTESTED_SCALE) ** 2)
    inverse = np.linalg.pinv(jacobian.T @ jacobian, hermitian=True)
    covariance = factor * coloured_covariance(jacobian, inverse, time, colour, sigma) * np.outer(scale, scale)
    ties = np.sqrt(factor) * inverse[:, _SHAPE] @ (scale[_SHAPE] * whitening[:-1, :-1]).T
    value, gradient = _outputs(p, scale)
    value[[OUTPUTS.index(name) for name in LABELS if name.endswith("_time")]] += reference
    value[[OUTPUTS.index(name) for name in LABELS if name.endswith("_level")]] += height
    output_covariance = propagated_covariance(gradient, covariance)
    by_shape = gradient @ (scale[:, None] * ties)
    # The widest gap among the readings that meets the contact, if it hides it.
    unread, gaps = None, np.where((time[1:] > value[0]) & (time[:-1] < value[1]), np.diff(time), 0.0)
    widest = int(np.argmax(gaps))
    if gaps[widest] > max(_HIDING * float(value[1] - value[0]), _GAP * float(np.median(np.diff(time)))):
        unread = float(time[widest]), float(time[widest + 1])
        output_covariance = output_covariance + _of_unread(value, float(gaps[widest]))
    return ImpactFit(value, output_covariance, by_shape, chi_square, n_evaluations, unread)


def _of_unread(value: Floats, gap: float) -> Floats:
    """Covariance of the outputs when touch and lift-off may be anywhere in a gap.

    Levels and speeds follow the times along the arcs; depth and force are not known at all. Fitted and true time are
    both somewhere in the gap: their difference has the standard deviation gap / sqrt(6).
    """
    by, of = dict(zip(OUTPUTS, np.eye(len(OUTPUTS)), strict=True)), dict(zip(OUTPUTS, value.tolist(), strict=True))
    before, after, gravity = of["incoming_speed"], of["outgoing_speed"], of["gravity"]
    touch = by["touch_time"] - before * (by["touch_level"] + by["penetration"]) - by["contact_duration"]
    touch += gravity * by["incoming_speed"] - gravity * after / before**2 * by["restitution"]
    liftoff = by["liftoff_time"] + after * (by["liftoff_level"] - by["apex_height"]) + by["contact_duration"]
    liftoff -= gravity * by["outgoing_speed"] + gravity / before * by["restitution"]
    rows = np.array([touch, liftoff, before * (by["deepest_level"] - by["penetration"])]) * gap / np.sqrt(6.0)
    rows = np.vstack([rows, of["peak_acceleration"] * by["peak_acceleration"]])
    return rows.T @ rows


def _minimise(
    t: Floats, y: Floats, sigma: float, expected: Floats, whitening: Floats, start: Floats, scale: Floats
) -> tuple[Floats, Floats, float, int]:
    """Parameters, derivatives of all residuals by the scaled ones, sum of squared misfits, evaluations.

    ``expected`` are the parameters :data:`_WITH_PRIOR`, ``whitening`` that of the deviations from them.
    """
    ties = whitening @ np.eye(len(NAMES))[_WITH_PRIOR]

    def residual(scaled: Floats) -> Floats:
        p = scaled * scale
        misfit = (_model(t, p)[0] - y) / sigma
        return np.concatenate([misfit, whitening @ (p[_WITH_PRIOR] - expected)])

    def jacobian(scaled: Floats) -> Floats:
        return np.concatenate([_model(t, scaled * scale)[1] / sigma, ties]) * scale

    def solved(start: Floats) -> tuple[Floats, dict[str, Any]]:
        # The steps of `least_squares`, without what it does around them.
        options = {"ftol": 1e-7, "xtol": 1e-8, "gtol": 1e-8, "maxfev": _MOST_EVALUATIONS}
        found, _, details, *_ = leastsq(residual, start / scale, Dfun=jacobian, full_output=True, **options)
        return found, details

    found, details = solved(start)
    n_evaluations = int(details["nfev"])
    if n_evaluations >= _MOST_EVALUATIONS:
        # From too long a contact, as few samples suggest, an odd shape creeps towards the true one and does not arrive.
        shorter = start.copy()
        shorter[[_TOUCH, _LIFTOFF]] *= _SHORTER
        shorter[2] /= _SHORTER
        again, other = solved(shorter)
        n_evaluations += int(other["nfev"])
        if np.sum(other["fvec"] ** 2) < np.sum(details["fvec"] ** 2):
            found, details = again, other
    misfit = float(np.sum(details["fvec"][: len(t)] ** 2))
    return found * scale, jacobian(found), misfit, n_evaluations


def _character(p: Floats, floor: Floor | None, swing: float) -> Character:
    """Return the arguments of the expected shape: of the speed that is lost, the plate's part is not the solid's."""
    ((before,), (after,)) = _speeds(p[None])
    incoming, length = max(float(before), 1e-3 * abs(float(after)) + 1e-9), float(p[_LIFTOFF] - p[_TOUCH])
    taken = 0.0 if floor is None else floor.speed(incoming + float(after), length)
    loss = 1.0 - (float(after) + taken) / incoming
    return Character(min(max(loss, 0.0), 1.0), float(p[_GRAVITY]) * length / incoming, swing / incoming)


def _start(t: Floats, y: Floats, duration: float, gravity: float) -> Floats:
    """Arc from the samples before the contact, impulse from the arc behind it."""
    arcs = []
    for side in (-t, t):
        free = side > min(_CLEAR * duration, float(np.partition(side, -4)[-4]))
        arcs.append(np.polynomial.polynomial.polyfit(t[free], y[free] + 0.5 * gravity * t[free] ** 2, 1))
    (level, speed), (_, after) = arcs
    pulse = (after - speed) / (duration * float(_FIRST[0, -1]))
    return np.array([level, speed, pulse, *np.zeros(len(_SHAPE)), -0.5 * duration, 0.5 * duration, gravity])


def _model(t: Floats, p: Floats) -> tuple[Floats, Floats]:
    """Return the position at times (n,), and its derivative by all parameters (n, parameter)."""
    level, speed, pulse, *_, touch, liftoff, gravity = p
    length, shape = liftoff - touch, np.append(1.0, p[_SHAPE])
    s = (t - touch) / length
    # linear between the nodes; beyond 0..1, where most samples lie, the tables stay constant
    tables = np.vstack([shape @ _FIRST, _SECOND])
    found = np.where(s < 0.5, tables[:, :1], tables[:, -1:])
    within = np.flatnonzero((s > 0.0) & (s < 1.0))
    place = s[within] * (_NODES - 1)
    cell = place.astype(np.intp)
    below = tables[:, cell]
    found[:, within] = below + (place - cell) * (tables[:, cell + 1] - below)
    first, each = found[0], found[1:] + np.multiply.outer(_FIRST[:, -1], np.maximum(s - 1.0, 0.0))
    second = shape @ each
    result = np.empty((len(t), len(NAMES)))
    result[:, 0], result[:, 1], result[:, _GRAVITY] = 1.0, t, -0.5 * t**2
    result[:, 2] = length**2 * second
    result[:, _SHAPE] = pulse * length**2 * each[1:].T
    # d s/d touch = (s - 1)/length, d s/d liftoff = -s/length, d length = -1, +1.
    result[:, _TOUCH] = pulse * length * ((s - 1.0) * first - 2.0 * second)
    result[:, _LIFTOFF] = pulse * length * (-s * first + 2.0 * second)
    return level + speed * t - 0.5 * gravity * t**2 + pulse * length**2 * second, result


def _outputs(p: Floats, scale: Floats) -> tuple[Floats, Floats]:
    """Return outputs and their derivative by the parameters, by central differences."""
    steps = np.diag(1e-5 * scale)
    sets = p + np.vstack([np.zeros(len(p)), steps, -steps])
    level, speed, pulse, touch, liftoff, gravity = sets[:, [0, 1, 2, _TOUCH, _LIFTOFF, _GRAVITY]].T
    length, shape = liftoff - touch, np.insert(sets[:, _SHAPE], 0, 1.0, axis=1)
    inside = touch + np.multiply.outer(_S[::_STRIDE], length)
    path = level + speed * inside - 0.5 * gravity * inside**2 + pulse * length**2 * (shape @ _SECOND[:, ::_STRIDE]).T
    acceleration = pulse * (shape @ _SHAPES).T
    incoming, outgoing = _speeds(sets)
    lowest, apex = path.min(axis=0), (liftoff + outgoing / gravity, 0.5 * outgoing**2 / gravity)
    derived = (path[0] - lowest, liftoff - touch, acceleration.max(axis=0), outgoing / incoming, gravity)
    kinematics = (touch, liftoff, incoming, outgoing, path[0], path[-1], lowest)
    values = np.stack([*kinematics, *apex, *derived], axis=1)  # in the order of OUTPUTS
    upper, lower = np.split(values[1:], 2)
    return values[0], (upper - lower).T / (2.0 * np.diag(steps))


def _speeds(p: Floats) -> tuple[Floats, Floats]:
    """Return the speeds before and after the contact (n,) of several sets of parameters."""
    speed, pulse, touch, liftoff, gravity = p[:, [1, 2, _TOUCH, _LIFTOFF, _GRAVITY]].T
    impulse = pulse * (liftoff - touch) * (_FIRST[0, -1] + p[:, _SHAPE] @ _FIRST[1:, -1])
    return -(speed - gravity * touch), speed - gravity * liftoff + impulse
