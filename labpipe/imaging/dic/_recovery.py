"""Recover points that the prediction missed, and confirm those that jumped.

From the cheap to the dear: agreement among the points, the motions of trusted neighbours, template
matches in the whole frame.
"""

import numpy as np

from labpipe.arrays import Flags, Floats, Integers
from labpipe.imaging.dic._attempt import Attempt
from labpipe.imaging.dic._before import look_before
from labpipe.imaging.dic._film_window import Loaded
from labpipe.imaging.dic._places import nearest
from labpipe.imaging.dic._seeding import Pyramid, find_subset, fit_motion, make_pyramid, shift_of
from labpipe.imaging.dic._subset_kernel import HIDDEN, LEFT_WINDOW
from labpipe.imaging.dic._tracker import NEIGHBOURS, Tracker

#: Distance from a neighbour's or a template's proposal (px) within which it is confirmed.
_CONFIRMED = 2.5
#: Share of the way to another place that matches as well, within which a pattern that comes back is where it was
#: expected.
_OF_RIVAL = 0.125
#: When so few of so many points converge near their prediction, they did by chance.
_CHANCE, _MANY = 0.2, 10
#: Agreement of surprised points with each other (px), and how many are needed.
_MUTUAL, _MUTUAL_COUNT = 0.5, 5
#: Distance (px) from where most lead, and mean square of the residual over theirs, from which a point that
#: jumped is a stray and none of another body.
_AWAY, _WORSE = 5.0, 2.5
#: Most of the points, of the third that matches best, that are asked where most lead.
_MOST_ASKED = 200
#: Template matches per frame: when points have just been lost, and when they stay lost.
_SEEDS_FIRST, _SEEDS_LATER = 12, 4
#: Template matches that tell of one motion.
_TOGETHER = 3
#: Frames after which a lost point is looked for only every so often.
_PATIENCE, _SELDOM = 64, 8
#: Rounds of propagation from neighbour to neighbour.
_ROUNDS = 16


