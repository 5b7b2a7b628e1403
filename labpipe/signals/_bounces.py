"""Events of a falling and bouncing body: release, contacts, bounces, vibration, rest.

The smoothing spline finds the impacts, where the speed turns from down to up between two flights; :mod:`._impact_fit`
fits each with its two ballistic arcs.
"""

import json
import warnings
from typing import Any, Literal, NamedTuple

import numpy as np
import xarray as xr

from labpipe.arrays import Floats
from labpipe.errors import TWO_CLOCKS, InputError
from labpipe.signals._derivative import checked_record
from labpipe.signals._hum import Hum, Stretch, hum_of
from labpipe.signals._impact_fit import LABELS, OUTPUTS, ImpactFit, fit_impact
from labpipe.signals._noise import estimate_noise
from labpipe.signals._noise_spectrum import Colour, corner_in_flight, u_of_rate
from labpipe.signals._outliers import outliers
from labpipe.signals._readings import is_constant
from labpipe.signals._reversals import (
    FEWEST_IN_FLIGHT,
    SURE,
    Turn,
    arc,
    common_fall,
    curvature,
    find_turns,
    first_fall,
    flights_after,
)
from labpipe.signals._shape_prior import PRIORS, SHAPE, Floor, ShapePrior
from labpipe.signals._smoothing_spline import smooth
from labpipe.uncertainty import propagated_u
from labpipe.variables import variable, with_u

PHASES = ("held", "falling", "bouncing", "vibration", "static")
"""Phases of a drop, in their order."""

LONGEST_ARC = 12e-3  # of flight used on either side of an impact, s; longer adds less than the pulse costs
_FALL_TOLERANCE = 0.35  # by which a flight's acceleration may differ from the common one
_IMPULSIVE = 4.0  # times the fall's acceleration, the least mean acceleration of the first impact
_ENDS = 4  # readings at either end of a record that do not show which way it falls
_HELD = 0.1  # of the fall, before which the body surely rests
_REST_FRACTION = 0.01  # of the first impact speed, below which the body is at rest

TOGETHER = ("restitution", "contact_duration", "incoming_speed", "penetration")
"""Quantities of an impact that are compared together: the part of their errors in common is stated with its sign."""
_SHARED = (*TOGETHER, "touch_time", "liftoff_time", "outgoing_speed")
"""Quantities of which the shape of the contact's pulse is a part of the uncertainty."""


