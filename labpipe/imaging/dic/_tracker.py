"""Following subsets from frame to frame: prediction, solution, state.

A point is trusted when it converged close to where its own motion led it, or when neighbours or
a template match confirm it: a high correlation alone is no proof, since about one subset in
seventy that starts too far away converges to a wrong place with a correlation above 0.9.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from labpipe.arrays import Flags, Floats, Integers
from labpipe.imaging.dic._film_window import Box, FilmWindow, Loaded
from labpipe.imaging.dic._kernels import AUTO
from labpipe.imaging.dic._neighbour_outliers import Neighbourhood
from labpipe.imaging.dic._occlusion import visible_pixels
from labpipe.imaging.dic._reference import Reference
from labpipe.imaging.dic._solver import SOLVED, STRAIN_SEEN, Solution, solve
from labpipe.imaging.dic._subsets import Subsets
from labpipe.imaging.dic._uncertainty import covariance

#: Distance from the prediction (px) up to which a converged point needs no confirmation:
#: the velocity of a bouncing holder changes by at most 1 px per frame.
SURPRISE = 1.5
#: Drop of the correlation relative to the last frame that calls for a check.
DROP = 0.85


@dataclass
class Attempt:
    """Best results so far for one frame, of all usable points; see :class:`.Solution`.

    ``covariance`` (point, 4): see :func:`.covariance`. ``hidden`` (point,): share of the subset behind a stated
    obstruction. ``trusted``, ``reached``, ``outvoted`` (point,): the point was found; it left the frame; its
    neighbours contradict it.
    """

    motion: Floats
    quality: Floats
    covariance: Floats
    hidden: Floats
    iterations: Integers
    code: Integers
    trusted: Flags
    reached: Flags = field(init=False)
    outvoted: Flags = field(init=False)

    def __post_init__(self) -> None:
        self.reached, self.outvoted = np.zeros((2, len(self.trusted)), bool)

    @classmethod
    def nothing(cls, expected: Floats) -> "Attempt":
        """Return results that hold nothing but where the points were expected."""
        count = len(expected)
        quality, spread = np.full((2, count, 4), np.nan)
        nowhere = np.full(count, -1)
        return cls(
            expected.copy(), quality, spread, np.zeros(count), np.zeros(count, np.int64), nowhere, np.zeros(count, bool)
        )

    @property
    def zncc(self) -> Floats:
        """Zero-normalised cross-correlation (point,)."""
        return self.quality[:, 2]

    def take(self, chosen: Integers, found: Solution, better: Flags | slice = slice(None)) -> None:
        """Replace the results of chosen points where the new ones are better."""
        where = chosen[better]
        for name in ("motion", "quality", "covariance", "hidden", "code"):
            getattr(self, name)[where] = getattr(found, name)[better]


class Tracker:
    """State of all usable points while a film is gone through.

    Parameters
    ----------
    reference : Reference
        Reference and its subsets.
    film : FilmWindow
        Frames.
    order : 3 or 5
        Spline order.
    min_zncc : float [1]
        Least correlation of a match.
    obstructed : bool array (row, column), optional
        Pixels of the frames that stated obstructions hide.
    """

    def __init__(
        self, reference: Reference, film: FilmWindow, order: int, min_zncc: float, obstructed: Flags | None = None
    ) -> None:
        count = len(reference.subsets)
        self.reference = reference
        self.film = film
        self.min_zncc = min_zncc
        self._order = order
        self._obstructed = obstructed
        self.places = reference.subsets.layout[:, :2].astype(float)
        self.neighbourhood = Neighbourhood(self.places)
        self._motion = np.zeros((count, 6))
        self._velocity = np.zeros((count, 2))
        self._seen = np.full(count, -1, np.int64)
        self.last_zncc = np.ones(count)
        self.is_tracked = np.ones(count, bool)
        self.misses = np.zeros(count, np.int64)
        self.is_static = True
        self._strain_seen = STRAIN_SEEN
        self.subsets_solved = self.iterations = self.reseeds = 0

    def predict(self, index: int) -> Floats:
        """Motion (point, 6) expected in a frame, from constant velocity; lost points stay where they were."""
        motion = self._motion.copy()
        gap = index - self._seen
        moves = self.is_tracked & (self._seen >= 0)
        motion[:, [0, 3]] += self._velocity * (gap * moves)[:, None]
        return motion

    def box(self, expected: Floats) -> Box:
        """Rectangle of a frame that the tracked subsets will need where they are expected."""
        chosen = self.is_tracked if self.is_tracked.any() else slice(None)
        motion, half, places = expected[chosen], self.reference.subsets.half[chosen], self.places[chosen]
        sides = []
        for axis, first, second in ((0, 1, 2), (3, 4, 5)):
            # a turned square is wider than a straight one
            reach = half * (1.0 + np.abs(motion[:, first]) + np.abs(motion[:, second]))
            place = places[:, axis // 3] + motion[:, axis]
            sides += [(place - reach).min(), (place + reach).max()]
        return self.film.box_around(np.array(sides))

    def solve(self, loaded: Loaded, chosen: Integers, start: Floats) -> Solution:
        """Solve chosen points from a start (point, 6); what a stated obstruction hides is left out."""
        found = self._solved(loaded, self.reference.subsets, chosen, chosen, start)
        if self._obstructed is None:
            return found
        hidden: dict[int, Flags] = {}
        # where a subset ends up decides which of its pixels are hidden
        for at in (start, found.motion):
            for k, n in enumerate(chosen):
                visible = visible_pixels(self._obstructed, self.places[n], int(self.reference.subsets.half[n]), at[k])
                if visible is not None:
                    hidden[k] = visible
            rows = np.array(list(hidden), np.int64)
            if not len(rows):
                break
            subsets = self.reference.partly_hidden(chosen[rows], list(hidden.values()))
            part = self._solved(loaded, subsets, np.arange(len(rows)), chosen[rows], start[rows])
            for name in ("motion", "quality", "covariance", "code"):
                getattr(found, name)[rows] = getattr(part, name)
            found.iterations[rows] += part.iterations
            found.hidden[rows] = [1.0 - visible.mean() for visible in hidden.values()]
        return found

    def _solved(self, loaded: Loaded, subsets: Subsets, which: Integers, chosen: Integers, start: Floats) -> Solution:
        """Run the solver on some subsets, which belong to chosen points, and count its work."""
        smoothing, edges = self.reference.smoothing, self.reference.edges
        if subsets is not self.reference.subsets:
            smoothing, edges = smoothing[chosen], edges[chosen]
        assert loaded.coefficients is not None  # noqa: S101 - frames with NaN are skipped before
        solution = solve(
            subsets, loaded.coefficients, self._order, which, start, origin=(loaded.box[0], loaded.box[2]),
            window=loaded.window, inflation=smoothing / self.reference.noise.left,
            strain_seen=self._strain_seen,
        )  # fmt: skip
        self.subsets_solved += len(which)
        self.iterations += int(solution.iterations.sum())
        spread = covariance(self.reference.noise, subsets, smoothing, edges, which, solution, self.is_static)
        return replace(solution, covariance=spread)

    def first_attempt(self, loaded: Loaded, expected: Floats) -> Attempt:
        """Solve the tracked points from their predictions."""
        chosen = np.flatnonzero(self.is_tracked)
        # nothing strains in a static frame, which is the reference or a part of it
        self._strain_seen = np.inf if self.is_static else STRAIN_SEEN
        found = self.solve(loaded, chosen, expected[chosen])
        # of a specimen that strains a quarter of the subsets show it, by noise alone one in twenty
        asked = (self.reference.subsets.shape[chosen] == AUTO) & (found.code == SOLVED)
        count, shown = int(asked.sum()), int(found.is_affine[asked].sum())
        if 0.25 * count < shown < count:
            self._strain_seen = 0.0
            found = self.solve(loaded, chosen, expected[chosen])
        attempt = Attempt.nothing(expected)
        attempt.iterations[chosen] = found.iterations
        attempt.take(chosen, found)
        apart = np.hypot(*(attempt.motion - expected)[:, [0, 3]].T)
        alike = attempt.zncc > DROP * self.last_zncc
        attempt.trusted = self.accepts(attempt.code, attempt.zncc) & alike & (apart <= SURPRISE)
        return attempt

    def accepts(self, code: Integers, zncc: Floats) -> Flags:
        """Points that converged with enough correlation."""
        return (code == SOLVED) & (zncc >= self.min_zncc)

    def remember(self, index: int, attempt: Attempt) -> None:
        """Update the state with the trusted points of a frame."""
        found, trusted, gap = attempt.motion, attempt.trusted, index - self._seen
        moves = trusted & self.is_tracked & (self._seen >= 0) & (gap > 0)
        step = (found - self._motion)[:, [0, 3]] / np.where(moves, gap, 1)[:, None]
        self._velocity = np.where(moves[:, None], step, 0.0)
        self.is_tracked = trusted.copy()
        self.misses = np.where(trusted, 0, self.misses + 1)
        self._motion[trusted] = found[trusted]
        self._seen[trusted] = index
        self.last_zncc[trusted] = attempt.zncc[trusted]
