"""What the tracker found in all frames, and which of it is alike: solved with one pattern and one model."""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Flags, Floats, Integers
from labpipe.imaging.dic._attempt import Attempt
from labpipe.imaging.dic._growth import NO_GROWTH, Growth
from labpipe.imaging.dic._motion_uncertainty import NoiseModel
from labpipe.imaging.dic._pattern import Pattern
from labpipe.imaging.dic._reference import Status
from labpipe.imaging.dic._standing import unpacked
from labpipe.imaging.dic._subset_solver import CHANGES, SOLVED
from labpipe.imaging.dic._subsets import Subsets

#: Results whose uncertainty is computed at once: few enough that their work arrays stay in the processor's cache.
_BLOCK = 2_000
#: The same of results of which something was hidden, whose subsets are cut anew.
_BLOCK_HIDDEN = 200


@dataclass(frozen=True)
class Table:
    """What the tracker found over (frame, usable point); motions over (frame, point, 6).

    ``growth`` (frame, 4) is that of the pattern that a frame was matched with, see :class:`.Pattern`. ``spread``
    (frame, point, 3) [px²] is that of :func:`.misfit_spread`, NaN where the residual is noise. ``left``
    holds the pixels that counted of results of which something was hidden, see :func:`.packed`.
    """

    motion: Floats
    gain: Floats
    residual: Floats
    zncc: Floats
    iterations: NDArray[np.int32]
    status: NDArray[np.int8]
    model: NDArray[np.int8]
    change: Floats
    growth: Integers
    spread: Floats
    left: dict[tuple[int, int], NDArray[np.uint8]] = field(default_factory=dict)

    def attempt(self, row: int, trusted: Flags) -> Attempt:
        """Answers of a frame, of which some points are trusted."""
        found = Attempt.nothing(self.motion[row])
        for name in ("gain", "residual", "zncc", "model", "change"):
            getattr(found, name)[:] = getattr(self, name)[row]
        found.trusted[:] = trusted
        found.code[trusted] = SOLVED
        return found


def empty_table(frames: int, points: int) -> Table:
    """Return a table in which every frame counts as damaged until it is filled in."""
    shape = (frames, points)
    return Table(
        np.full((*shape, 6), np.nan),
        np.full(shape, np.nan),
        np.full(shape, np.nan),
        np.full(shape, np.nan),
        np.zeros(shape, np.int32),
        np.full(shape, Status.FRAME_DAMAGED, np.int8),
        np.zeros(shape, np.int8),
        np.full((*shape, CHANGES), np.nan),
        np.zeros((frames, len(NO_GROWTH)), np.int64),
        np.full((*shape, 3), np.nan),
    )


def alike(table: Table, half: Integers) -> Iterator[tuple[Growth, int, Integers, Integers, list[Flags]]]:
    """Frames and points of the results that were solved with the same pattern and model, a block at a time.

    Of those of which something was hidden, it comes with the pixels that counted, else with none.
    """
    hidden = np.zeros(table.status.shape, bool)
    if table.left:
        hidden[tuple(np.array(list(table.left)).T)] = True
    patterns, which = np.unique(table.growth, axis=0, return_inverse=True)
    for k, growth in enumerate(map(tuple, patterns.tolist())):
        found = (table.status == Status.OK) & (which.reshape(-1, 1) == k)
        for model in np.unique(table.model[found]):
            chosen = found & (table.model == model)
            for part, most in ((chosen & ~hidden, _BLOCK), (chosen & hidden, _BLOCK_HIDDEN)):
                rows, columns = np.nonzero(part)
                for first in range(0, len(rows), most):
                    row, column = rows[first : first + most], columns[first : first + most]
                    left: list[Flags] = []
                    if most == _BLOCK_HIDDEN:
                        places = zip(row.tolist(), column.tolist(), strict=True)
                        left = [unpacked(table.left[r, c], int(half[c])) for r, c in places]
                    yield growth, int(model), row, column, left


def as_seen(pattern: Pattern, column: Integers, left: list[Flags]) -> tuple[NoiseModel, Subsets, Integers]:
    """How noise is passed on, subsets, and which of them results are of; cut anew where some pixels do not count."""
    if not left:
        return pattern.noise, pattern.subsets, column
    cut = pattern.cut(column, left)
    return pattern.noise_in(cut, column, left), cut, np.arange(len(column))


def hidden_share(table: Table, half: Integers) -> Floats:
    """Share (frame, point) of the pixels of subsets that did not count because something hid them."""
    share = np.zeros(table.status.shape)
    for (row, n), bits in table.left.items():
        share[row, n] = 1.0 - unpacked(bits, int(half[n])).mean()
    return share