def bounces(
    displacement: xr.Dataset | xr.DataArray, *, contact: Literal["any", "polymer"] = "any", floor: Floor | None = None
) -> xr.Dataset:
    """Find and measure every bounce of a body that was dropped.

    Parameters
    ----------
    displacement : Dataset with ``displacement`` or DataArray, over time [m]
        Either direction, any offset; NaN is left out. An attribute ``hum`` of the Dataset says which hum was taken out
        of it already; it is found again with the flights.
    contact : {"any", "polymer"}
        Prior knowledge of the force's shape, see :data:`labpipe.signals._shape_prior.PRIORS`. ``"polymer"`` (a broad
        relaxation spectrum, such as acrylic, PEEK, nylon or PTFE) halves the uncertainties; ``"any"`` also covers
        bodies with one relaxation time and losses proportional to velocity.
    floor : Floor, optional
        The plate under the contact, which takes and bends its part of each pulse. Default: any.

    Returns
    -------
    Dataset
        Over ``impact`` (from 1), each with its ``u_``: the quantities of :data:`labpipe.signals._impact_fit.LABELS`,
        levels in the record's own direction and zero. ``shared_u_`` of times, speeds and restitution is the part of
        ``u_`` by the unknown shape of the pulse, which drops of the same body share; ``common_`` of those that are
        compared together (impact, ``unknown``) the change by one deviation of each unknown of the shape, then of the
        impact's own noise, with its sign. Scalars with ``u_``: ``release_time``, ``first_contact_time``,
        ``rest_time`` [s] (NaN when the record ends before), ``contact_level``, ``drop_height``, ``rest_level`` [m],
        ``fall_acceleration`` [m/s2]; without, ``settling_time`` [s]: the last touch, after which no flight can be
        resolved. Attributes: ``direction`` (+1 when larger displacement is higher), ``noise`` (m) of neighbouring
        samples, ``work``; ``hum`` (:meth:`labpipe.signals.Hum.to_text`) where there is one, which was taken out first;
        ``other_fall``, as JSON, where later flights have another acceleration: from when [s], which, its u [m/s2].

    Raises
    ------
    InputError
        No body that falls and bounces is in the record.

    Warns
    -----
    UserWarning
        The fall began before the record; the record ends before the body is at rest; a gap among the readings hides a
        contact (its uncertainties then hold the gap).

    Notes
    -----
    Touch and lift-off are where the contact force begins and ends (thesis section 3.3, figure 3.13). A later touch is
    lower than the first (a dent is left), and lift-off is lower than touch. A scale of the record (an inclined sensor)
    multiplies all levels and speeds equally and is not in the ``u_`` here; it cancels in ``restitution`` and times.

    The uncertainties cover the unknown shape of the contact pulse (see :mod:`._impact_fit`). For standard linear
    solids ``"polymer"`` states 1.9 times too little. A bounce whose flight is too short to show its fall is not
    counted: at 1 µm and 20 kHz flights of about 1.5 ms (3 µm high) are the shortest.
    """
    if contact not in PRIORS:
        raise InputError(f'contact must be one of {", ".join(PRIORS)}; found "{contact}"')
    record = displacement["displacement"] if isinstance(displacement, xr.Dataset) else displacement
    time, values = checked_record(record)
    is_read = np.isfinite(values)
    time, values = time[is_read], values[is_read]
    if len(time) < 4 * FEWEST_IN_FLIGHT:
        raise InputError(f"a drop needs at least {4 * FEWEST_IN_FLIGHT} readings; found {len(time)}")
    sigma = estimate_noise(values - values[0], time).sigma
    if is_constant(values) or not (np.isfinite(sigma) and sigma > 0.0):
        raise InputError("the displacement does not change: no drop in this record")
    wild = outliers(values, time, noise=sigma)
    known = Hum.of_text(displacement.attrs.get("hum")) if isinstance(displacement, xr.Dataset) else None
    return _measured(time[~wild.flags], values[~wild.flags], sigma, known, contact, floor)