def follow(tracker: Tracker, index: int, loaded: Loaded) -> Attempt:
    """Find all points in one frame, those that prediction did not lead to as well."""
    expected = tracker.predict(index)
    attempt = tracker.first_attempt(loaded, expected)
    recovery = Recovery(tracker, index, loaded, attempt, expected)
    is_told = recovery.settle()
    if is_told and ((~attempt.trusted & ~tracker.reference.is_faint).any() or tracker.contradicted(attempt).any()):
        recovery.run()
        recovery.settle()
    look_before(tracker, loaded, attempt)
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

    def settle(self) -> bool:
        """Go where all points together tell the pattern to be, if it comes back; False where they do not tell it."""
        attempt, tracker = self._attempt, self._tracker
        asked = tracker.comes_back.asked
        if tracker.solver.is_static or not len(asked):
            return True
        trusted = attempt.trusted[asked]
        is_known = bool(2 * trusted.sum() > len(asked))
        motion = np.where(trusted[:, None], attempt.motion[asked], self._expected[asked])
        moved = np.median((motion - self._expected[asked])[:, [0, 3]], axis=0)
        place = tracker.comes_back.look(self._whole_frame().image, motion, moved, is_known=is_known)
        if place.shift is None:
            return True
        if np.hypot(*(moved + place.shift)) > _OF_RIVAL * place.rival:
            attempt.trusted[:] = False
            return self._look_along_lines()
        if not is_known or np.hypot(*place.shift) > _CONFIRMED:
            self._start_at(place.shift)
        return True

    def _start_at(self, shift: Floats) -> None:
        """Look for all points a shift (2,) [px] from where they are or are expected."""
        attempt = self._attempt
        start = np.where(attempt.trusted[:, None], attempt.motion, self._expected)
        start[:, [0, 3]] = shift + shift_of(start, np.broadcast_to(shift, (len(start), 2)))
        attempt.code[:], attempt.trusted[:], self._expected = -1, False, start
        self._try(np.arange(len(start)), start)

    def _look_along_lines(self) -> bool:
        """Go where lines are that jumped, if their texture tells it: lines match all along themselves."""
        tracker = self._tracker
        is_sought = (tracker.misses < _PATIENCE) | (tracker.misses % _SELDOM == 0)
        if not is_sought.any() or len(lines := tracker.comes_back.lines) < _MUTUAL_COUNT:
            return False
        shift = tracker.comes_back.along_lines(self._whole_frame().image, self._expected[lines])
        if shift is not None:
            self._attempt.trusted[:] = False
            self._start_at(shift)
        return shift is not None

    def run(self) -> None:
        """Go from the cheap to the dear: agreement, neighbours, template matches."""
        attempt = self._attempt
        tracked = self._tracker.is_tracked & ~self._tracker.reference.is_faint
        if attempt.trusted.sum() < _CHANCE * tracked.sum() and tracked.sum() >= _MANY:
            attempt.trusted[:] = False
        self._trust_agreement()
        self._propagate()
        for _ in range(2):
            if not self._tracker.missing(attempt).any() or not self._seed():
                break
            self._propagate()
        if not attempt.trusted.any():
            self._trust_agreement()
            self._propagate()
        if 2 * attempt.trusted.sum() <= len(attempt.trusted):
            self._look_along_lines()
        self._outvote()
        self._propagate()
        self._distrust_strays()
        # A changed correlation without a jump (light, focus) needs no confirmation.
        moved = np.hypot(*(attempt.motion - self._expected)[:, [0, 3]].T)
        calm = self._tracker.accepts(attempt.code, attempt.zncc) & (moved <= self._tracker.surprise)
        attempt.trusted[calm & self._tracker.is_tracked] = True
        self._veto()

    def _veto(self) -> None:
        """Distrust what the neighbours still contradict, the worst of them first."""
        attempt, tracker = self._attempt, self._tracker
        while (wrong := tracker.contradicted(attempt)).any():
            attempt.outvoted[wrong] = True
            attempt.trusted[wrong] = False

    def _trust_agreement(self) -> None:
        """Trust surprised points that all tell of one rigid motion."""
        attempt, tracker = self._attempt, self._tracker
        solved = np.flatnonzero(tracker.accepts(attempt.code, attempt.zncc) & ~attempt.trusted & ~tracker.is_one_way)
        # All points of what repeats itself may agree on another period.
        asked = solved[np.unique(np.linspace(0, len(solved) - 1, _MUTUAL_COUNT).astype(int))] if len(solved) else solved
        if any(tracker.has_double(n) for n in asked.tolist()):
            solved = np.array([n for n in solved.tolist() if not tracker.has_double(n)], np.int64)
        if len(solved) < _MUTUAL_COUNT:
            return
        middle = tracker.places[solved].mean(axis=0)
        own = attempt.motion[solved]
        proposed = shift_of(own, middle - tracker.places[solved])
        centre = np.median(proposed, axis=0)
        gradient = np.median(own, axis=0)
        gradient[[0, 3]] = centre
        expected = shift_of(np.broadcast_to(gradient, own.shape), tracker.places[solved] - middle)
        agree = np.hypot(*(expected - own[:, [0, 3]]).T) < _MUTUAL
        if agree.sum() < max(_MUTUAL_COUNT, 0.6 * (~attempt.trusted & ~tracker.reference.is_faint).sum()):
            return
        attempt.trusted[solved[agree]] = True

    def _distrust_strays(self) -> None:
        """Distrust points that jumped far from where those lead that match best, and match worse."""
        attempt, tracker = self._attempt, self._tracker
        trusted = np.flatnonzero(attempt.trusted)
        if len(trusted) < _MUTUAL_COUNT:
            return
        own, places = attempt.motion[trusted], tracker.places[trusted]
        subsets = tracker.reference.subsets
        misfit = attempt.residual[trusted] / subsets.level[trusted, 2]
        best = np.argsort(misfit, kind="stable")[: min(-(-len(trusted) // 3), _MOST_ASKED)]
        apart = np.hypot(*(own[best][:, None, [0, 3]] - own[best][None, :, [0, 3]]).transpose(2, 0, 1))
        together = apart < subsets.half[trusted[best]]
        lead = best[together[np.argmax(together.sum(axis=1))]]
        gradient, middle = np.median(own[lead], axis=0), places.mean(axis=0)
        gradient[[0, 3]] = np.median(shift_of(own[lead], middle - places[lead]), axis=0)
        expected = shift_of(np.broadcast_to(gradient, own.shape), places - middle)
        away = np.hypot(*(expected - own[:, [0, 3]]).T) > _AWAY
        moved = np.hypot(*(own - self._expected[trusted])[:, [0, 3]].T)
        jumped = (moved > tracker.surprise[trusted]) | ~tracker.is_tracked[trusted]
        if not away.all():
            stray = trusted[away & jumped & (misfit > _WORSE * np.median(misfit[~away]))]
            attempt.trusted[stray] = False
            attempt.outvoted[stray] = True

    def _propagate(self) -> None:
        """Start untrusted points from the motions of their nearest trusted neighbours, in turn."""
        attempt, tracker = self._attempt, self._tracker
        rank = 0
        for _ in range(_ROUNDS):
            waiting = np.flatnonzero(tracker.missing(attempt))
            trusted = np.flatnonzero(attempt.trusted)
            if not len(waiting) or rank >= min(len(trusted), NEIGHBOURS):
                return
            near = nearest(tracker.places[waiting], tracker.places[trusted], rank + 1)
            start = self._carry(trusted[near[:, rank]], waiting)
            # A neighbour that is wrong itself must not stand in the way: ask the next one.
            rank = 0 if self._try(waiting, start) else rank + 1

    def _carry(self, sources: Integers, targets: Integers) -> Floats:
        """Motions of source points continued to the places of target points."""
        places = self._tracker.places
        start = self._attempt.motion[sources].copy()
        start[:, [0, 3]] = shift_of(start, places[targets] - places[sources])
        return start

    def _outvote(self) -> None:
        """Correct trusted points that contradict the median of their neighbours."""
        attempt, tracker = self._attempt, self._tracker
        odd = np.flatnonzero(tracker.contradicted(attempt))
        if len(odd):
            votes = [self._carry(near, odd) for near in tracker.neighbours[odd].T]
            self._try(odd, np.median(votes, axis=0))

    def _seed(self) -> bool:
        """Match templates for some untrusted points; True when one was found."""
        attempt, tracker = self._attempt, self._tracker
        waiting = np.flatnonzero(~attempt.trusted & ~attempt.reached & ~self._tried & ~tracker.is_one_way)
        waiting = waiting[attempt.code[waiting] != HIDDEN]
        misses = tracker.misses[waiting]
        waiting = waiting[(misses < _PATIENCE) | (misses % _SELDOM == 0)]
        if not len(waiting):
            return False
        is_new = (tracker.misses[waiting] == 0).any()
        budget = _SEEDS_FIRST if is_new else _SEEDS_LATER
        chosen = waiting[np.unique(np.linspace(0, len(waiting) - 1, budget).astype(int))]
        self._tried[chosen] = True
        found = self._match(chosen)
        if not found:
            return False
        where = np.array(list(found), np.int64)
        start = np.stack([found[n] for n in where])
        middle = tracker.places[where].mean(axis=0)
        common, fits = fit_motion(tracker.places[where] - middle, start[:, [0, 3]])
        # Turn the starts as the seeds turn together; keep apart those that do not belong.
        if fits.sum() >= _TOGETHER:
            start[:, [1, 2, 4, 5]] = common[[1, 2, 4, 5]]
            where, start = where[fits], start[fits]
            return self._try(where, start)
        return self._try(where, start)

    def _match(self, chosen: Integers) -> dict[int, Floats]:
        """Motions of those chosen points that a template match finds."""
        tracker = self._tracker
        subsets = tracker.reference.subsets
        pyramid = self._whole_frame()
        result = {}
        for n in chosen:
            centre = (int(subsets.x[n]), int(subsets.y[n]))
            if tracker.has_double(int(n)):
                continue
            seed = find_subset(tracker.reference.pyramid, pyramid, centre, int(subsets.half[n]))
            tracker.solver.work.reseeds += 1
            if seed is not None:
                result[int(n)] = seed.motion
        return result

    def _whole_frame(self) -> Pyramid:
        """Read the whole frame once, for seeds and for points outside the loaded rectangle."""
        if self._pyramid is None:
            grey, self._loaded = self._tracker.film.read_whole(self._index)
            self._pyramid = make_pyramid(grey)
        return self._pyramid

    def _try(self, chosen: Integers, start: Floats) -> bool:
        """Solve from proposed motions; trust those that stay near. True when any did."""
        tracker, attempt = self._tracker, self._attempt
        found = tracker.solver.solve(self._loaded, chosen, start)
        beyond = (found.code == LEFT_WINDOW) & (found.iterations == 0)
        if beyond.any() and self._pyramid is None and self._has_frame_around(chosen, start):
            self._whole_frame()
            found = tracker.solver.solve(self._loaded, chosen, start)
        attempt.iterations[chosen] += found.iterations
        attempt.reached[chosen] = (found.code == LEFT_WINDOW) & (self._loaded.box == tracker.film.whole)
        if self._loaded.box != tracker.film.whole:
            attempt.reached[chosen] = ~self._is_in_frame(chosen, start)
        near = np.hypot(*(found.motion - start)[:, [0, 3]].T) <= _CONFIRMED
        good = tracker.accepts(found.code, found.zncc, chosen) & near
        # What converged before keeps its place only when it fits the image clearly better.
        held = tracker.accepts(attempt.code[chosen], attempt.zncc[chosen], chosen)
        good &= ~held | (found.zncc > attempt.zncc[chosen] - 0.02)
        attempt.take(chosen, found, good)
        attempt.trusted[chosen[good]] = True
        return bool(good.any())

    def _is_in_frame(self, chosen: Integers, start: Floats) -> Flags:
        """Whether the moved subsets lie wholly inside the frame."""
        _, right, _, bottom = self._tracker.film.whole
        half = self._tracker.reference.subsets.half[chosen]
        x, y = (self._tracker.places[chosen] + start[:, [0, 3]]).T
        return (x >= half) & (x < right - half) & (y >= half) & (y < bottom - half)

    def _has_frame_around(self, chosen: Integers, start: Floats) -> bool:
        """Whether any proposal lies inside the frame, though not in the loaded rectangle."""
        return bool(self._is_in_frame(chosen, start).any())
