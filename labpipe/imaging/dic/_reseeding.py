"""Points that prediction did not lead to: confirmed or found again by neighbours and template matches.

In order of cost: agreement among the points, the motions of trusted neighbours, template
matches in the whole frame.
"""

import numpy as np

from labpipe.arrays import Flags, Floats, Integers
from labpipe.imaging.dic._film_window import Loaded
from labpipe.imaging.dic._neighbour_outliers import NEIGHBOURS, carried, nearest
from labpipe.imaging.dic._seeding import AGREEMENT, Pyramid, find_subset, fit_motion, make_pyramid
from labpipe.imaging.dic._solver import LEFT_WINDOW
from labpipe.imaging.dic._tracker import DROP, SURPRISE, Attempt, Tracker

#: When so few of so many points converge near their prediction, they did by chance.
_CHANCE, _MANY = 0.2, 10
#: Agreement of surprised points with each other (px), and the number that is needed.
_MUTUAL, _MUTUAL_COUNT = 0.5, 5
#: Template matches per frame: when points have just been lost, and when they stay lost.
_SEEDS_FIRST, _SEEDS_LATER = 12, 4
#: Frames after which a lost point is sought only every so often.
_PATIENCE, _SELDOM = 64, 8


def follow(tracker: Tracker, index: int, loaded: Loaded, expected: Floats) -> Attempt:
    """Find all points in one frame, including those that prediction (``expected``) did not lead to."""
    attempt = tracker.first_attempt(loaded, expected)
    recovery = Recovery(tracker, index, loaded, attempt, expected)
    if not attempt.trusted.all():
        recovery.run()
    recovery.refuse_outliers()
    tracker.remember(index, attempt)
    return attempt


