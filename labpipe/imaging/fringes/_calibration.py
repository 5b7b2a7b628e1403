"""Calibration of the optics of a film from its largest contacts: phase, scale, ellipse, blur, coherence, beams, flat.

Each of them is determined from several frames and then held for all. Left free in every frame they would multiply the
effect of every other error. The alternatives are compared in :mod:`._model_selection`.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from labpipe.imaging.fringes._model_selection import Trial, fit_frames, promised_gains
from labpipe.imaging.fringes._optics_state import View
from labpipe.imaging.fringes._ring_fit import ASSUMED, AXES, LIGHT, OPTICAL, Parameter, RingFit, changed_optics

Properties = tuple[tuple[Parameter, ...], ...]
#: Frames that are used, the best known of the larger contacts first.
_FRAMES = 8
#: Share of the largest gain promised, to first order, from which an alternative is fitted.
_LIKELY = 0.2
#: Properties of the optics that may differ from the stated ones; an ellipse has two parameters.
PROPERTIES = (AXES, (Parameter.SCALE,), (Parameter.PHASE,), *((parameter,) for parameter in OPTICAL))
#: What may explain the frames: an oblique view also changes the scale.
ALTERNATIVES = (*PROPERTIES, (*AXES, Parameter.SCALE), LIGHT)


@dataclass(frozen=True)
class Calibration:
    """Optics that a film shows beyond doubt where they differ from the stated ones.

    ``changes`` of parameters against the stated optics, with their standard uncertainties ``u``;
    ``has_uneven_light``: light falls off differently along x and y; ``doubted_phase`` [rad] is shown by the film where
    the caller's was kept.
    """

    changes: Mapping[Parameter, float] = field(default_factory=dict)
    u: Mapping[Parameter, float] = field(default_factory=dict)
    has_uneven_light: bool = False
    doubted_phase: float = math.nan

    @property
    def is_usual(self) -> bool:
        """Whether all is as it was stated."""
        return not (self.changes or self.has_uneven_light)

    def applied(self, view: View) -> View:
        """Return the view of the stated optics with these."""
        parameters = np.zeros(len(Parameter))
        for parameter, change in self.changes.items():
            parameters[parameter] = change
        parameters[Parameter.PHASE] += view.optics.phase
        light = LIGHT if self.has_uneven_light else ()
        free = tuple(dict.fromkeys((*view.settings.free, *light)))
        assumed = tuple(dict.fromkeys((*ASSUMED, *(p for p in OPTICAL if p in self.changes))))
        settings = replace(view.settings, free=free, assumed=assumed)
        ellipse = float(parameters[Parameter.STRETCH]), float(parameters[Parameter.SHEAR])
        return replace(view, optics=changed_optics(view.optics, parameters), settings=settings, ellipse=ellipse)

    def with_means(self, trial: Trial, parameters: tuple[Parameter, ...], stated: View) -> "Calibration":
        """Return it with what the fits of a trial have in common, in which some parameters were free."""
        changes, u = dict(self.changes), dict(self.u)
        for parameter in parameters:
            mean, u[parameter] = trial.mean(parameter)
            if parameter in (Parameter.SCALE, *OPTICAL):  # counted from the optics of the trial
                mean += changes.get(parameter, 0.0)
            changes[parameter] = mean - stated.optics.phase if parameter is Parameter.PHASE else mean
        return replace(self, changes=changes, u=u)

    def without(self, parameters: tuple[Parameter, ...]) -> "Calibration":
        """Return it with some parameters as stated."""
        changes, u = ({p: value for p, value in one.items() if p not in parameters} for one in (self.changes, self.u))
        return replace(self, changes=changes, u=u)


def calibrate(
    frame_of: Callable[[int], NDArray[np.generic]],
    fits: dict[int, RingFit],
    stated: View,
    known: Calibration,
    properties: Properties,
) -> tuple[Calibration, Trial | None]:
    """Find the optics of a film from its fits, with the fits of some frames with these; ``frame_of`` reads a frame.

    ``stated`` is the view of the stated optics.

    ``known`` is what the fits were made with; ``properties`` are those that may differ from the stated ones. Properties
    that explain the frames better are added one after the other, and those that do not are dropped.
    """
    chosen = _choose(fits)
    images, starts = [frame_of(index) for index in chosen], [fits[index] for index in chosen]

    def attempt(seen: Calibration, *extra: Parameter) -> Trial | None:
        return fit_frames(images, starts, seen.applied(stated), extra)

    def refined(seen: Calibration) -> tuple[Trial | None, Calibration]:
        """Values that suit each other."""
        free = attempt(seen, *seen.changes) if seen.changes else None
        seen = seen if free is None else seen.with_means(free, tuple(seen.changes), stated)
        return attempt(seen), seen

    best, known = refined(known) if chosen else (None, known)
    if best is None:
        return Calibration(), None
    for _ in range(len(PROPERTIES)):  # one property may hide behind another
        gains = promised_gains(images, best, known.applied(stated), ALTERNATIVES)
        least = max(_LIKELY * max(gains), sum(math.log(max(fit.pixels, 2)) for fit in best.fits))
        better: list[tuple[Trial, Calibration]] = []
        for group, gain in zip(ALTERNATIVES, gains, strict=True):
            is_open = any(set(group) <= {*one, Parameter.SCALE} for one in (*properties, (Parameter.PHASE,), LIGHT))
            if gain < least or not is_open:
                continue
            found = replace(known, has_uneven_light=True)
            if group != LIGHT:
                free = attempt(known, *group)
                found = known if free is None else known.with_means(free, group, stated)
            trial = attempt(found)
            # errors of a model are shared by the pixels of a fringe: the squared misfit must lose half of what it was
            if trial is not None and trial.gain_over(best) > 0.0 and 2.0 * trial.excess < best.excess:
                better.append((trial, found))
        if not better:
            break
        before = best
        best, found = max(better, key=lambda one: one[0].gain_over(before, len(one[1].changes)))
        if Parameter.PHASE in found.changes and (Parameter.PHASE,) not in properties:
            # the other properties would make up for a phase that is not the stated one
            return replace(known, doubted_phase=stated.optics.phase + found.changes[Parameter.PHASE]), best
        known = found
    groups = [group for group in PROPERTIES if set(group) <= known.changes.keys()]
    groups.sort(key=lambda group: max(abs(known.changes[p]) / max(known.u.get(p, 0.0), 1e-12) for p in group))
    for group in groups:  # those that are least significant are dropped first
        trial, others = refined(known.without(group))
        if trial is not None and best.gain_over(trial, len(group)) <= 0.0:
            best, known = trial, others
    return known, best


def _choose(fits: dict[int, RingFit]) -> tuple[int, ...]:
    """Frames whose radius is best known among the larger contacts that do not recede: their gap is Hertz's."""
    if not fits:
        return ()
    largest = max(fit.radius for fit in fits.values())
    large = [index for index, fit in fits.items() if fit.radius > 0.5 * largest]
    growing = [index for index in large if index - 1 not in fits or fits[index].radius > 0.999 * fits[index - 1].radius]
    large = growing if len(growing) > 2 else large
    # Contacts that hardly move and are seen from all sides come first.
    large.sort(key=lambda index: (fits[index].deviation(Parameter.RADIUS), index))
    return tuple(sorted(large[:_FRAMES]))
