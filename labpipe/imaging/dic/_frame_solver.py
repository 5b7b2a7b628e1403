"""What the subsets of a frame are solved with: the pattern of its blur, and the model that each point needs."""

from collections.abc import Callable

import numpy as np

from labpipe.arrays import Flags, Floats, Floats32, Integers
from labpipe.imaging.dic._attempt import Attempt, Options, Work
from labpipe.imaging.dic._blur_match import BlurMatcher, is_faint, misfit
from labpipe.imaging.dic._film_window import Loaded
from labpipe.imaging.dic._growth import CHANCE, COMMON, NO_GROWTH, Growth, more_blur
from labpipe.imaging.dic._inputs import LEAST_SUBSET
from labpipe.imaging.dic._misfit import StillNoise
from labpipe.imaging.dic._misfit_spread import misfit_spread
from labpipe.imaging.dic._motion_uncertainty import one_way
from labpipe.imaging.dic._pattern import Pattern, quickly_changing
from labpipe.imaging.dic._reference import Reference
from labpipe.imaging.dic._subset_kernel import AFFINE, BLUR, CURVE, HIDDEN, LIGHT
from labpipe.imaging.dic._subset_solver import SOLVED, Solution, empty_solution, put, solve
from labpipe.imaging.dic._subsets import Subsets

#: Points that are tested in a frame for what they need beside the motion: at least so many, and
#: each once in so many frames.
_TESTED, _TURNS = 8, 8
#: Rounds in which what a point needs is added to its model, and share of a residual that may be noise alone
#: which is left at most where that was light or blur.
_ROUNDS, _EXPLAINED = 3, 0.7
#: Distance (px) from its start from which a subset sees another part of what stands before it.
_ELSEWHERE = 0.75
#: Residual of noise alone over the least that a point has shown, at most.
_LEAST = 1.3
#: Variance of noise over what of it changes from pixel to pixel, at most: noise with a memory does less so.
_MEMORY = 4.0
#: Correlation below which a subset misfits by more than its edges do.
_ALIKE = 0.95
#: Share of the trusted points of a frame above which it is no chance that they misfit.
_MISFITS = 0.05
#: Points that tell the blur of a frame.
_TELLING = 24
#: Solves subsets, numbers of them, from motions; the last are their places among all that are asked for.
Solved = Callable[[Subsets, Integers, Floats, Integers], Solution]