def _measured(
    time: Floats, values: Floats, sigma: float, known: Hum | None, contact: str, floor: Floor | None
) -> xr.Dataset:
    """Find and measure the bounces of readings that are all valid."""
    motion = _followed(time, values, sigma)
    raw = values if known is None else values + known.at(time)
    free = _without_swing(time, values, sigma, motion)
    hum = hum_of(time, raw, sigma, free, known)
    if hum is not known:
        values = raw if hum is None else raw - hum.at(time)
        motion = _followed(time, values, sigma)
        free = _without_swing(time, values, sigma, motion)
    direction, turns = motion.direction, motion.turns
    colour = Colour(corner_in_flight(time, values, sigma, free), hum)
    height = direction * values
    fall, u_fall = common_fall(time, height, sigma, turns, colour)
    if turns[0].jump < _IMPULSIVE * fall * turns[0].duration:
        raise InputError(
            f"no bounce found: the strongest reversal changes the speed by {turns[0].jump:.3g} "
            f"m/s in {turns[0].duration:.3g} s, no more than {_IMPULSIVE:.0f} times the fall does"
        )
    impacts, last_touch = fitted(time, height, (sigma, colour), turns, (fall, u_fall), PRIORS[contact], floor)
    other = _other_fall(time, height, (sigma, colour), turns, fall, float(impacts[-1].value[0]) if impacts else -np.inf)
    for number, impact in enumerate(impacts, 1):
        if impact.unread is not None:
            text = (
                f"impact {number}: no valid readings from {impact.unread[0]:.6g} to {impact.unread[1]:.6g} s, during "
                "the contact; its times, speeds and restitution are uncertain by that gap"
            )
            warnings.warn(text, UserWarning, stacklevel=3)
    if not impacts:
        by_others = "" if other is None else f", but flights from {other[0]:.4g} s on have {other[1]:.3g} m/s2"
        text = f"no bounce found: no impact between two flights of constant acceleration ({fall:.3g} m/s2{by_others})"
        raise InputError(text).because("" if other is None else TWO_CLOCKS)
    found = _per_impact(impacts, direction)
    found |= _release(time, height, (sigma, colour), turns[0], impacts[0], (fall, u_fall), direction)
    found |= _rest(time, values, motion.speed, motion.u_speed, impacts[0], last_touch)
    found |= with_u("fall_acceleration", (), fall, u_fall, "m/s2", "acceleration of the free fall")
    numbered = variable("impact", np.arange(1, len(impacts) + 1), "1", "number of the impact")
    result = xr.Dataset(
        found, coords={"impact": numbered, "unknown": [*SHAPE, *(f"noise, {name}" for name in TOGETHER)]}
    )
    counts = {
        "samples": len(time),
        "band_solves": motion.n_solves,
        "impact_evaluations": sum(impact.n_evaluations for impact in impacts),
    }
    result.attrs = {"direction": direction, "noise": sigma, "work": json.dumps(counts)}
    if hum is not None:
        result.attrs["hum"] = hum.to_text()
    if other is not None:
        result.attrs["other_fall"] = json.dumps(other)
    return result


class _Motion(NamedTuple):
    """A record as its smoothing spline follows it; the speed counts upwards."""

    n_solves: int
    direction: int
    speed: Floats
    u_speed: Floats
    turns: list[Turn]


def _followed(time: Floats, values: Floats, sigma: float) -> _Motion:
    """Follow a record and find its turns."""
    fit = smooth(time, values, sigma, 2)
    # +1 when upwards is positive: contact forces are far larger than gravity, and push up
    (_, speed, acceleration), (u_level, u_speed, u) = fit.value, fit.u
    excess = np.sign(acceleration) * np.maximum(np.abs(acceleration) - SURE * u, 0.0)
    # the ends of a spline bend by themselves where a record breaks off in a contact
    direction = 1 if float(np.sum(excess[_ENDS:-_ENDS] ** 3)) >= 0.0 else -1
    u_speed = u_of_rate(values, sigma, u_level, (speed, u_speed))
    speed *= direction
    return _Motion(fit.n_solves, direction, speed, u_speed, find_turns(time, speed, u_speed))


def _without_swing(time: Floats, values: Floats, sigma: float, motion: _Motion) -> list[Stretch]:
    """Return where no specimen swings: the rest before the release, and all flights."""
    height = motion.direction * values
    fall, _ = common_fall(time, height, sigma, motion.turns)
    first = motion.turns[0]
    # A hum makes the turn begin while the body still rests: the speed of the impact determines the release.
    lasts = -float(motion.speed[first.descent]) / fall
    ends = first.touch - lasts * np.array([1.0 + _HELD, 1.0 - _HELD])
    held, released = (int(i) for i in np.searchsorted(time, ends))
    begun = first_fall(time, first)
    stretches = [Stretch(slice(0, held), 1), Stretch(slice(released, max(begun.stop, released)), 2)]
    for part in flights_after(time, motion.turns):
        if not _is_flight(*curvature(time[part], height[part], sigma), fall):
            break
        stretches.append(Stretch(part, 2))
    return stretches


def _is_flight(value: float, u: float, fall: float) -> bool:
    """Whether a curvature is that of the fall, and known well enough to say so."""
    return u <= _FALL_TOLERANCE * fall and abs(value - fall) <= max(_FALL_TOLERANCE * fall, 3.0 * u)


