"""Follow subsets from frame to frame: predict, solve, and find again what was lost.

A point is trusted when it converged close to where its own motion led it, or when neighbours or
a template match confirm it: a high correlation alone is no proof, since about one subset in
seventy that starts too far away converges to a wrong place with a correlation above 0.9.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from labpipe.imaging.dic_reference import Reference, Status
from labpipe.imaging.film_window import Box, FilmWindow, Loaded
from labpipe.imaging.seeding import Pyramid, find_subset, fit_motion, make_pyramid, shift_of
from labpipe.imaging.subset_solver import LEFT_WINDOW, SOLVED, Solution, solve

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]
Flags = NDArray[np.bool_]

#: Distance from the prediction (px) up to which a converged point needs no confirmation:
#: the velocity of a bouncing holder changes by at most 1 px per frame.
_SURPRISE = 1.5
#: Distance from a neighbour's or a template's proposal (px) within which it is confirmed.
_CONFIRMED = 2.5
#: When so few of so many points converge near their prediction, they did by chance.
_CHANCE, _MANY = 0.2, 10
#: Neighbours that are asked, and the distance (px) from their median that calls for a second look.
_NEIGHBOURS, _OUTVOTED = 6, 1.0
#: Agreement of surprised points with each other (px), and how many are needed.
_MUTUAL, _MUTUAL_COUNT = 0.5, 5
#: Drop of the correlation relative to the last frame that calls for a check.
_DROP = 0.85
#: Template matches per frame: when points have just been lost, and when they stay lost.
_SEEDS_FIRST, _SEEDS_LATER = 12, 4
#: Frames after which a lost point is looked for only every so often.
_PATIENCE, _SELDOM = 64, 8
#: Rounds of propagation from neighbour to neighbour.
_ROUNDS = 16
#: The constant-velocity prediction is not stretched over more than this times the last step.
_STRETCH = 3.0


@dataclass(frozen=True)
class Options:
    """Settings of the solver, see :func:`labpipe.imaging.track`."""

    order: int
    tolerance: float
    max_iterations: int
    min_zncc: float


@dataclass
class Work:
    """Counts of what was done."""

    subsets_solved: int = 0
    iterations: int = 0
    reseeds: int = 0


@dataclass(frozen=True)
class FrameResult:
    """Answers for the usable points of one frame, as in ``Solution``, and their status."""

    motion: Floats
    gain: Floats
    residual: Floats
    zncc: Floats
    iterations: Indices
    status: NDArray[np.int8]


@dataclass
class _Attempt:
    """Best answers so far for one frame."""

    motion: Floats
    zncc: Floats
    gain: Floats
    residual: Floats
    iterations: Indices
    code: Indices
    trusted: Flags
    reached: Flags = field(init=False)

    def __post_init__(self) -> None:
        self.reached = np.zeros(len(self.zncc), bool)

    def take(self, chosen: Indices, found: Solution, better: Flags) -> None:
        """Replace the answers of chosen points where the new ones are better."""
        where = chosen[better]
        self.motion[where] = found.motion[better]
        self.zncc[where] = found.zncc[better]
        self.gain[where] = found.gain[better]
        self.residual[where] = found.residual[better]
        self.code[where] = found.code[better]


class Tracker:
    """State of all usable points while a film is gone through.

    Parameters
    ----------
    reference : Reference
        What to look for.
    film : FilmWindow
        Where to look.
    options : Options
        Solver settings.
    """

    def __init__(self, reference: Reference, film: FilmWindow, options: Options) -> None:
        count = len(reference.subsets)
        self._reference = reference
        self._film = film
        self._options = options
        self._places = np.stack([reference.subsets.x, reference.subsets.y], axis=1).astype(float)
        self._motion = np.zeros((count, 6))
        self._velocity = np.zeros((count, 2))
        self._step = np.ones(count)
        self._seen = np.full(count, -1)
        self._zncc = np.ones(count)
        self._is_tracked = np.ones(count, bool)
        self._misses = np.zeros(count, np.int64)
        self.work = Work()

    def start_from(self, shifts: Floats) -> None:
        """Expect displacements (point, 2) in px in the next frame, whatever was before."""
        self._motion[:, [0, 3]] = shifts
        self._velocity[:] = 0.0
        self._is_tracked[:] = True

    def predict(self, index: int) -> Floats:
        """Motion (point, 6) expected in a frame, from constant velocity."""
        motion = self._motion.copy()
        gap = np.where(self._seen >= 0, index - self._seen, 0)
        moves = self._is_tracked & (gap <= _STRETCH * self._step)
        motion[moves, 0] += self._velocity[moves, 0] * gap[moves]
        motion[moves, 3] += self._velocity[moves, 1] * gap[moves]
        return motion

    def box(self, index: int) -> Box:
        """Rectangle of a frame that the tracked subsets will need."""
        wanted = self._is_tracked if self._is_tracked.any() else np.ones(len(self._seen), bool)
        return self._film.box_around(self._extent(self.predict(index)[wanted], wanted))

    def covers(self, loaded: Loaded, index: int) -> bool:
        """Whether a rectangle loaded ahead of time holds all that will be needed."""
        if not self._is_tracked.any():
            return True
        extent = self._extent(self.predict(index)[self._is_tracked], self._is_tracked)
        left, right, top, bottom = loaded.box
        need = self._film.box_around(extent)
        return left <= need[0] and right >= need[1] and top <= need[2] and bottom >= need[3]

    def _extent(self, motion: Floats, chosen: Flags) -> Floats:
        """(left, right, top, bottom) of moved subsets."""
        half = self._reference.subsets.half[chosen]
        x, y = (self._places[chosen] + motion[:, [0, 3]]).T
        # A turned square is wider than a straight one.
        reach_x = half * (1.0 + np.abs(motion[:, 1]) + np.abs(motion[:, 2]))
        reach_y = half * (1.0 + np.abs(motion[:, 4]) + np.abs(motion[:, 5]))
        return np.array(
            [(x - reach_x).min(), (x + reach_x).max(), (y - reach_y).min(), (y + reach_y).max()]
        )

    def follow(self, index: int, loaded: Loaded) -> FrameResult:
        """Find all points in one frame and remember where they are."""
        expected = self.predict(index)
        attempt = self._first_attempt(loaded, expected)
        if not attempt.trusted.all():
            _Recovery(self, index, loaded, attempt, expected).run()
        self._remember(index, attempt)
        status = np.where(attempt.trusted, Status.OK, Status.LOST).astype(np.int8)
        status[~attempt.trusted & attempt.reached] = Status.OUTSIDE
        return FrameResult(
            attempt.motion,
            attempt.gain,
            attempt.residual,
            attempt.zncc,
            attempt.iterations,
            status,
        )

    def solve(self, loaded: Loaded, chosen: Indices, start: Floats) -> Solution:
        """Run the solver and count its work."""
        assert loaded.coefficients is not None  # noqa: S101 - frames with NaN are skipped before
        found = solve(
            self._reference.subsets,
            loaded.coefficients,
            self._options.order,
            chosen,
            start,
            origin=(loaded.box[0], loaded.box[2]),
            window=loaded.window,
            tolerance=self._options.tolerance,
            max_iterations=self._options.max_iterations,
        )
        self.work.subsets_solved += len(chosen)
        self.work.iterations += int(found.iterations.sum())
        return found

    def _first_attempt(self, loaded: Loaded, expected: Floats) -> _Attempt:
        """Solve the tracked points from their predictions."""
        count = len(expected)
        chosen = np.flatnonzero(self._is_tracked)
        attempt = _Attempt(
            expected.copy(),
            np.full(count, np.nan),
            np.full(count, np.nan),
            np.full(count, np.nan),
            np.zeros(count, np.int64),
            np.full(count, -1),
            np.zeros(count, bool),
        )
        found = self.solve(loaded, chosen, expected[chosen])
        attempt.iterations[chosen] = found.iterations
        attempt.take(chosen, found, np.ones(len(chosen), bool))
        moved = np.hypot(*(attempt.motion - expected)[:, [0, 3]].T)
        attempt.trusted = (
            self.accepts(attempt.code, attempt.zncc)
            & (moved <= _SURPRISE)
            & (attempt.zncc > _DROP * self._zncc)
        )
        return attempt

    def accepts(self, code: Indices, zncc: Floats) -> Flags:
        """Whether points converged with enough correlation."""
        return (code == SOLVED) & (zncc >= self._options.min_zncc)

    def _remember(self, index: int, attempt: _Attempt) -> None:
        """Update the state with the trusted points of a frame."""
        found = attempt.trusted
        shift = attempt.motion[:, [0, 3]] - self._motion[:, [0, 3]]
        gap = np.where(self._seen >= 0, index - self._seen, 0)
        has_velocity = found & self._is_tracked & (gap > 0)
        self._velocity[:] = np.where(
            has_velocity[:, None], shift / np.maximum(gap, 1)[:, None], 0.0
        )
        self._step = np.where(has_velocity, gap, 1)
        self._motion[found] = attempt.motion[found]
        self._seen[found] = index
        self._zncc[found] = attempt.zncc[found]
        self._is_tracked = found.copy()
        self._misses = np.where(found, 0, self._misses + 1)


class _Recovery:
    """Confirm or find the points of one frame that the prediction did not lead to."""

    def __init__(
        self, tracker: Tracker, index: int, loaded: Loaded, attempt: _Attempt, expected: Floats
    ) -> None:
        self._tracker = tracker
        self._index = index
        self._loaded = loaded
        self._attempt = attempt
        self._expected = expected
        self._pyramid: Pyramid | None = None
        self._tried = np.zeros(len(expected), bool)

    def run(self) -> None:
        """Go from the cheap to the dear: agreement, neighbours, template matches."""
        attempt = self._attempt
        tracked = self._tracker._is_tracked
        if attempt.trusted.sum() < _CHANCE * tracked.sum() and tracked.sum() >= _MANY:
            attempt.trusted[:] = False
        self._trust_agreement()
        self._propagate()
        for _ in range(2):
            if attempt.trusted.all() or not self._seed():
                break
            self._propagate()
        self._outvote()
        self._propagate()
        # A changed correlation without a jump (light, focus) needs no confirmation.
        moved = np.hypot(*(attempt.motion - self._expected)[:, [0, 3]].T)
        calm = self._tracker.accepts(attempt.code, attempt.zncc) & (moved <= _SURPRISE)
        attempt.trusted |= calm & self._tracker._is_tracked

    def _trust_agreement(self) -> None:
        """Trust surprised points that all tell of the same rigid motion."""
        attempt, tracker = self._attempt, self._tracker
        solved = np.flatnonzero(tracker.accepts(attempt.code, attempt.zncc) & ~attempt.trusted)
        if len(solved) < _MUTUAL_COUNT:
            return
        middle = tracker._places[solved].mean(axis=0)
        own = attempt.motion[solved]
        proposed = shift_of(own, middle - tracker._places[solved])
        centre = np.median(proposed, axis=0)
        gradient = np.median(own, axis=0)
        gradient[[0, 3]] = centre
        expected = shift_of(np.broadcast_to(gradient, own.shape), tracker._places[solved] - middle)
        agree = np.hypot(*(expected - own[:, [0, 3]]).T) < _MUTUAL
        if agree.sum() >= max(_MUTUAL_COUNT, 0.6 * (~attempt.trusted).sum()):
            attempt.trusted[solved[agree]] = True

    def _propagate(self) -> None:
        """Start untrusted points from the motions of their nearest trusted neighbours, in turn."""
        attempt, tracker = self._attempt, self._tracker
        rank = 0
        for _ in range(_ROUNDS):
            waiting = np.flatnonzero(~attempt.trusted)
            trusted = np.flatnonzero(attempt.trusted)
            if not len(waiting) or rank >= min(len(trusted), _NEIGHBOURS):
                return
            near = _nearest(tracker._places[waiting], tracker._places[trusted], rank + 1)
            start = self._carry(trusted[near[:, rank]], waiting)
            # A neighbour that is wrong itself must not stand in the way: ask the next one.
            rank = 0 if self._try(waiting, start) else rank + 1

    def _carry(self, sources: Indices, targets: Indices) -> Floats:
        """Motions of source points continued to the places of target points."""
        places = self._tracker._places
        start = self._attempt.motion[sources].copy()
        start[:, [0, 3]] = shift_of(start, places[targets] - places[sources])
        return start

    def _outvote(self) -> None:
        """Correct trusted points that contradict the median of their neighbours."""
        attempt, tracker = self._attempt, self._tracker
        trusted = np.flatnonzero(attempt.trusted)
        if len(trusted) <= _NEIGHBOURS:
            return
        near = _nearest(tracker._places[trusted], tracker._places[trusted], _NEIGHBOURS + 1)
        votes = np.stack(
            [self._carry(trusted[near[:, k]], trusted) for k in range(1, _NEIGHBOURS + 1)]
        )
        start = np.median(votes, axis=0)
        apart = np.hypot(*(start - attempt.motion[trusted])[:, [0, 3]].T)
        odd = apart > _OUTVOTED
        if odd.any():
            self._try(trusted[odd], start[odd])

    def _seed(self) -> bool:
        """Match templates for some untrusted points; True when one was found."""
        attempt, tracker = self._attempt, self._tracker
        waiting = np.flatnonzero(~attempt.trusted & ~attempt.reached & ~self._tried)
        misses = tracker._misses[waiting]
        waiting = waiting[(misses < _PATIENCE) | (misses % _SELDOM == 0)]
        if not len(waiting):
            return False
        is_new = (tracker._misses[waiting] == 0).any()
        budget = _SEEDS_FIRST if is_new else _SEEDS_LATER
        chosen = waiting[np.unique(np.linspace(0, len(waiting) - 1, budget).astype(int))]
        self._tried[chosen] = True
        found = self._match(chosen)
        if not found:
            return False
        where = np.array(list(found), np.int64)
        start = np.stack([found[n] for n in where])
        if len(where) >= 3:
            middle = tracker._places[where].mean(axis=0)
            common, fits = fit_motion(tracker._places[where] - middle, start[:, [0, 3]])
            # Turn the starts as the seeds turn together; keep apart those that do not belong.
            if fits.sum() >= 3:
                start[:, [1, 2, 4, 5]] = common[[1, 2, 4, 5]]
                where, start = where[fits], start[fits]
        return self._try(where, start)

    def _match(self, chosen: Indices) -> dict[int, Floats]:
        """Motions of those chosen points that a template match finds."""
        tracker = self._tracker
        subsets = tracker._reference.subsets
        pyramid = self._whole_frame()
        result = {}
        for n in chosen:
            centre = (int(subsets.x[n]), int(subsets.y[n]))
            seed = find_subset(tracker._reference.pyramid, pyramid, centre, int(subsets.half[n]))
            tracker.work.reseeds += 1
            if seed is not None:
                result[int(n)] = seed.motion
        return result

    def _whole_frame(self) -> Pyramid:
        """Read the whole frame once, for seeds and for points outside the loaded rectangle."""
        if self._pyramid is None:
            grey, self._loaded = self._tracker._film.read_whole(self._index)
            self._pyramid = make_pyramid(grey)
        return self._pyramid

    def _try(self, chosen: Indices, start: Floats) -> bool:
        """Solve from proposed motions; trust those that stay near. True when any did."""
        tracker, attempt = self._tracker, self._attempt
        found = tracker.solve(self._loaded, chosen, start)
        beyond = (found.code == LEFT_WINDOW) & (found.iterations == 0)
        if beyond.any() and self._pyramid is None and self._has_frame_around(chosen, start):
            self._whole_frame()
            found = tracker.solve(self._loaded, chosen, start)
        attempt.iterations[chosen] += found.iterations
        attempt.reached[chosen] = (found.code == LEFT_WINDOW) & (
            self._loaded.box == tracker._film.whole
        )
        if self._loaded.box != tracker._film.whole:
            attempt.reached[chosen] = ~self._is_in_frame(chosen, start)
        near = np.hypot(*(found.motion - start)[:, [0, 3]].T) <= _CONFIRMED
        good = tracker.accepts(found.code, found.zncc) & near
        # What converged before keeps its place only when it fits the image clearly better.
        held = tracker.accepts(attempt.code[chosen], attempt.zncc[chosen])
        good &= ~held | (found.zncc > attempt.zncc[chosen] - 0.02)
        attempt.take(chosen, found, good)
        attempt.trusted[chosen[good]] = True
        return bool(good.any())

    def _is_in_frame(self, chosen: Indices, start: Floats) -> Flags:
        """Whether the moved subsets lie wholly inside the frame."""
        _, right, _, bottom = self._tracker._film.whole
        half = self._tracker._reference.subsets.half[chosen]
        x, y = (self._tracker._places[chosen] + start[:, [0, 3]]).T
        return (x >= half) & (x < right - half) & (y >= half) & (y < bottom - half)

    def _has_frame_around(self, chosen: Indices, start: Floats) -> bool:
        """Whether any proposal lies inside the frame, though not in the loaded rectangle."""
        return bool(self._is_in_frame(chosen, start).any())


def _nearest(places: Floats, others: Floats, count: int) -> Indices:
    """For every place the numbers of its nearest others, shape (place, count)."""
    from scipy.spatial import cKDTree

    found = cKDTree(others).query(places, k=range(1, count + 1))[1]
    return np.asarray(found, np.int64)
