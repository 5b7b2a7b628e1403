"""Find the pattern of a frame's blur: how much softer or sharper the frame is, and of which shape that blur is.

The columns of the least squares lead there by what is left for them. They cannot tell a disc, as a lens out
of focus makes it, from a Gaussian, nor a blur so wide that it turns the contrast of the pattern round from
a wider one: that is found by the residual.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from labpipe.arrays import Floats, Integers
from labpipe.imaging.dic._growth import COMMON, NO_GROWTH, Growth, grown, more_blur, others_like, sizes, wide_blurs
from labpipe.imaging.dic._pattern import Pattern, Patterns
from labpipe.imaging.dic._subset_solver import SOLVED, Solution

#: Patterns that are tried in a frame, and the most misfit of one over that of the first: beyond, the contrast of the
#: pattern has turned round, or noise is taken for one.
_MATCHES, _NO_WORSE = 6, 4.0
#: Misfit over that of the frame before from which the pattern of that frame may be a wrong one, and over that of
#: another pattern from which one is better.
_FAR_WORSE, _BETTER = 2.0, 0.99
#: How much of the change of blur that the first order tells is taken for it, of softer and of sharper frames:
#: these it tells by up to three times, and those that are blurred too much look as if noise had made them soft.
_STRIDES = (1.0, 0.35)
#: Contrast over that of the reference below which a blur may be why most points are lost, and how far (px) from where
#: they were expected a wide blur finds them.
_FADED, _NEAR = 0.6, 1.0
#: Solves the points that tell the blur with a pattern, from motions (point, 6).
Solve = Callable[[Pattern, Floats], Solution]


@dataclass(frozen=True)
class Match:
    """What points tell of a pattern: the blur (3,) [px²] that is left for the columns, and the noise that is seen."""

    pattern: Pattern
    found: Solution
    more: Floats
    misfit: float

    @property
    def motion(self) -> Floats:
        """Motions (point, 6) from which to solve again."""
        return np.where((self.found.code == SOLVED)[:, None], self.found.motion, 0.0)

    @property
    def left(self) -> float:
        """How much blur that is."""
        return float(np.linalg.norm(self.more))


@dataclass
class _Trials:
    """Solves the points that tell the blur with one pattern after the other, and counts the iterations."""

    chosen: Integers
    solve: Solve
    spent: Integers

    def solved(self, pattern: Pattern, start: Floats) -> Match:
        """Solve with a pattern from motions."""
        return self.told(pattern, self.solve(pattern, start))

    def told(self, pattern: Pattern, found: Solution) -> Match:
        """Tell what solving has shown."""
        self.spent += found.iterations
        return Match(pattern, found, more_blur(found), misfit(found, self.chosen, pattern))


class BlurMatcher:
    """Finds the pattern of each frame, from that of the frame before.

    ``patterns``: by growth of the blur; ``min_zncc``: float [1], correlation below which a point is lost.
    """

    def __init__(self, patterns: Patterns, min_zncc: float) -> None:
        self._patterns = patterns
        self._min_zncc = min_zncc
        self._strides = list(_STRIDES)
        self._shape, self._weighed = 0, np.zeros(2)
        #: Misfit of the frame before.
        self.misfit = np.inf

    def is_lost(self, found: Solution) -> bool:
        """Whether most points are not found."""
        return bool(((found.code == SOLVED) & (found.zncc >= self._min_zncc)).mean() < COMMON)

    def is_faded(self, found: Solution) -> bool:
        """Whether most points are not found where the contrast is so low that a wide blur may be why."""
        return self.is_lost(found) and is_faint(found)

    def wide(self, chosen: Integers, start: Floats, solve: Solve) -> Match | None:
        """Find the wide blur that fits best where most points are found near their start, if there is one."""
        trials = _Trials(chosen, solve, np.zeros(len(chosen), np.int64))
        tried = [trials.solved(self._patterns.of(growth), start) for growth in wide_blurs()]
        near = [
            one
            for one in tried
            if not self.is_lost(one.found) and np.median(np.hypot(*(one.found.motion - start)[:, [0, 3]].T)) < _NEAR
        ]
        return min(near, key=lambda one: one.misfit, default=None)

    def match(self, first: Solution, pattern: Pattern, chosen: Integers, start: Floats, solve: Solve) -> Match:
        """Find the pattern that fits best.

        ``first``: of the chosen points with the pattern of the frame before, ``pattern``; ``chosen``: integer
        (point,), points that tell the blur, among all; ``start``: (point, 6) [px], motions; ``solve``: solves
        them again; the iterations of all are those of the match.
        """
        trials = _Trials(chosen, solve, np.zeros(len(chosen), np.int64))
        best = trials.told(pattern, first)
        if pattern.growth != NO_GROWTH and not best.more.any() and best.misfit > _FAR_WORSE * self.misfit:
            # A pattern that is far too soft takes what is sharper for its noise.
            best = trials.solved(self._patterns.of(NO_GROWTH), start)
        best = self._approach(trials, best)
        others = others_like(best.pattern.growth, self._weighed)
        if others:
            self._weighed = np.maximum(sizes(best.pattern.growth), self._weighed)
        for growths in others:
            best = self._better(trials, best, growths)
        if best.pattern.growth != NO_GROWTH:
            self._shape = best.pattern.growth[3]
        best.found.iterations[:] = trials.spent
        return best

    def _better(self, trials: _Trials, best: Match, growths: list[Growth]) -> Match:
        """Compare what fits best so far with other growths of a shape."""
        tried = [trials.solved(self._patterns.of(growth), best.motion) for growth in growths]
        other = min(tried, key=lambda one: one.misfit)
        if other.misfit < best.misfit:
            other = self._approach(trials, other)
        return other if other.misfit < _BETTER * best.misfit else best

    def _approach(self, trials: _Trials, first: Match) -> Match:
        """Let the blur of the pattern grow by what is left, until nothing is."""
        best = at = first
        more, side = first.more, int(first.more[0] < 0.0)
        for _ in range(_MATCHES):
            growth = grown(at.pattern.growth, self._strides[side] * more, self._shape)
            if growth == at.pattern.growth or not more.any():
                break
            found = trials.solved(self._patterns.of(growth), best.motion)
            if found.misfit > _NO_WORSE * first.misfit:
                at, more = best, 0.5 * more
                continue
            # by how much the step was too long or too short, as that of a secant
            change = float(np.clip(1.0 - found.more @ more / (more @ more), 0.5, 3.0)) if found.more.any() else 1.0
            self._strides[side] = min(self._strides[side] / change, 2.0 * _STRIDES[side])
            at, more = found, found.more
            best = found if found.left < best.left else best
        return best


def misfit(found: Solution, chosen: Integers, pattern: Pattern) -> float:
    """Median over the points of the noise that the residual shows; infinite without an answer."""
    solved = np.flatnonzero(found.code == SOLVED)
    if not len(solved):
        return np.inf
    seen = pattern.seen(chosen[solved], found.gain[solved], found.change[solved, 2:])
    return float(np.median(found.residual[solved] / seen))


def is_faint(found: Solution) -> bool:
    """Whether the contrast is so low that a wide blur may be why."""
    contrast = 1.0 / np.where(found.zncc > 0.0, found.gain * found.zncc, 1.0)
    return bool(np.median(contrast) < _FADED)
