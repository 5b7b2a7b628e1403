"""A flat worn into the sphere, found where a whole sphere does not explain a film's contacts."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from labpipe.arrays import Floats
from labpipe.imaging.fringes._ring_parameters import ASSUMED, AXES, Parameter
from labpipe.imaging.fringes._together import what_is_found, with_beside
from labpipe.imaging.fringes._trials import ALL_PIXELS, HALF, HINT, Attempt, Calibration, Trial, doubt
from labpipe.imaging.fringes._view import View

#: Fourth powers of a flat over those of the smallest contact that are tried, until one leaves so much more than
#: another; frames and pixels for that, and variances by which one must lower the sum of squares.
_QUARTICS, _WORSE = (0.05, 0.1, 0.19, 0.32, 0.46, 0.6, 0.73, 0.86), 1.2
_FLAT_FRAMES, _FLAT_PIXELS, _FLAT_VARIANCES = 4, 12_000, 40.0
#: Vertices of parabolas by which some pixels search the best between flats, and the share of the width between these to
#: which they tell it; the step of the parabola from there, and the step of the one by all pixels, in uncertainties by
#: some; the largest of the fourth power; and the part of a step within which the flat is settled.
_VERTICES, _ROUGH, _STEP, _NARROWER, _LARGEST, _SETTLED = 5, 0.05, 0.1, 2.0, 0.5, 0.9
#: Change of the phase (rad) that a flat may seem to be.
_FLAT_PHASE = 0.15


def _disagreement(smaller: Trial, middle: Trial, larger: Trial, unit: float) -> float:
    """Mean square by which flats of single frames differ from that of all, over that of noise; 1 or more.

    A flat is the same in all contacts; another error of the sphere's form looks like one of another size in each.
    """
    before, now, after = (trial.left_of_each for trial in (smaller, middle, larger))
    bends = np.maximum(before + after - 2.0 * now, 1e-9)
    places = 0.5 * (before - after) / bends  # in steps from the middle
    mean = np.average(places, weights=bends)
    return max(float((bends * (places - mean) ** 2).sum()) / unit / max(len(bends) - 1, 1), 1.0)


def find_flat(
    attempt: Attempt, axes: Sequence[Parameter], known: Calibration, best: Trial
) -> tuple[Trial, Calibration] | None:
    """Flat that leaves least in all frames, when it explains them better than a whole sphere."""
    if known.flat or not best.is_doubtful:
        return None
    found = _found_flat(attempt, axes, known, best, 0.0)
    return found if found is not None and found[0].is_better_than(best) else None


def find_small_flat(
    attempt: Attempt, axes: Sequence[Parameter], known: Calibration, best: Trial
) -> tuple[Trial, Calibration]:
    """Flat that hides below what is seen of errors of the model, as phase and scale feel it, with all else known.

    It is felt in noise without a memory, and explains more than a scale does.
    """
    if known.flat or best.is_doubtful or not (best.is_quiet and best.expected_gain(ASSUMED) > HINT):
        return best, known
    found = _found_flat(attempt, axes, known, best, HINT)
    # what is no flat is felt beside one as well
    return (best, known) if found is None or found[0].may_gain(ASSUMED) else found


def _found_flat(
    attempt: Attempt, axes: Sequence[Parameter], known: Calibration, best: Trial, beyond: float
) -> tuple[Trial, Calibration] | None:
    """Best flat, where it explains the frames by more than another scale does, ``beyond`` so many variances."""
    found = _best_flat(attempt, axes, known, best, math.inf)
    if found is None or found[1].gain_over(best) < _FLAT_VARIANCES:
        return None
    # a wrong wavelength or ruler is commoner than wear, and moves rings nearly alike, as much in all frames
    least = found[1].gain_over(best) - beyond
    scaled = attempt((*axes, Parameter.SCALE), known, pixels=ALL_PIXELS)
    if scaled is not None and scaled.gain_over(best) >= least:
        scale = known.log_scale + scaled.mean(Parameter.SCALE)[0]
        common = attempt(axes, replace(known, log_scale=scale), pixels=ALL_PIXELS)
        if common is not None and common.gain_over(best) >= least:
            return None
    return _settled_flat(attempt, axes, known, *found)


def weigh_flat(
    attempt: Attempt, axes: Sequence[Parameter], known: Calibration, best: Trial, log_stated: float, *, is_stated: bool
) -> tuple[Trial, Calibration]:
    """Lay narrower fringes than stated, or a phase near the stated one, to these or to a flat, as the frames tell.

    In contacts of one radius either explains them nearly as well: what is likelier is taken, and the other counts
    as what may be wrong. ``log_stated`` is the logarithm of the scale as stated, relative to that of the view;
    ``is_stated`` tells whether the phase of the view is the stated one.
    """
    is_turned = is_stated and 0.0 < abs(known.phase_shift) < _FLAT_PHASE
    if known.flat or not (known.log_scale > log_stated or is_turned):
        return best, known
    few = attempt(axes, known, _FLAT_FRAMES, _FLAT_PIXELS)
    stated = replace(known, log_scale=log_stated, u_log_scale=0.0)
    if is_turned:
        stated = replace(stated, phase_shift=0.0, u_phase_shift=0.0)
    near = None if few is None else _best_flat(attempt, axes, stated, best, (few.left + HINT) / few.pixels)
    found = None if near is None else _settled_flat(attempt, axes, stated, *near)
    if found is None:
        return best, known
    trial, worn = found
    gain = trial.gain_over(best)
    changes = trial.changes(best) * math.sqrt(doubt(gain))
    return (trial, worn.with_shared(trial, changes)) if gain > 0.0 else (best, known.with_shared(best, changes))


def find_flat_together(attempt: Attempt, axes: Sequence[Parameter], known: Calibration, view: View) -> Calibration:
    """Find a flat again together with what was found beside it, which may have stood in for a part of it."""
    beside = what_is_found(known)
    free = (*axes, *beside)
    best = attempt(free, known) if known.flat and set(beside) - set(AXES) else None
    near = None if best is None else _best_flat(attempt, free, replace(known, flat=0.0), best, math.inf)
    found = None if near is None else _settled_flat(attempt, free, known, *near)
    return known if found is None else with_beside(*found, beside, view)


def _best_flat(
    attempt: Attempt, axes: Sequence[Parameter], known: Calibration, best: Trial, most: float
) -> tuple[float, Trial, float, float] | None:
    """Flat that leaves least on some pixels, its trial on all, a step (px) from it, and how far it may be off.

    None where it leaves more than ``most``, in variances of a pixel.
    """

    def left(flat: float) -> float:
        trial = attempt(axes, replace(known, flat=flat), _FLAT_FRAMES, _FLAT_PIXELS)
        return math.inf if trial is None else trial.left / trial.pixels

    def is_vain() -> bool:
        return not (tried[0.0] - tried[flat]) * best.pixels >= HALF * _FLAT_VARIANCES

    # where nothing but noise is left that grows by what chance does not make
    by_chance = math.inf if best.is_doubtful else HINT / (_FLAT_PIXELS * min(len(best.fits), _FLAT_FRAMES))
    tried = {0.0: left(0.0)}
    for count, flat in enumerate(flats_beside(best)):
        tried[flat] = left(flat)
        least = min(tried.values())
        if count and tried[flat] > min(_WORSE * least, least + by_chance):
            break
    flat = min(tried, key=tried.__getitem__)
    low = max((size for size in tried if size < flat), default=0.0)
    high = min((size for size in tried if size > flat), default=flat)
    width = high - low
    for _ in range(_VERTICES):
        vertex = float(np.clip(_vertex_about(tried, flat), low, high))
        if not abs(vertex - flat) > _ROUGH * width:
            break
        tried[vertex] = left(vertex)
        flat = min(tried, key=tried.__getitem__)
        if is_vain():
            break
    if is_vain():
        return None
    # how well some pixels place it
    few = partial(attempt, count=_FLAT_FRAMES, pixels=_FLAT_PIXELS)
    rough = few(axes, replace(known, flat=flat))
    placed = None if rough is None else _placed(few, axes, known, flat, rough, _STEP * width)
    if placed is None or not placed.trial.left < most * placed.trial.pixels:
        return None
    trial = attempt(axes, replace(known, flat=placed.flat), pixels=ALL_PIXELS)
    if trial is None:
        return None
    return placed.flat, trial, min(_STEP * width, _NARROWER * placed.u_flat), width


def flats_beside(best: Trial) -> list[float]:
    """Return flats (px) that may lie in the contacts of a trial; in steps of a pixel, so that they stay the same."""
    smallest = round(min(float(fit.parameters[Parameter.RADIUS]) for fit in best.fits))
    return [max(smallest, 1) * share**0.25 for share in _QUARTICS]


def _vertex_about(left: dict[float, float], flat: float) -> float:
    """Vertex of a parabola through what a flat and those beside it leave; the flat where there is none.

    The gap changes with the fourth power of a small flat: the square is another radius.
    """
    sizes = sorted(left)
    first = min(max(sizes.index(flat) - 1, 0), len(sizes) - 3)
    near = np.array(sizes[first : first + 3])
    values = np.array([left[size] for size in near.tolist()])
    if not np.isfinite(values).all():
        return flat
    bend, slope, _ = np.polyfit((near / near[1]) ** 4, values, 2)
    return float(near[1]) * max(-0.5 * float(slope / bend), 0.0) ** 0.25 if bend > 0.0 else flat


@dataclass(frozen=True)
class _Placed:
    """A flat (px) with its uncertainty, the trial there, and how the radii change with it."""

    flat: float
    u_flat: float
    trial: Trial
    slopes: Floats


def _placed(
    attempt: Attempt, axes: Sequence[Parameter], known: Calibration, flat: float, middle: Trial, step: float
) -> _Placed | None:
    """Place the minimum by the vertex of a parabola through what a flat leaves and others a step (px) from it."""
    # a parabola of the fourth power, with which the gap changes
    quartic, slope = flat**4, 4.0 * flat**3
    width = min(slope * step, _LARGEST * quartic)
    sizes = (quartic - width) ** 0.25, (quartic + width) ** 0.25
    smaller, larger = (attempt(axes, replace(known, flat=size)) for size in sizes)
    if smaller is None or larger is None:
        return None
    bend = max((smaller.left + larger.left - 2.0 * middle.left) / width**2, 1e-9 / slope**2)
    vertex = quartic + float(np.clip((smaller.left - larger.left) / (2.0 * width * bend), -width, width))
    flat = vertex**0.25
    trial = attempt(axes, replace(known, flat=flat)) or middle
    least = 2.0 * max(trial.left / trial.pixels, 1.0) / bend
    u_flat = math.sqrt(least * _disagreement(smaller, middle, larger, least * bend)) / slope
    return _Placed(flat, u_flat, trial, larger.changes(smaller) / (sizes[1] - sizes[0]))


def _settled_flat(
    attempt: Attempt,
    axes: Sequence[Parameter],
    known: Calibration,
    flat: float,
    trial: Trial,
    step: float,
    width: float,
) -> tuple[Trial, Calibration] | None:
    """Place the minimum by all pixels of all frames, and tell what its uncertainty makes of the radius."""
    place = partial(_placed, partial(attempt, pixels=ALL_PIXELS), axes, known)
    placed = place(flat, trial, step)
    for _ in range(_VERTICES):
        if placed is None or abs(placed.flat - flat) < _SETTLED * step:
            break
        flat = placed.flat
        placed = place(flat, placed.trial, step)
    if placed is None:
        return None
    found = replace(known, flat=placed.flat)
    told = attempt(axes, found)
    changes = placed.slopes * min(placed.u_flat, width)
    return None if told is None else (told, found.with_shared(told, changes))
