"""What frames tell of their light all together: phase, scale and spread of colours, each beside all others.

One that was found first stands in for others that are found later or not at all. Here all are free at once,
the same in every frame; what is then not told from what was stated is given up, and the rest found again.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from labpipe.arrays import Floats
from labpipe.imaging.fringes._lens_blur import BLUR_ROUNDS, LEAST_BLUR, least_blur, next_gain
from labpipe.imaging.fringes._ring_parameters import ASSUMED, AXES, BEAMS, HARMONICS, WAVES, Parameter
from labpipe.imaging.fringes._trials import FACTOR, FEW_FRAMES, FEW_PIXELS, HINT, Attempt, Calibration, Trial

#: How far each may be from what was stated: a standard uncertainty that keeps what frames do not tell.
_PRIOR, _ANY = {Parameter.SCALE: 0.1, Parameter.SPREAD: 1e-3, Parameter.FLAT: 1e4, Parameter.BLUR: 10.0}, 1.0
#: Standard uncertainties from what was stated up to which it is given up.
_SURE = 4.0
#: What is left beyond differences of neighbours, in amplitudes, from which noise with a memory tells less of the
#: light than the scatter along the rings says, and misfit from which errors of the model stand in for the light.
_ROUGH, _NOTABLE = 0.03, 0.01
#: Flat that is sought from, and the largest one that hides, as shares of the smallest contact.
_FIRST_FLAT, _MOST_FLAT = 0.3, 0.6
#: Travel in the exposure (px) from which it hides all else.
_FAR = 3.5
#: Share of the change of the radius that stays uncertain where a single frame tells of what hid in it.
_ALONE = 0.5
#: Gain of a step (variances), and relative change of the blur, at which all is settled.
_SMALL_GAIN, _SETTLED_BLUR = 0.3, 0.003


@dataclass(frozen=True)
class _Told:
    """What frames tell of quantities that they share: the step to the best ones, and their covariance."""

    trial: Trial
    asked: tuple[Parameter, ...]
    step: Floats
    covariance: Floats
    gain: float
    shifts: Floats

    def deviation(self, parameter: Parameter) -> float:
        """Return the standard uncertainty of a quantity."""
        place = self.asked.index(parameter)
        return math.sqrt(float(self.covariance[place, place]))

    def variance_of_radii(self, asked: Sequence[Parameter]) -> Floats:
        """Return the variances (px²) that some of the quantities give to the radii."""
        rows = [self.asked.index(p) for p in asked]
        shifts = self.shifts[:, rows]
        return np.asarray(np.einsum("fi,ij,fj->f", shifts, self.covariance[np.ix_(rows, rows)], shifts))


def _value(known: Calibration, parameter: Parameter) -> float:
    """Return what is known of a quantity."""
    if parameter in HARMONICS:
        return known.harmonics[HARMONICS.index(parameter)]
    if parameter in AXES:
        return known.ellipse[AXES.index(parameter)]
    shared = {
        Parameter.PHASE: known.phase_shift,
        Parameter.SCALE: known.log_scale,
        Parameter.SPREAD: known.spread,
        Parameter.BLUR: known.blur**2,
        Parameter.FLAT: known.flat**2,
    }
    return shared[parameter]


def _with_values(known: Calibration, values: dict[Parameter, float]) -> Calibration:
    """Return what is known with some quantities replaced."""
    second, turned, third = (values.get(p, _value(known, p)) for p in HARMONICS)
    stretch, shear = (values.get(p, _value(known, p)) for p in AXES)
    phase, scale, spread = (values.get(p, _value(known, p)) for p in WAVES)
    square = values.get(Parameter.BLUR, known.blur**2)
    return replace(
        known,
        blur=math.sqrt(max(square, 0.0)),
        flat=math.sqrt(max(values.get(Parameter.FLAT, known.flat**2), 0.0)),
        phase_shift=phase,
        log_scale=scale,
        spread=max(spread, 0.0),
        harmonics=(second, turned, third),
        ellipse=(stretch, shear),
    )


def _tell(
    attempt: Attempt, axes: Sequence[Parameter], known: Calibration, asked: tuple[Parameter, ...], stated: Calibration
) -> _Told | None:
    """Ask the frames for quantities that they share, by how their squares change with these."""
    trial = attempt(axes, known, asks=asked)
    if trial is None:
        return None
    bend, slope = np.zeros((len(asked), len(asked))), np.zeros(len(asked))
    # what a fit tells of the scale goes with a flat that it scales as well
    turned = np.eye(len(asked))
    if Parameter.FLAT in asked and Parameter.SCALE in asked:
        turned[asked.index(Parameter.SCALE), asked.index(Parameter.FLAT)] = known.flat**2
    for fit in trial.fits:
        # neighbouring pixels that share their noise tell less
        memory = fit.deviation(Parameter.RADIUS) / max(fit.residual * fit.leverage, 1e-12)
        weight = 1.0 / (max(fit.residual, 1e-6) * max(memory, 1.0)) ** 2
        bend += weight * turned @ fit.bend @ turned.T
        slope += weight * turned @ fit.slope
    prior = np.array([_PRIOR.get(p, _ANY) for p in asked]) ** -2.0
    slope -= prior * [_value(known, p) - _value(stated, p) for p in asked]
    covariance: Floats = np.asarray(np.linalg.inv(bend + np.diag(prior)), np.float64)
    step: Floats = covariance @ slope
    shifts = np.array([[fit.sensitivity[p] for p in asked] for fit in trial.fits]) @ turned.T
    return _Told(trial, asked, step, covariance, float(step @ slope), shifts)


def _settled(
    attempt: Attempt, axes: Sequence[Parameter], known: Calibration, asked: tuple[Parameter, ...], stated: Calibration
) -> tuple[_Told | None, Calibration]:
    """Step to what explains the frames best, and to the blur that they show then."""
    before, gain = 0.0, 1.0
    told: _Told | None = None
    nearest: tuple[_Told, Calibration] | None = None
    for _ in range(BLUR_ROUNDS):
        told = _tell(attempt, axes, known, asked, stated)
        if told is None:
            return None, known
        if nearest is None or told.trial.gain_over(nearest[0].trial) > 0.0:
            nearest = told, known
        blur = known.blur
        if blur and Parameter.BLUR not in asked:
            # What else is found with it bends what the frames show: a step may overshoot.
            beyond = least_blur(told.trial, blur)[0] - blur**2
            gain = next_gain(gain, before, beyond)
            before = gain * beyond
            # What seemed a blur may be all spread.
            square = blur**2 + before
            blur = math.sqrt(square) if square > LEAST_BLUR**2 else 0.0
        if told.gain < _SMALL_GAIN and abs(blur - known.blur) <= _SETTLED_BLUR * known.blur:
            break
        steps = zip(told.asked, told.step.tolist(), strict=True)
        known = replace(known, blur=blur)
        values = {p: _value(known, p) + step for p, step in steps}
        if Parameter.FLAT in values:
            smallest = min(float(fit.parameters[Parameter.RADIUS]) for fit in told.trial.fits)
            most = max(known.flat, _MOST_FLAT * smallest)
            values[Parameter.FLAT] = min(values[Parameter.FLAT], most**2)
        known = _with_values(known, values)
    if told and nearest and told.trial.gain_over(nearest[0].trial) < -HINT * _memory(nearest[0].trial):
        return nearest  # later steps went astray
    return told, known


def settle_together(
    attempt: Attempt,
    axes: Sequence[Parameter],
    known: Calibration,
    best: Trial,
    stated: Calibration,
    *,
    is_phase_free: bool,
) -> Calibration:
    """Find all together what was found one after the other, and what hides behind it.

    Parameters
    ----------
    attempt : Attempt
        Fits the frames.
    axes : sequence of Parameter
        What is free in every frame beside the usual.
    known : Calibration
        What was found.
    best : Trial
        The frames with it.
    stated : Calibration
        What is believed of phase, scale and spread without evidence.
    is_phase_free : bool
        Whether the phase may be changed.
    """
    found = [p for p in (*WAVES, Parameter.FLAT) if _value(known, p) != _value(stated, p)]
    beside = AXES if any(known.ellipse) else ()
    if any(known.harmonics):
        beside += (*BEAMS, *((Parameter.TURNED,) if known.harmonics[1] else ()))
    hidden = _hidden(attempt, axes, known, best, stated, (*found, *beside), is_phase_free=is_phase_free)
    light, seen = [*found, *hidden], known
    if not hidden and known.blur and best.is_quiet and Parameter.SPREAD not in found:
        known = seen = _with_band_behind_blur(attempt, axes, known, stated)
    if Parameter.FLAT in hidden:
        # one that is small beside the contact hardly shows how it should change
        seen = replace(seen, flat=_FIRST_FLAT * min(float(fit.parameters[Parameter.RADIUS]) for fit in best.fits))
    if not light and not beside:
        return seen
    is_last = not hidden
    while True:
        told, seen = _settled(attempt, axes, seen, (*light, *beside), stated)
        if told is None:
            return seen
        doubts = _doubts(attempt, (*axes, *light, *beside), seen, told, light)
        beyond = {p: 1.0 if p in found else math.sqrt(_memory(best)) for p in light}
        u = {p: math.hypot(beyond[p] * told.deviation(p), doubts[p]) for p in light}
        sure = {p: abs(_value(seen, p) - _value(stated, p)) / u[p] for p in light}
        if is_last or not light or min(sure.values()) > _SURE:
            kept, gain = set(hidden) & set(light), told.trial.gain_over(best) / (HINT * _memory(best))
            if kept and (gain < 0.0 or told.gain > _SURE):
                # steps went astray or lead nowhere, or the blur stands in for it
                is_last, light, seen = True, list(found), known
                continue
            if gain < -1.0:
                return known
            every = (*dict.fromkeys((*found, *hidden)), *beside)
            rest = _tell(attempt, axes, seen, every, stated) if len(every) > len(told.asked) else None
            is_hinted = rest is not None and rest.gain > HINT * _memory(best)
            if len(best.fits) == 1 and kept:
                # no other frame says whether what hid there is what was found
                seen = seen.with_shared(told.trial, _ALONE * told.trial.changes(best))
            return _with_uncertainty(told, seen, doubts, rest if is_hinted else None)
        # what tells least is given up, and the others are found without it
        least = min(light, key=lambda p: sure[p])
        gone = [p for p in light if p is least or (least is Parameter.SECOND and p is Parameter.THIRD)]
        light = [p for p in light if p not in gone]
        seen = _with_values(seen, {p: _value(stated, p) for p in gone})


def _with_band_behind_blur(
    attempt: Attempt, axes: Sequence[Parameter], known: Calibration, stated: Calibration
) -> Calibration:
    """Count what a band of colours that a blur may hide makes of the scale: its mean wavenumber is not known then."""
    told = _tell(attempt, axes, known, (Parameter.SPREAD, Parameter.BLUR), stated)
    if told is None:
        return known
    spread = math.hypot(max(float(told.step[0]), 0.0), told.deviation(Parameter.SPREAD))
    phase, both, scale = known.covariance
    return replace(known, covariance=(phase, both, scale + spread**2))


def _hidden(
    attempt: Attempt,
    axes: Sequence[Parameter],
    known: Calibration,
    best: Trial,
    stated: Calibration,
    found: tuple[Parameter, ...],
    *,
    is_phase_free: bool,
) -> list[Parameter]:
    """Return what else may hide in the frames, where a look at some of their pixels says that anything does.

    Where errors of the model are seen that it does not explain, or contacts move far in the exposure, it would
    stand in for these.
    """
    # What a film shows beyond the third harmonic looks like a small phase where no lens has blurred it.
    is_cut = any(known.harmonics) and (known.by_camera or not known.blur)
    may_be = [p for p in WAVES if (is_phase_free and not is_cut) or p is not Parameter.PHASE]
    if best.is_quiet:
        may_be += [
            *(() if set(ASSUMED) & set(found) else (Parameter.FLAT,)),
            *(() if any(known.harmonics) else BEAMS),
            *(() if known.blur else (Parameter.BLUR,)),
        ]
    hidden = [p for p in may_be if p not in found]
    if not hidden or _moves_far(best, known):
        return []
    few = partial(attempt, count=FEW_FRAMES, pixels=FEW_PIXELS)
    before = _tell(few, axes, known, (*found, *hidden), stated)
    if before is None or before.gain * best.pixels < HINT * _memory(best) * before.trial.pixels:
        return []
    if best.is_doubtful and best.excess > _NOTABLE**2:
        told, _ = _settled(few, axes, known, (*found, *hidden), stated)
        return [] if told is None or told.trial.excess * FACTOR > before.trial.excess else hidden
    return hidden


def _memory(trial: Trial) -> float:
    """Return the factor of the variances of what frames tell of their light, for noise with a memory."""
    return 1.0 + trial.rough_excess / _ROUGH**2


def _moves_far(trial: Trial, known: Calibration) -> bool:
    """Tell whether contacts move so far in the exposure that how they do hides all else."""
    travels = [math.sqrt(max(float(fit.parameters[Parameter.SMEAR]), 0.0)) for fit in trial.fits]
    return float(np.median(travels)) > max(_FAR, 4.0 * known.blur)


def _doubts(
    attempt: Attempt, free: Sequence[Parameter], known: Calibration, told: _Told, light: Sequence[Parameter]
) -> dict[Parameter, float]:
    """Return what errors of the model make of what frames tell of their light."""
    free = [p for p in free if p is not Parameter.FLAT]
    trial = attempt(free, known) if told.trial.is_doubtful and light else None
    if trial is None:
        return dict.fromkeys(light, 0.0)
    return {p: float(np.mean([fit.doubts.get(p, 0.0) for fit in trial.fits])) for p in light}


def _with_uncertainty(
    told: _Told, known: Calibration, doubts: dict[Parameter, float], hidden: _Told | None
) -> Calibration:
    """Return what is known with what its uncertainty makes of the radii.

    What phase and scale make of them is told for each frame, and goes with these; the rest is shared. So is what
    the frames hint at all together, though none of it beyond doubt.
    """
    rows = {p: told.asked.index(p) for p in ASSUMED if p in told.asked}
    covariance = np.zeros((len(ASSUMED), len(ASSUMED)))
    for i, one in enumerate(ASSUMED):
        for j, other in enumerate(ASSUMED):
            if one in rows and other in rows:
                covariance[i, j] = told.covariance[rows[one], rows[other]]
        covariance[i, i] += doubts.get(one, 0.0) ** 2
    shared = told.variance_of_radii(told.asked) - told.variance_of_radii(tuple(rows))
    # whether a band is even in wavelengths or in wavenumbers is not known
    if Parameter.SCALE not in rows:
        covariance[1, 1] += (0.5 * known.spread) ** 2
    known = replace(known, covariance=tuple(covariance[np.triu_indices(len(ASSUMED))].tolist()))
    known = known.with_shared(told.trial, np.sqrt(np.maximum(shared, 0.0)))
    if hidden is None:
        return known
    own = hidden.variance_of_radii(hidden.asked) - told.variance_of_radii(told.asked)
    changes = hidden.shifts @ hidden.step
    return known.with_shared(told.trial, np.sqrt(np.maximum(changes**2 - own, 0.0)))