class Recovery:
    """Confirm or find the points of one frame that the prediction did not lead to."""

    def __init__(self, tracker: Tracker, index: int, loaded: Loaded, attempt: Attempt, expected: Floats) -> None:
        self._tracker = tracker
        self._index = index
        self._loaded = loaded
        self._attempt = attempt
        self._expected = expected
        self._pyramid: Pyramid | None = None
        self._tried = np.zeros(len(expected), bool)

    def run(self) -> None:
        """Try agreement, neighbours and template matches in turn."""
        attempt = self._attempt
        tracked = self._tracker.is_tracked
        if attempt.trusted.sum() < _CHANCE * tracked.sum() and tracked.sum() >= _MANY:
            attempt.trusted[:] = False
        self._trust_agreement()
        self._propagate()
        for _ in range(2):
            if attempt.trusted.all() or not self._seed():
                break
            self._propagate()
        # A changed correlation without a jump (light, focus) needs no confirmation.
        calm = self._tracker.accepts(attempt.code, attempt.zncc) & (self._jumped() <= SURPRISE)
        attempt.trusted |= calm & tracked
        # Far matches that no trusted neighbour supports, or without any the correlation of before, are refused.
        far = attempt.trusted & ((self._jumped() > SURPRISE) | ~tracked)
        if far.any() and len(far) == 1:
            attempt.trusted &= attempt.zncc > DROP * self._tracker.last_zncc
        elif far.any():
            attempt.trusted &= ~(far & self._tracker.neighbourhood.unsupported(attempt.motion, attempt.trusted))

    def _jumped(self) -> Floats:
        """Distance (point,) in px from where the points were expected."""
        return np.asarray(np.hypot(*(self._attempt.motion - self._expected)[:, [0, 3]].T))

    def refuse_outliers(self) -> None:
        """Distrust points that contradict their neighbours, unless they are found where these lead."""
        attempt, tracker = self._attempt, self._tracker
        fails, median = tracker.neighbourhood.outliers(attempt.motion, attempt.trusted)
        if not fails.any():
            return
        chosen = np.flatnonzero(fails)
        attempt.trusted[chosen] = False
        start = attempt.motion[chosen].copy()
        start[:, [0, 3]] = median
        self._try(chosen, start)
        again, _ = tracker.neighbourhood.outliers(attempt.motion, attempt.trusted)
        attempt.trusted &= ~again
        attempt.outvoted = fails & ~attempt.trusted

    def _trust_agreement(self) -> None:
        """Trust surprised points that show the same rigid motion."""
        attempt, tracker = self._attempt, self._tracker
        solved = np.flatnonzero(tracker.accepts(attempt.code, attempt.zncc) & ~attempt.trusted)
        if len(solved) < _MUTUAL_COUNT:
            return
        middle = tracker.places[solved].mean(axis=0)
        own = attempt.motion[solved]
        gradient = np.median(own, axis=0)
        gradient[[0, 3]] = np.median(carried(own, middle - tracker.places[solved]), axis=0)
        expected = carried(gradient, tracker.places[solved] - middle)
        agree = np.hypot(*(expected - own[:, [0, 3]]).T) < _MUTUAL
        if agree.sum() >= max(_MUTUAL_COUNT, 0.6 * (~attempt.trusted).sum()):
            attempt.trusted[solved[agree]] = True

    def _propagate(self) -> None:
        """Start untrusted points from the motions of their nearest trusted neighbours, in turn."""
        attempt, tracker = self._attempt, self._tracker
        rank = 0
        while True:
            waiting = np.flatnonzero(~attempt.trusted)
            trusted = np.flatnonzero(attempt.trusted)
            if not len(waiting) or rank >= min(len(trusted), NEIGHBOURS):
                return
            near = nearest(tracker.places[waiting], tracker.places[trusted], rank + 1)
            # the motions of the sources continued to the places of the targets
            sources = trusted[near[:, rank]]
            start = attempt.motion[sources].copy()
            start[:, [0, 3]] = carried(start, tracker.places[waiting] - tracker.places[sources])
            # A neighbour that is wrong itself must not stand in the way: ask the next one.
            rank = 0 if self._try(waiting, start) else rank + 1

    def _seed(self) -> bool:
        """Match templates for some untrusted points; True when one was found."""
        attempt, tracker = self._attempt, self._tracker
        waiting = np.flatnonzero(~attempt.trusted & ~attempt.reached & ~self._tried)
        misses = tracker.misses[waiting]
        waiting = waiting[(misses < _PATIENCE) | (misses % _SELDOM == 0)]
        if not len(waiting):
            return False
        is_new = (tracker.misses[waiting] == 0).any()
        budget = _SEEDS_FIRST if is_new else _SEEDS_LATER
        chosen = waiting[np.unique(np.linspace(0, len(waiting) - 1, budget).astype(int))]
        self._tried[chosen] = True
        subsets, pyramid, found = tracker.reference.subsets, self._whole_frame(), dict[int, Floats]()
        for n in chosen.tolist():
            x, y, half = subsets.layout[n, :3].tolist()
            match = find_subset(tracker.reference.pyramid, pyramid, (x, y), half)
            tracker.reseeds += 1
            if match is not None:
                found[n] = match[0]
        if not found:
            return False
        where = np.array(list(found), np.int64)
        start = np.stack([found[n] for n in where])
        if len(where) >= 3:
            middle = tracker.places[where].mean(axis=0)
            common, fits = fit_motion(tracker.places[where] - middle, start[:, [0, 3]])
            # Turn the starts as the seeds turn together; keep apart those that do not belong.
            if fits.sum() >= 3:
                start[:, [1, 2, 4, 5]] = common[[1, 2, 4, 5]]
                where, start = where[fits], start[fits]
        return self._try(where, start)

    def _whole_frame(self) -> Pyramid:
        """Read the whole frame once, for seeds and for points outside the loaded rectangle."""
        if self._pyramid is None:
            grey, self._loaded = self._tracker.film.read_whole(self._index)
            self._pyramid = make_pyramid(grey)
        return self._pyramid

    def _try(self, chosen: Integers, start: Floats) -> bool:
        """Solve from proposed motions; trust those that stay near. True when any did."""
        tracker, attempt = self._tracker, self._attempt
        found = tracker.solve(self._loaded, chosen, start)
        beyond = (found.code == LEFT_WINDOW) & (found.iterations == 0)
        if beyond.any() and self._pyramid is None and self._is_in_frame(chosen, start).any():
            self._whole_frame()
            found = tracker.solve(self._loaded, chosen, start)
        attempt.iterations[chosen] += found.iterations
        attempt.reached[chosen] = (found.code == LEFT_WINDOW) & (self._loaded.box == tracker.film.whole)
        if self._loaded.box != tracker.film.whole:
            attempt.reached[chosen] = ~self._is_in_frame(chosen, start)
        near = np.hypot(*(found.motion - start)[:, [0, 3]].T) <= AGREEMENT
        good = tracker.accepts(found.code, found.zncc) & near
        # A match from the prediction keeps its place unless the new one fits the image as well.
        held = tracker.accepts(attempt.code[chosen], attempt.zncc[chosen])
        good &= ~held | (found.zncc > attempt.zncc[chosen] - 0.02)
        attempt.take(chosen, found, good)
        attempt.trusted[chosen[good]] = True
        return bool(good.any())

    def _is_in_frame(self, chosen: Integers, start: Floats) -> Flags:
        """Tell moved subsets that lie wholly inside the frame."""
        _, right, _, bottom = self._tracker.film.whole
        half = self._tracker.reference.subsets.half[chosen]
        x, y = (self._tracker.places[chosen] + start[:, [0, 3]]).T
        return (x >= half) & (x < right - half) & (y >= half) & (y < bottom - half)
