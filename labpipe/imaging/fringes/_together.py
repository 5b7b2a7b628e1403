"""What was found about the optics of a film one after the other, found again together."""

from collections.abc import Sequence
from dataclasses import replace

from labpipe.imaging.fringes._lens_blur import with_blur
from labpipe.imaging.fringes._ring_parameters import AXES, BEAMS, Parameter
from labpipe.imaging.fringes._trials import SIGNIFICANT, Attempt, Calibration, Trial
from labpipe.imaging.fringes._view import View

#: Things from how many on they are found again together.
_TOGETHER = 2


def what_is_found(known: Calibration) -> tuple[Parameter, ...]:
    """Return the parameters of what was found."""
    return tuple(parameter for group in _groups(known) for parameter in group)


def _groups(known: Calibration) -> list[tuple[Parameter, ...]]:
    """Return what was found, by groups of parameters."""
    groups = (
        ((Parameter.PHASE,), known.phase_shift != 0.0),
        ((Parameter.SCALE,), known.log_scale != 0.0),
        (BEAMS, any(known.harmonics)),
        ((Parameter.TURNED,), known.harmonics[1] != 0.0),
        ((Parameter.SPREAD,), known.spread != 0.0),
        ((Parameter.FOCUS,), known.focus != 0.0),
        (AXES, known.ellipse != (0.0, 0.0)),
    )
    return [group for group, is_found in groups if is_found]


def with_beside(trial: Trial, known: Calibration, beside: Sequence[Parameter], view: View) -> Calibration:
    """Take phase, scale, spread, harmonics and ellipse from a trial that left them free."""
    if Parameter.PHASE in beside:
        phase, u = trial.mean(Parameter.PHASE)
        known = replace(known, phase_shift=phase - view.optics.phase, u_phase_shift=u)
    if Parameter.SCALE in beside:
        change, u = trial.mean(Parameter.SCALE)
        known = replace(known, log_scale=known.log_scale + change, u_log_scale=u)
    if Parameter.SPREAD in beside:
        known = replace(known, spread=max(known.spread + trial.mean(Parameter.SPREAD)[0], 0.0))
    if Parameter.FOCUS in beside:
        known = replace(known, focus=known.focus + trial.mean(Parameter.FOCUS)[0])
    if Parameter.SECOND in beside:
        known = replace(known, harmonics=trial.harmonics)
    if Parameter.STRETCH in beside:
        known = replace(known, ellipse=(trial.mean(Parameter.STRETCH)[0], trial.mean(Parameter.SHEAR)[0]))
    return known


def find_together(attempt: Attempt, axes: Sequence[Parameter], known: Calibration, view: View) -> Calibration:
    """Find again together, and with the blur, what was found one after the other while another stood in for it."""
    found = _groups(known)
    if known.ellipse != (0.0, 0.0) and not known.log_scale:
        found.append((Parameter.SCALE,))
    free = [parameter for group in found for parameter in group]
    if len(found) + bool(known.blur) < _TOGETHER:
        return known
    free, known = _without_vain(attempt, axes, known, free)
    again = with_blur(attempt, (*axes, *free), known) if known.blur else None
    if again is not None:
        known = replace(known, blur=again.blur, disc=again.disc)
    trial = attempt((*axes, *free), known)
    return known if trial is None else with_beside(trial, known, free, view)


def _without_vain(
    attempt: Attempt, axes: Sequence[Parameter], known: Calibration, free: list[Parameter]
) -> tuple[list[Parameter], Calibration]:
    """Leave out harmonics that stood in for what was found after them.

    They count as what may be there, and so does a scale that was offered to an ellipse, where errors of the model or
    nothing but noise are left.
    """
    is_offered = Parameter.SCALE in free and known.log_scale == 0.0
    is_plain = Parameter.SECOND in free and not known.harmonics[1]
    trial = attempt((*axes, *free), known) if is_offered or is_plain else None
    if trial is None:
        return free, known
    if is_plain and all(abs(value) <= SIGNIFICANT * u for value, u in map(trial.mean, BEAMS)):
        free = [p for p in free if p not in BEAMS]
        known = replace(known, harmonics=(0.0, 0.0, 0.0), by_camera=False)
        without = attempt((*axes, *free), known)
        if without is None:
            return free, known
        known, trial = known.with_shared(without, without.changes(trial)), without
    if is_offered and (trial.is_doubtful or trial.is_quiet):
        known = known.with_shared(trial, trial.changes_by_mean(Parameter.SCALE))
    return free, known
