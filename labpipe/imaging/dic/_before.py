"""Find what stands still before a moving specimen though nobody stated it.

A subset that it hides in part misfits, though the rest of it fits: pixels there look the same as in the
reference at the same place of the picture, and not as the specimen does that has moved there. That is asked
only of subsets that misfit by more than others do.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from labpipe.arrays import Flags, Floats, Floats32, Integers
from labpipe.imaging.dic._attempt import Attempt
from labpipe.imaging.dic._film_window import Loaded
from labpipe.imaging.dic._places import nearest, powers
from labpipe.imaging.dic._seeding import shift_of
from labpipe.imaging.dic._spline import PADDING
from labpipe.imaging.dic._standing import Standing, Votes, moved_pixels
from labpipe.imaging.dic._subset_kernel import CURVE, LIGHT, SOLVED
from labpipe.imaging.dic._tracker import Tracker

#: Mean square of a residual over that at which a point was found to hide nothing, from which it is looked at again.
_MORE = 1.3
#: Width (px) over which pixels are compared together, and mean square over that of noise from which they misfit.
_TOGETHER, _MISFIT = 3, 4.0
#: Mean square at rest over that where the subset has moved to below which pixels stand still.
_STILL = 0.4
#: Displacement (px) of what is there beyond which pixels misfit: edges sharper than the pixels keep to them, and
#: their steps stand still while they move along themselves.
_STEP = 1.0
#: Pixels that stand still, and share of those that only the neighbours' motion explains, from which it is no chance.
_FEWEST, _SHARE = 12, 0.06
#: Reach (px) of a misfit beyond the pixels that show it.
_BORDER = 3
#: Motion (px) from which what stands still is told from edges sharper than the pixels.
_MOVED = 1.2
#: Share of a subset that must fit to be tried without the rest, and changes of the motion (px) without that rest
#: from which it is looked at again, and from which it has gone astray.
_MOST_TRIED, _UNMOVED, _ASTRAY = 0.5, 0.02, 1.0
#: Points that are asked where the specimen has moved, and how far from that (px) a point has its own motion.
_ASKED, _APART = 8, 0.3
_ROUNDS = 3
#: Share of the distance to where others have moved that a point keeps at most without what stands before it.
_KEPT = 0.5
#: Grey levels below the brightest from which a pixel may have been brighter than the camera shows.
_CLIPPED = 1.0


@dataclass(frozen=True)
class _Look:
    """Pixels (row, column) of a subset at a motion: whether they fit there, and whether they stand still instead.

    ``at_first`` are those that stand still where they are in the reference, ``now`` those that do where the subset
    has moved to, and ``moved`` those that fit there and have changed there; ``there`` are their rows and columns.
    """

    fits: Flags
    at_first: Flags
    now: Flags
    moved: Flags
    there: tuple[Integers, Integers]

    @property
    def stands(self) -> Flags:
        """Pixels that stand still in one place or the other."""
        return self.at_first | self.now


def look_before(tracker: Tracker, loaded: Loaded, attempt: Attempt) -> None:
    """Look for what stands still before the points of a frame, and count where that is in the picture.

    ``tracker``: state of the points; its votes are changed; ``loaded``: the frame; ``attempt``: what was found in
    it.
    """
    if tracker.solver.is_static or loaded.coefficients is None:
        return
    if not attempt.trusted.any():
        return
    shown, usual, amplified = noise_shown(tracker, attempt)
    misfits = shown > usual * np.maximum(tracker.by_chance, _MORE * tracker.cleared)
    suspects = np.flatnonzero(misfits & attempt.trusted)
    if not len(suspects) and not tracker.votes.any:
        return
    if np.hypot(*attempt.motion[attempt.trusted][:, [0, 3]].T).max() < _MOVED:
        return
    tracker.votes.frames += 1
    looking = Looking(tracker, loaded, attempt, usual * amplified, _MOVED, _STEP)
    clean = suspects[~looking.find(suspects)]
    tracker.cleared[clean] = np.maximum(tracker.cleared[clean], shown[clean] / usual)
    looking.vote(np.flatnonzero(~misfits & attempt.trusted), tracker.votes)


def noise_shown(tracker: Tracker, attempt: Attempt) -> tuple[Floats, float, Floats]:
    """Tell the variance (point,) [grey²] of a pixel that points of a frame show, that of most, and its factor.

    The factor (point,) is how noise of the frame counts in grey levels of the reference.
    """
    own = 1.0 / tracker.reference.noise.static_frames
    amplified = (np.square(attempt.gain) + own) / (1.0 + own)
    shown = attempt.residual / (tracker.reference.subsets.level[:, 2] * amplified)
    every = shown[attempt.trusted]
    usual = max(float(np.partition(every, len(every) // 4)[len(every) // 4]), tracker.reference.rounding)
    return shown, usual, amplified


class Looking:
    """Looks at subsets of one frame.

    ``tracker, loaded, attempt``: as for :func:`look_before`; ``usual``: (point,) [grey²], variance of a pixel of
    most points; ``least_moved``: float [px], motion from which something is told to stand still; ``step``: float
    [px], displacement of what is there beyond which pixels misfit.
    """

    def __init__(
        self, tracker: Tracker, loaded: Loaded, attempt: Attempt, usual: Floats, least_moved: float, step: float
    ) -> None:
        self._least_moved, self._step = least_moved, step
        self._tracker, self._loaded, self._attempt, self._usual = tracker, loaded, attempt, usual
        self._coefficients = tracker.solver.coefficients(loaded)
        self._grey = tracker.solver.pattern.images.grey
        self._nodes = _at_nodes(self._coefficients, tracker.solver.pattern.order)
        self._clipped = float(self._grey.max()) - _CLIPPED, float(self._nodes.max()) - _CLIPPED
        self._stands = np.zeros(self._grey.shape, bool)

    def find(self, suspects: Integers) -> Flags:
        """Tell before which suspects something stands: where they are, where others have moved, or without a misfit."""
        around = self._motion_around(suspects)
        start = self._attempt.motion[suspects].copy()
        is_hidden = np.zeros(len(suspects), bool)
        left: dict[int, Flags] = {}
        for k, n in enumerate(suspects.tolist()):
            look = self._look(n, start[k])
            if around is not None and np.hypot(*(around[k] - start[k])[[0, 3]]) > _APART:
                other = self._look(n, around[k])
                if (other.fits & ~look.fits).mean() > _SHARE:
                    look, start[k] = other, around[k]
            is_hidden[k] = self._stands_before(n, start[k], look)
            if not is_hidden[k] and look.fits.mean() > _MOST_TRIED and (~look.fits).sum() >= _FEWEST:
                left[k] = _without(~look.fits)
        self._find_without(suspects, start, left, is_hidden)
        return is_hidden

    def _find_without(self, suspects: Integers, start: Floats, left: dict[int, Flags], is_hidden: Flags) -> None:
        """Look at suspects where they are without what misfits of them: what stands may have held them back."""
        solver = self._tracker.solver
        for _ in range(_ROUNDS):
            tried = np.array(list(left), np.int64)
            if not len(tried):
                return
            solver.found.update({int(suspects[k]): own for k, own in left.items()})
            answers = solver.solve(self._loaded, suspects[tried], start[tried])
            solver.found.clear()
            left = {}
            for k, motion, code in zip(tried.tolist(), answers.motion, answers.code.tolist(), strict=True):
                if code != SOLVED or not _UNMOVED < np.hypot(*(motion - start[k])[[0, 3]]) < _ASTRAY:
                    continue
                start[k], look = motion, self._look(int(suspects[k]), motion)
                is_hidden[k] = self._stands_before(int(suspects[k]), motion, look)
                if not is_hidden[k] and look.fits.mean() > _MOST_TRIED:
                    left[k] = _without(~look.fits)

    def _stands_before(self, point: int, motion: Floats, look: _Look) -> bool:
        """Whether something stands before a point, which is then noted."""
        if look.stands.sum() < _FEWEST or np.hypot(motion[0], motion[3]) < self._least_moved:
            return False
        x, y, half = self._tracker.reference.subsets.layout[point, :3].tolist()
        self._stands[y - half : y + half + 1, x - half : x + half + 1] |= look.at_first
        self._stands[look.there[0][look.now], look.there[1][look.now]] = True
        return True

    def release(self, held: Integers, told: Floats) -> None:
        """Note what stands before held points that move as told (point, 6) without it."""
        looks = [self._look(n, told[k]) for k, n in enumerate(held.tolist())]
        tried = np.array([k for k, look in enumerate(looks) if look.stands.sum() >= _FEWEST], np.int64)
        if not len(tried):
            return
        solver, points = self._tracker.solver, held[tried]
        solver.found.update({int(held[k]): _without(looks[k].stands) for k in tried.tolist()})
        answers = solver.solve(self._loaded, points, told[tried])
        solver.found.clear()
        before, after = (
            np.hypot(*(at - told[tried])[:, [0, 3]].T) for at in (self._attempt.motion[points], answers.motion)
        )
        for k in tried[(answers.code == SOLVED) & (after < _KEPT * before)].tolist():
            self._stands_before(int(held[k]), told[k], looks[k])

    def vote(self, clean: Integers, votes: Votes) -> None:
        """Count where something stood in the picture, and where points that do not misfit show the specimen."""
        if not (votes.any or self._stands.any()):
            return
        np.add(votes.stands, self._stands, out=votes.stands)
        touched = clean[self._touches(clean, votes)]
        for n in touched[np.unique(np.linspace(0, len(touched) - 1, _ASKED).astype(int))] if len(touched) else ():
            look = self._look(int(n), self._attempt.motion[n])
            votes.moves[look.there[0][look.moved], look.there[1][look.moved]] += 1

    def _touches(self, chosen: Integers, votes: Votes) -> Flags:
        """Which of chosen points may show what stood in other frames."""
        x, y, half = self._tracker.reference.subsets.layout[chosen, :3].T
        return Standing(votes.stands > 0).touches(x, y, half, self._attempt.motion[chosen])

    def _motion_around(self, suspects: Integers) -> Floats | None:
        """Motions (suspect, 6) that the nearest points tell that do not misfit; None where they do not agree."""
        attempt, places = self._attempt, self._tracker.places
        others = np.setdiff1d(np.flatnonzero(attempt.trusted & (attempt.code == SOLVED)), suspects)
        if len(others) < _ASKED // 2:
            return None
        near = others[nearest(places[suspects], places[others], min(_ASKED, len(others)))]
        motion = attempt.motion[near]
        shift = shift_of(motion.reshape(-1, 6), (places[suspects][:, None] - places[near]).reshape(-1, 2))
        motion[..., [0, 3]] = shift.reshape(*near.shape, 2)
        return np.asarray(np.median(motion, axis=1))

    def _look(self, point: int, motion: Floats) -> _Look:
        """Tell which pixels of a point fit at a motion, and which stand still instead."""
        from scipy.ndimage import map_coordinates

        x, y, half = self._tracker.reference.subsets.layout[point, :3].tolist()
        column, row = moved_pixels(x, y, half, motion)
        left, top = self._loaded.box[0] - PADDING, self._loaded.box[2] - PADDING
        order = self._tracker.solver.pattern.order
        grey = map_coordinates(self._coefficients, [row - top, column - left], order=order, prefilter=False)
        cut = np.s_[y - half : y + half + 1, x - half : x + half + 1]
        own, usual = self._grey[cut], float(self._usual[point])
        light = _fitted(grey, own, usual)
        if self._attempt.model[point] & (LIGHT | CURVE):
            terms = 6 if self._attempt.model[point] & CURVE else 3
            light = _uneven(light, grey, own, column - x, row - y, usual, terms)
        moved = self._apart(_lit(light, grey, column - x, row - y), grey, own)
        rows, columns = self._grey.shape
        i, j = np.mgrid[y - half : y + half + 1, x - half : x + half + 1]
        there = np.rint(row).astype(int).clip(0, rows - 1), np.rint(column).astype(int).clip(0, columns - 1)
        fits = moved <= _MISFIT * usual
        at_first, now = (self._at_rest(at, light, x, y) for at in ((i, j), there))
        images = self._tracker.solver.pattern.images
        slopes = _together(np.hypot(images.slope_x[cut], images.slope_y[cut]))
        is_beyond = ~fits & (moved > self._step**2 * slopes)
        first, second = (is_beyond & (rest < _STILL * moved) for rest in (at_first, now))
        return _Look(fits, first, second, fits & (_STILL * now > np.maximum(moved, usual)), there)

    def _at_rest(self, places: tuple[Integers, Integers], light: Floats, x: int, y: int) -> Floats:
        """Mean square (row, column) of what has changed in the frame at places of the picture, lit as about (x, y)."""
        left, top = self._loaded.box[0] - PADDING, self._loaded.box[2] - PADDING
        inner = self._nodes[
            (places[0] - top).clip(0, len(self._nodes) - 1), (places[1] - left).clip(0, self._nodes.shape[1] - 1)
        ]
        return _together(_lit(light, inner, places[1] - x, places[0] - y) - self._grey[places])

    def _apart(self, lit: Floats, grey: Floats, own: Floats32) -> Floats:
        """Mean square (row, column) of what lit grey levels differ by from their own, beyond what clipping may do."""
        of_reference, of_frame = self._clipped
        is_clipped = ((own > of_reference) & (lit > own)) | ((grey > of_frame) & (lit < own))
        return _together(np.where(is_clipped, 0.0, lit - own))


def _fitted(grey: Floats | Floats32, own: Floats32, usual: float) -> Floats:
    """Light that leads from the frame to most of the reference, see :func:`_lit`, alike across the subset."""
    x, y = grey.ravel(), own.ravel()
    gain, level = 1.0, float(np.median(y - x))
    for _ in range(4):
        near = _near(gain * x + level - y, usual)
        a, b = x[near], y[near]
        spread = float(((a - a.mean()) ** 2).sum())
        if spread <= 0.0:
            break
        gain = float(np.clip(((a - a.mean()) * (b - b.mean())).sum() / spread, 0.3, 3.0))
        level = float(b.mean() - gain * a.mean())
    return np.array([[gain], [level]])


def _uneven(
    light: Floats, grey: Floats | Floats32, own: Floats32, right: Floats, down: Floats, usual: float, terms: int
) -> Floats:
    """Let light slope across the subset as well, and curve where it has six terms."""
    places = powers(np.stack([right, down], axis=-1), terms).reshape(-1, terms)
    columns, wanted = np.concatenate([places * grey.reshape(-1, 1), places], axis=1), own.ravel()
    found = np.pad(light, ((0, 0), (0, terms - 1))).ravel()
    for _ in range(4):
        near = _near(columns @ found - wanted, usual)
        used = columns[near]
        found = np.asarray(np.linalg.lstsq(used.T @ used, used.T @ wanted[near])[0], float)
    return found.reshape(2, terms)


def _near(left: Floats | Floats32, usual: float) -> Flags:
    """Most of the pixels: those that the light leads to."""
    off = np.abs(left)
    return np.asarray(off <= max(2.5 * float(np.median(off)), 2.0 * usual**0.5))


def _lit(light: Floats, grey: Floats | Floats32, right: Floats | Integers, down: Floats | Integers) -> Floats:
    """Grey levels in the light (2, terms): weights of the powers of the place in the gain, and in the level."""
    places = np.stack([right, down], axis=-1).astype(float)
    gain, level = np.moveaxis(powers(places, light.shape[1]) @ light.T, -1, 0)
    return np.asarray(gain * grey + level)


def _together(difference: Floats) -> Floats:
    """Mean square of what lies around each pixel."""
    size = (_TOGETHER, _TOGETHER)
    return np.asarray(cv2.blur(np.square(difference), size, borderType=cv2.BORDER_REFLECT_101), float)


def _without(stands: Flags) -> Flags:
    """Pixels that count beside those which stand still."""
    width = 2 * _BORDER + 1
    return np.asarray(cv2.dilate(stands.astype(np.uint8), np.ones((width, width))) == 0)


def _at_nodes(coefficients: Floats32, order: int) -> Floats32:
    """Image whose spline has the given coefficients."""
    weights = np.array([1.0, 4.0, 1.0]) / 6.0 if order == 3 else np.array([1.0, 26.0, 66.0, 26.0, 1.0]) / 120.0
    return np.asarray(cv2.sepFilter2D(coefficients, cv2.CV_32F, weights, weights), np.float32)