def _other_fall(
    time: Floats, height: Floats, noise: tuple[float, Colour], turns: list[Turn], fall: float, last: float
) -> tuple[float, float, float] | None:
    """Find flights after the last impact that was evaluated whose acceleration is constant, but not that of the fall.

    A body that stays in contact swings up as long as down: what lasts twice as long flies.
    """
    found = list[tuple[float, float, float]]()
    for turn, part in zip(turns, flights_after(time, turns), strict=True):
        value, u = curvature(time[part], height[part], *noise)
        is_other = value > SURE * u and abs(value - fall) > max(_FALL_TOLERANCE * fall, SURE * u)
        if turn.touch > last and is_other and time[part][-1] - time[part][0] > 2.0 * turn.duration:
            found.append((turn.touch, value, u))
    return (found[0][0], *min(found, key=lambda one: one[2] / one[1])[1:]) if found else None


def fitted(
    time: Floats,
    height: Floats,
    noise: tuple[float, Colour],
    turns: list[Turn],
    gravity: tuple[float, float],
    prior: ShapePrior,
    floor: Floor | None,
) -> tuple[list[ImpactFit], float]:
    """Fit impact after impact until flights can no longer be distinguished from vibration."""
    sigma, colour = noise
    impacts: list[ImpactFit] = []
    fall, swing = gravity[0], 0.0
    for turn, after in zip(turns, flights_after(time, turns), strict=True):
        if not _is_flight(*curvature(time[after], height[after], sigma, colour), fall):
            return impacts, turn.touch
        if impacts:
            free_from = impacts[-1].value[OUTPUTS.index("liftoff_time")] + 0.1 * turn.duration
        else:
            free_from = time[turn.before + (turn.descent - turn.before) // 3]
        begin = max(free_from, turn.touch - LONGEST_ARC)
        end = min(time[after.stop - 1], turn.liftoff + LONGEST_ARC)
        window = slice(*(int(i) for i in np.searchsorted(time, [begin, end])))
        guess = (turn.touch, turn.liftoff)
        if window.stop - window.start < FEWEST_IN_FLIGHT:
            if impacts:
                return impacts, turn.touch
            raise InputError(f"no bounce found: hardly any reading is near the contact at {turn.touch:.4g} s")
        impacts.append(fit_impact(time[window], height[window], sigma, guess, *gravity, prior, colour, floor, swing))
        if floor is not None:
            incoming, outgoing = impacts[-1].value[2:4].tolist()
            swing = floor.share * (incoming + outgoing) / np.sqrt(2.0)
    return impacts, float(impacts[-1].value[0]) if impacts else np.nan


def _per_impact(impacts: list[ImpactFit], direction: int) -> dict[str, Any]:
    """Collect the fits over the dimension impact."""
    found: dict[str, Any] = {}
    for k, (name, (unit, label)) in enumerate(LABELS.items()):
        measured = [impact.value[k] * (direction if name.endswith("_level") else 1) for impact in impacts]
        found |= with_u(name, "impact", measured, [impact.u[k] for impact in impacts], unit, label)
        if name in _SHARED:
            text = f"standard uncertainty of {label} common to all repeats, from the pulse shape"
            shared = [np.linalg.norm(impact.by_shape[k]) for impact in impacts]
            found[f"shared_u_{name}"] = variable("impact", shared, unit, text)
    # Common are the shape of the pulse and, independent of it, as many deviations of the noise: the symmetric root of
    # the rest of the covariance (quantity, unknown) of each impact.
    common, rows = [], [OUTPUTS.index(name) for name in TOGETHER]
    for impact in impacts:
        by_shape = impact.by_shape[rows]
        left = impact.covariance[np.ix_(rows, rows)] - by_shape @ by_shape.T
        size = np.sqrt(np.maximum(np.diagonal(left), np.finfo(float).tiny))
        values, vectors = np.linalg.eigh(left / np.outer(size, size))
        common.append(np.hstack([by_shape, size[:, None] * ((vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T)]))
    for name, parts in zip(TOGETHER, np.moveaxis(np.array(common), 1, 0), strict=True):
        text = f"change of {LABELS[name][1]} by one deviation of each common unknown"
        found[f"common_{name}"] = variable(("impact", "unknown"), parts, LABELS[name][0], text)
    return found


def _release(
    time: Floats,
    height: Floats,
    noise: tuple[float, Colour],
    turn: Turn,
    impact: ImpactFit,
    gravity: tuple[float, float],
    direction: int,
) -> dict[str, Any]:
    """Release: where the falling arc has no speed. First contact: the first touch."""
    touch, contact = float(impact.value[0]), float(impact.value[4])
    u_touch, u_contact = impact.u[[0, 4]].tolist()

    def fallen(start: int) -> tuple[Floats, Floats]:
        part = slice(start, int(np.searchsorted(time, touch)))
        return arc(time[part], height[part] - contact, *noise, touch, gravity)

    start = turn.before + (turn.descent - turn.before) // 10
    try:
        # The turn may begin while the body still rests; the last third falls for certain and says when the release was.
        (_, speed, rate), _ = fallen(int(np.searchsorted(time, touch - (touch - time[start]) / 3)))
        start = max(start, int(np.searchsorted(time, touch + speed / rate)))
        (level, speed, rate), covariance = fallen(start)
    except np.linalg.LinAlgError as error:
        text = f"the readings of the fall before the first touch at {touch:.6g} s do not determine when it began"
        raise InputError(text) from error
    begin, drop = speed / rate, float(level + 0.5 * speed**2 / rate)
    by_arc, drop_by_arc = np.array([0.0, 1.0, -begin]) / rate, np.array([1.0, begin, -0.5 * begin**2])
    if touch + begin < time[0]:
        text = f"the body was already falling when the record began; its release at {touch + begin:.4g} s is "
        warnings.warn(text + "extrapolated", UserWarning, stacklevel=4)
    u_drop = float(np.hypot(propagated_u(drop_by_arc, covariance), u_contact))
    return (
        with_u("release_time", (), float(touch + begin), float(propagated_u(by_arc, covariance)), "s", "release")
        | with_u("first_contact_time", (), touch, u_touch, "s", "first contact")
        | with_u("contact_level", (), direction * contact, u_contact, "m", "displacement at first touch")
        | with_u("drop_height", (), drop, u_drop, "m", "height of the fall")
    )


def _rest(
    time: Floats, values: Floats, speed: Floats, u_speed: Floats, first: ImpactFit, last_touch: float
) -> dict[str, Any]:
    """Rest: the last time that the speed is above a hundredth of the first impact's."""
    limit = _REST_FRACTION * float(first.value[OUTPUTS.index("incoming_speed")])
    moving = np.flatnonzero(np.abs(speed) > np.maximum(limit, 3.0 * np.minimum(u_speed, limit)))
    last = int(moving.max())
    # The envelope passes the limit somewhere between two extremes of the speed.
    crossings = np.flatnonzero(np.diff(np.signbit(speed[: last + 1])))
    period = 2.0 * float(np.median(np.diff(time[crossings[-5:]]))) if len(crossings) > 2 else 0.0
    is_seen = time[-1] - time[last] > 2.0 * period and last < len(time) - FEWEST_IN_FLIGHT
    rest, u_rest, level, u_level = np.nan, np.nan, np.nan, np.nan
    if is_seen:
        rest, u_rest = float(time[last]), 0.5 * period
        still = values[last + 1 :]
        level, u_level = float(np.mean(still)), float(np.std(still, ddof=1) / np.sqrt(len(still)))
    else:
        warnings.warn("the record ends before the body is at rest", UserWarning, stacklevel=3)
    return (
        with_u("rest_time", (), rest, u_rest, "s", "rest")
        | with_u("rest_level", (), level, u_level, "m", "mean displacement at rest")
        | {"settling_time": variable((), last_touch, "s", "last touch followed by no resolved flight")}
    )