class FrameSolver:
    """Solves subsets of a frame, and remembers what they needed in the frame before.

    Parameters
    ----------
    reference : Reference
        What to look for.
    options : Options
        Settings.
    """

    def __init__(self, reference: Reference, options: Options) -> None:
        count = len(reference.subsets)
        self.reference = reference
        self._options = options
        self._model = np.zeros(count, np.int64)
        # noise that is blurred enough is like any other
        self._adapt = options.adapt[reference.usable] & np.where(reference.is_faint, AFFINE, ~0)
        self._most_misfit = reference.noise.most_misfit(reference.subsets)
        self._stride = int(np.clip(count // _TESTED, 1, _TURNS))
        self._turn = 0
        self._standing = options.standing
        #: Pixels that count of points that are tried without the others.
        self.found: dict[int, Flags] = {}
        self._pattern = reference.pattern
        self._matcher = BlurMatcher(reference.patterns, options.min_zncc)
        #: Least residual of each point so far, as noise of its pixels: what is more is no noise alone.
        self._least = (
            _MEMORY * (1.0 + reference.noise.static_frames) * quickly_changing(reference.mean, reference.subsets)
        )
        self._still = StillNoise(reference)
        self._softened: tuple[Loaded, Pattern, Floats32] | None = None
        self._is_edge = one_way(reference.subsets)
        #: Whether the frame at hand is one of those averaged into the reference.
        self.is_static = False
        self.work = Work()

    def solve(self, loaded: Loaded, chosen: Integers, start: Floats) -> Solution:
        """Solve subsets with the model that each needed last, again where it needs another one.

        What a point needed in the frame before is tried at once, so that a lasting change is not
        found out in every frame. The others are tested for what they need in turn, and all of
        them when the test of some shows that it concerns more than chance.
        """
        models = self._model[chosen]
        self._turn += 1
        is_tested = (models > 0) | ((chosen + self._turn) % self._stride == 0)
        if is_tested.sum() < _TESTED:
            is_tested[:] = True
        is_tested &= self._adapt[chosen] > 0
        found = self._solve(loaded, chosen, start, models, is_tested)
        if not (found.needed.any() or models.any()):
            return found
        # The mean of the static frames shares their noise, which would be taken for a change of blur.
        adapt = self._adapt[chosen] & (~BLUR if self.is_static else ~0)
        # Where there is hardly a pattern, the columns of light and blur would take noise for a change.
        is_plain = found.residual < self._most_misfit[chosen]
        is_lacking = (found.needed & ~models & adapt) > 0
        is_common = is_lacking.sum() > COMMON * is_tested.sum()
        is_common |= (is_lacking & (is_plain | ((found.needed & AFFINE) > 0))).sum() > CHANCE * is_tested.sum()
        if is_common and not is_tested.all():
            others = np.flatnonzero(~is_tested & (found.code == SOLVED) & (self._adapt[chosen] > 0))
            retried = self._solve_tested(loaded, chosen[others], found.motion[others], models[others])
            found.iterations[others] += retried.iterations
            put(found, others, retried, slice(None))
        # Light, focus and exposure change in the whole frame: then it is no noise, of which they explain little.
        common = 0
        if len(chosen) >= _TESTED:
            groups = LIGHT | CURVE, BLUR
            common = sum(group for group in groups if ((found.needed & group) > 0).mean() > COMMON)
        # Something that hides a part of a few points looks like light that curves there, and so does a wide blur.
        if common & CURVE and is_faint(found):
            common &= ~CURVE
        adapt &= common | ~CURVE
        adapt = np.where(is_plain, adapt, adapt & (AFFINE | np.where(self._is_edge[chosen], 0, common)))
        most = np.where(is_plain, np.inf, _EXPLAINED * found.residual)
        self._add(loaded, chosen, found, found.needed & ~models & adapt, most, adapt)
        if common & CURVE and ((found.needed & CURVE) > 0).mean() > CHANCE:
            # That light curves hides that it slopes, and loses points.
            lost = np.flatnonzero(~(found.zncc >= self._options.min_zncc))
            found.motion[lost], found.zncc[lost], most[lost] = start[lost], 0.0, np.inf
            adapt[lost] = self._adapt[chosen[lost]]
            self._model[chosen[lost]] |= (LIGHT | CURVE) & adapt[lost]
            self._add(loaded, chosen, found, (LIGHT | CURVE) & ~found.model & adapt, most, adapt)
        # Noise hides a change of blur in some of the points only, or in most.
        hidden = BLUR if len(chosen) >= _TESTED and ((found.needed & BLUR) > 0).mean() > self._few else 0
        self._add(loaded, chosen, found, hidden & ~found.model & adapt, most, adapt)
        self._without_spare(loaded, chosen, found, found.model & ~models & ~found.needed & ~hidden)
        return found

    def _add(
        self, loaded: Loaded, chosen: Integers, found: Solution, lacking: Integers, most: Floats, adapt: Integers
    ) -> None:
        """Add what points lack to their models while they lack something; ``most`` is the largest residual."""
        for _ in range(_ROUNDS):
            if not lacking.any():
                break
            again = np.flatnonzero(lacking)
            # A stretch looks like a change of light and blur as well.
            added = np.where(lacking[again] & AFFINE, AFFINE, lacking[again])
            better = self._solve_tested(loaded, chosen[again], found.motion[again], found.model[again] | added)
            is_solved = (better.code == SOLVED) & (better.zncc >= found.zncc[again])
            is_solved &= (better.residual < most[again]) | (added == AFFINE)
            found.iterations[again] += better.iterations
            put(found, again[is_solved], better, is_solved)
            lacking = found.needed & ~found.model & adapt
            lacking[again[~is_solved]] = 0

    def _without_spare(self, loaded: Loaded, chosen: Integers, found: Solution, spare: Integers) -> None:
        """Solve again without what was taken for needed while something like it was not solved for."""
        again = np.flatnonzero((spare > 0) & (found.model != spare) & (found.code == SOLVED))
        if len(again):
            models = found.model[again] & ~spare[again]
            better = self._solve_tested(loaded, chosen[again], found.motion[again], models)
            is_solved = (better.code == SOLVED) & (better.needed & spare[again] == 0)
            found.iterations[again] += better.iterations
            put(found, again[is_solved], better, is_solved)

    def _solve_tested(self, loaded: Loaded, chosen: Integers, start: Floats, models: Integers) -> Solution:
        return self._solve(loaded, chosen, start, models, np.ones(len(chosen), bool))

    def _solve(self, loaded: Loaded, chosen: Integers, start: Floats, models: Integers, is_tested: Flags) -> Solution:
        """Solve subsets with given models and count the work."""
        coefficients = self.coefficients(loaded)
        most = self._least[chosen] * (_LEAST / self._pattern.shown.colour)
        result = empty_solution(len(chosen))
        for model in np.unique(models):
            part = np.flatnonzero(models == model)

            def solved(
                subsets: Subsets, which: Integers, begin: Floats, own: Integers, model: int = int(model)
            ) -> Solution:
                """Solve subsets from motions; ``own`` are their places among all."""
                return solve(
                    subsets,
                    coefficients,
                    self._options.order,
                    which,
                    begin,
                    origin=(loaded.box[0], loaded.box[2]),
                    window=loaded.window,
                    model=model,
                    is_tested=is_tested[own],
                    noise=self._pattern.shown,
                    most=most[own],
                    tolerance=self._options.tolerance,
                    max_iterations=self._options.max_iterations,
                )

            if self.sees_all:
                found = solved(*self._pattern.of(chosen[part]), start[part], part)
            else:
                found = self._solve_seen(chosen, start, part, solved)
            if len(part) == len(chosen):
                result = found
                break
            put(result, part, found, slice(None))
            result.iterations[part] = found.iterations
        self.work.subsets_solved += len(chosen)
        self.work.iterations += int(result.iterations.sum())
        return result

    def _solve_seen(self, chosen: Integers, start: Floats, part: Integers, solved: Solved) -> Solution:
        """Solve a part of the chosen points with what is seen of them where they are found.

        That follows from where they start, and again from where they were found when that is elsewhere.
        """
        result, begin, waiting = empty_solution(len(part)), start[part], np.arange(len(part))
        for _ in range(2):
            points, own = chosen[part[waiting]], part[waiting]
            seen = self.seen(points, begin[waiting])
            found = empty_solution(len(waiting))
            whole, some = (np.flatnonzero([(left is None) == is_whole for left in seen]) for is_whole in (True, False))
            parts = [(whole, solved(*self._pattern.of(points[whole]), begin[waiting[whole]], own[whole]))]
            if len(some):
                cut = self._pattern.cut(points[some], [left for left in seen if left is not None])
                partly = solved(cut, np.arange(len(some)), begin[waiting[some]], own[some])
                partly.code[cut.level[:, 2] < LEAST_SUBSET**2] = HIDDEN
                parts.append((some, partly))
            for where, answers in parts:
                put(found, where, answers, slice(None))
                found.iterations[where] = answers.iterations
            put(result, waiting, found, slice(None))
            result.iterations[waiting] += found.iterations
            apart = np.hypot(*(found.motion - begin[waiting])[:, [0, 3]].T)
            begin[waiting] = found.motion
            waiting = waiting[(apart > _ELSEWHERE) & (found.code == SOLVED) & (self.touched(points, found.motion))]
            if not len(waiting):
                break
        return result

    def seen(self, chosen: Integers, motion: Floats) -> list[Flags | None]:
        """Pixels of chosen points on which the specimen is seen where they have moved; None where all are."""
        result: list[Flags | None] = [None] * len(chosen)
        layout = self.reference.subsets.layout
        for k in np.flatnonzero(self.touched(chosen, motion)).tolist():
            x, y, half = layout[chosen[k], :3].tolist()
            left = self.found.get(int(chosen[k]), np.ones((2 * half + 1, 2 * half + 1), bool))
            if self._standing is not None:
                left = left & self._standing.left(x, y, half, motion[k])
            result[k] = None if left.all() else left
        return result

    @property
    def sees_all(self) -> bool:
        """Whether nothing is known to stand before the specimen in the frame at hand."""
        return self._standing is None and not self.found

    def touched(self, chosen: Integers, motion: Floats) -> Flags:
        """Which of chosen points something may hide in part where they have moved."""
        found = np.isin(chosen, list(self.found))
        if self._standing is not None:
            x, y, half = self.reference.subsets.layout[chosen, :3].T
            found |= self._standing.touches(x, y, half, motion)
        return found

    def coefficients(self, loaded: Loaded) -> Floats32:
        """Spline coefficients of a frame, blurred where it is sharper than the reference."""
        assert loaded.coefficients is not None  # noqa: S101 - frames with NaN are skipped before
        if self._pattern.kernel is None:
            return loaded.coefficients
        if self._softened is None or self._softened[0] is not loaded or self._softened[1] is not self._pattern:
            self._softened = loaded, self._pattern, self._pattern.blurred(loaded.coefficients)
        return self._softened[2]

    @property
    def _few(self) -> float:
        """Share of the points that need a change of blur from which it is no chance, and all do."""
        return CHANCE if self.growth == NO_GROWTH else COMMON

    def use(self, growth: Growth) -> None:
        """Match with the pattern of a growth of the blur, of a frame that moves."""
        self._pattern, self.is_static = self.reference.patterns.of(growth), False

    @property
    def pattern(self) -> Pattern:
        """What the frame at hand is matched with."""
        return self._pattern

    @property
    def growth(self) -> Growth:
        """Growth of the blur of the frame at hand, see :class:`.Pattern`."""
        return self._pattern.growth

    def solve_all(self, loaded: Loaded, chosen: Integers, start: Floats) -> Solution:
        """Solve all tracked points, with the pattern of the frame's blur, which some of them tell."""
        telling = self._adapt[chosen] & (0 if self.is_static else BLUR) > 0
        models = self._model[chosen]
        if not telling.any() or (self.growth == NO_GROWTH and not (models & BLUR).any()):
            found = self.solve(loaded, chosen, start)
            if not telling.any() or not (more_blur(found).any() or self._matcher.is_faded(found)):
                return found
            spent, models = found.iterations, found.model
            start = np.where((found.code == SOLVED)[:, None], found.motion, start)
        else:
            spent = np.zeros(len(chosen), np.int64)
        places = np.flatnonzero(telling)
        some = places[:: max(len(places) // _TELLING, 1)]
        answers, needs_it = self._match(loaded, chosen[some], start[some], models[some] | BLUR)
        is_solved = answers.code == SOLVED
        start = start.copy()
        start[some[is_solved]] = answers.motion[is_solved]
        spent[some] += answers.iterations
        self._model[chosen] = np.where(telling & needs_it, self._model[chosen] | BLUR, self._model[chosen] & ~BLUR)
        found = self.solve(loaded, chosen, start)
        found.iterations[:] += spent
        self._matcher.misfit = misfit(found, chosen, self._pattern)
        return found

    def _match(self, loaded: Loaded, chosen: Integers, start: Floats, models: Integers) -> tuple[Solution, bool]:
        """Find the pattern that leaves the least change of blur, and whether it must be solved for still."""

        def solved(pattern: Pattern, begin: Floats) -> Solution:
            self._pattern = pattern
            return self._solve_tested(loaded, chosen, begin, models)

        before, found = self._pattern, solved(self._pattern, start)
        if self._matcher.is_lost(found):
            wide = self._matcher.wide(chosen, start, solved) if self._matcher.is_faded(found) else None
            self._pattern, found = (wide.pattern, wide.found) if wide else (before, found)
            if wide is None:
                # After a jump most are in a wrong place, and what they show there is no blur.
                return found, bool((self._model[chosen] & BLUR).any())
        match = self._matcher.match(found, self._pattern, chosen, start, solved)
        self._pattern = match.pattern
        return match.found, bool(((match.found.needed & BLUR) > 0).mean() > self._few)

    def remember(self, attempt: Attempt) -> None:
        """Keep what the trusted points of a frame needed, and what they showed of their noise."""
        self.reference.patterns.used.add(self.growth)
        needed = attempt.needed & attempt.model
        self._model = np.where(attempt.trusted, needed, self._model)
        if not self.is_static:
            shown = _shown(attempt.residual, attempt.gain, self._pattern)
            self._least = np.where(attempt.trusted, np.fmin(self._least, shown), self._least)

    def misfit_spread(self, loaded: Loaded, attempt: Attempt) -> Floats:
        """Tell how far what is no noise moves the trusted points of a frame, see :func:`.misfit_spread`."""
        result = np.full((len(attempt.trusted), 3), np.nan)
        if self.is_static:
            self._still.see(np.where(attempt.trusted, attempt.residual, np.nan))
            return result
        shown = attempt.residual / self._pattern.seen_at(attempt.gain)
        is_misfit = (shown > self._still.most) | ((shown < self._still.sharp) & (shown > self._still.least))
        chosen = np.flatnonzero(attempt.trusted & is_misfit & (attempt.zncc > _ALIKE))
        if len(chosen) <= _MISFITS * np.count_nonzero(attempt.trusted):
            return result
        if not self.sees_all:
            chosen = chosen[~self.touched(chosen, attempt.motion[chosen])]
        found = attempt.motion[chosen], attempt.model[chosen]
        result[chosen] = misfit_spread(
            self._pattern.subsets, self.coefficients(loaded), self._options.order, chosen, *found, loaded
        )
        return result


def _shown(residual: Floats, gain: Floats, pattern: Pattern) -> Floats:
    """Residual (point,) [grey²] of the subsets as noise of their pixels, summed over them."""
    return np.asarray(residual * (pattern.shown.colour / np.square(gain)))
