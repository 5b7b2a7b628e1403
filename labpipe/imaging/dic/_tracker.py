"""Track subsets from frame to frame: predict the position, solve, store the state.

A point is trusted when it converged close to where its own motion led it, or when neighbours or
a template match confirm it: a high correlation alone is no proof, since about one subset in
seventy that starts too far away converges to a wrong place with a correlation above 0.9.
"""

import numpy as np

from labpipe.arrays import Flags, Floats, Integers
from labpipe.imaging.dic._attempt import Attempt, Options
from labpipe.imaging.dic._comes_back import ComesBack
from labpipe.imaging.dic._film_window import Box, FilmWindow, Loaded
from labpipe.imaging.dic._frame_solver import FrameSolver
from labpipe.imaging.dic._motion_state import contradicted, converged_nearby, extent, predicted, remember
from labpipe.imaging.dic._motion_uncertainty import one_way
from labpipe.imaging.dic._places import nearest, spread_pieces
from labpipe.imaging.dic._reference import Reference
from labpipe.imaging.dic._seeding import has_double
from labpipe.imaging.dic._standing import Votes
from labpipe.imaging.dic._subset_solver import SOLVED

#: Distance from the prediction (px) up to which a converged point needs no confirmation:
#: the velocity of a bouncing holder changes by at most 1 px per frame.
SURPRISE = 1.5
#: The same in periods of a pattern that repeats itself: farther, it may be another period.
_PERIODS = 0.125
#: Standard deviations of the mean square of a residual of noise by which it may exceed the lower quartile of all.
_BY_CHANCE = 5.5
#: Neighbours that are asked whether a point is right.
NEIGHBOURS = 6
#: Drop of the correlation relative to the last frame that calls for a check.
_DROP = 0.85
#: Correlation that is no chance even of what may be noise, frames after which it is looked for only every so often.
_NO_CHANCE, _GIVEN_UP, _SELDOM = 0.75, 2, 8


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
        self.reference = reference
        self.film = film
        self._min_zncc = np.where(reference.is_faint, max(options.min_zncc, _NO_CHANCE), options.min_zncc)
        self.solver = FrameSolver(reference, options)
        self.places = np.stack([reference.subsets.x, reference.subsets.y], axis=1).astype(float)
        asked = np.flatnonzero(~reference.is_faint)
        asked = asked if len(asked) > NEIGHBOURS else np.arange(count)
        own_first = asked[nearest(self.places, self.places[asked], min(NEIGHBOURS + 1, count))]
        self.neighbours = np.ascontiguousarray(own_first[:, 1:])  # compiled for one layout
        self._half = np.ascontiguousarray(reference.subsets.half)
        self._motion = np.zeros((count, 6))
        self._velocity = np.zeros((count, 2))
        self._step = np.ones(count)
        self._seen = np.full(count, -1, np.int64)
        #: Correlation of each point where it was seen last.
        self.zncc = np.ones(count)
        self._piece_of, self._pieces = spread_pieces(self.places, self._half)
        #: Edges, gratings, grids, and what may be noise: they match in so many places that nothing but their
        #: neighbours finds them again.
        self.is_one_way = one_way(reference.subsets) | np.isfinite(reference.period) | reference.is_faint
        #: Distance (px) from its prediction up to which each converged point needs no confirmation.
        self.surprise = np.minimum(SURPRISE, _PERIODS * reference.period)
        self.is_tracked = np.ones(count, bool)
        self.misses = np.zeros(count, np.int64)
        #: Where something stood still in the picture.
        self.votes = Votes.none(reference.mean.shape)
        #: Misfit of each point, over that of most, at which nothing was found that stands before it.
        self.cleared = np.zeros(count)
        #: Misfit over that of most from which it is no chance.
        self.by_chance = 1.0 + _BY_CHANCE * np.sqrt(2.0 / reference.subsets.level[:, 2])
        #: Tells places apart that match alike.
        self.comes_back = ComesBack(reference)
        self._predictions: dict[int, Floats] = {}
        self._doubles: dict[int, bool] = {}

    def has_double(self, point: int) -> bool:
        """Whether the pattern around a point is in the reference a second time; looked for once."""
        if point not in self._doubles:
            subsets = self.reference.subsets
            centre = int(subsets.x[point]), int(subsets.y[point])
            self._doubles[point] = has_double(self.reference.pyramid, centre, int(subsets.half[point]))
        return self._doubles[point]

    def start_from(self, shifts: Floats) -> None:
        """Expect displacements (point, 2) in px in the next frame, whatever was before."""
        self._motion[:, [0, 3]] = shifts
        self._velocity[:] = 0.0
        self.is_tracked[:] = True
        self._predictions.clear()

    def predict(self, index: int) -> Floats:
        """Motion (point, 6) expected in a frame, from constant velocity."""
        motion = self._predictions.get(index)
        if motion is None:
            motion = predicted(self._motion, self._velocity, self._seen, self._step, self.is_tracked, index)
            self._predictions[index] = motion
        return motion

    def box(self, index: int) -> Box:
        """Rectangle of a frame that the tracked subsets will need."""
        wanted = self.is_tracked if self.is_tracked.any() else np.ones(len(self._seen), bool)
        return self.film.box_around(self._extent(index, wanted))

    def pieces(self, index: int) -> Integers:
        """First column and row (piece, 2) of the pieces of a frame whose rows are compared."""
        shift = self.predict(index)[:, [0, 3]]
        found = np.rint(self._pieces + shift[self._piece_of]).astype(np.int64)
        found[:, 1] -= found[:, 1] % 2  # so that all pieces begin with the same field
        return found

    def covers(self, loaded: Loaded, index: int) -> bool:
        """Whether a rectangle loaded ahead of time holds all that will be needed."""
        if not self.is_tracked.any():
            return True
        first, last, upper, lower = self._extent(index, self.is_tracked).tolist()
        _, columns, _, rows = self.film.whole
        left, right, top, bottom = loaded.window
        return bool(
            max(first - SURPRISE, 0.0) >= left
            and min(last + SURPRISE, columns - 1.0) <= right
            and max(upper - SURPRISE, 0.0) >= top
            and min(lower + SURPRISE, rows - 1.0) <= bottom
        )

    def _extent(self, index: int, chosen: Flags) -> Floats:
        """(left, right, top, bottom) of the subsets of chosen points as predicted."""
        return np.asarray(extent(self.places, self._half, self.predict(index), chosen))

    def first_attempt(self, loaded: Loaded, expected: Floats) -> Attempt:
        """Solve the tracked points from their predictions."""
        if self.is_tracked.all():
            every = np.arange(len(expected))
            found = self.solver.solve_all(loaded, every, expected)
            attempt = Attempt.of(found)
        else:
            chosen = np.flatnonzero(self.is_tracked)
            found = self.solver.solve_all(loaded, chosen, expected[chosen])
            attempt = Attempt.nothing(expected)
            attempt.iterations[chosen] = found.iterations
            attempt.take(chosen, found, np.ones(len(chosen), bool))
        attempt.trusted[:] = converged_nearby(
            attempt.motion,
            expected,
            self.accepts(attempt.code, attempt.zncc),
            attempt.zncc,
            _DROP * self.zncc,
            self.surprise,
        )
        return attempt

    def contradicted(self, attempt: Attempt) -> Flags:
        """Trusted points whose neighbours agree on another place."""
        return np.asarray(contradicted(self.places, self.neighbours, attempt.motion, attempt.trusted))

    def left(self, attempt: Attempt) -> dict[int, Flags]:
        """Pixels that counted of trusted points of a frame of which something was hidden."""
        if self.solver.sees_all:
            return {}
        chosen = np.flatnonzero(attempt.trusted)
        seen = self.solver.seen(chosen, attempt.motion[chosen])
        return {n: left for n, left in zip(chosen.tolist(), seen, strict=True) if left is not None}

    def accepts(self, code: Integers, zncc: Floats, chosen: Integers | slice = slice(None)) -> Flags:
        """Whether points converged with enough correlation."""
        return (code == SOLVED) & (zncc >= self._min_zncc[chosen])

    def missing(self, attempt: Attempt) -> Flags:
        """Points that are not trusted and looked for, as noise that was not seen again is not."""
        is_sought = ~self.reference.is_faint | (self.misses < _GIVEN_UP) | (self.misses % _SELDOM == 0)
        return ~attempt.trusted & is_sought

    def remember(self, index: int, attempt: Attempt) -> None:
        """Update the state with the trusted points of a frame."""
        self.solver.remember(attempt)
        remember(
            attempt.motion,
            attempt.zncc,
            attempt.trusted,
            index,
            self._motion,
            self._velocity,
            self._seen,
            self._step,
            self.zncc,
            self.is_tracked,
            self.misses,
        )
        self._predictions.clear()
