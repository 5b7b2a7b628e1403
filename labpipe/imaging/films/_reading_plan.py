"""Select the frames and rows of a film that need to be read.

Looking at thin bands of rows costs a few per cent of reading a frame. A frame that is nowhere as dark (or bright)
as the known contacts, in a band through their centres and in rows all over it, shows none; one whose bands equal
those of a contact frame before and after shows the same contact. All others are read.
"""

import math
from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Flags, Floats
from labpipe.frames import FrameSource

#: Rows of a band.
_BAND_ROWS = 16
#: Standard deviations of the sum of squared differences from which two bands differ.
_DIFFERENT = 6.0
#: Standard deviations of a mean over columns from which a band differs in one place.
_LOCALLY_DIFFERENT = 8.0
#: Width (px) of the place, and how far from a known centre (px) a contact is looked for.
_PLACE, _REACH = 24, 60
#: Distance between rows that are looked at for contacts elsewhere, in radii of those known.
_ROW_OF = 0.5
#: Share of the light by which a contact is darker or brighter than what is around it, for bands to tell it.
_TELLS = 0.3
#: Frames between two that are read whole at least, also where nothing changes: shorter films are read whole.
LONGEST_REST = 64
#: Decoded frames kept at hand (bytes), so that a second look does not read them again.
_MOST_KEPT = 128 * 2**20


@dataclass
class FilmReader:
    """Reads frames and counts them.

    ``film``: The film. ``frames_read``, ``bands_read``: Frames read whole, and bands of rows. ``pixels_read``,
    ``bytes_read``: What that amounts to, decoded. ``repeats``: Frames that were read again because they were no
    longer at hand. ``damaged``: Frames that hold numbers that are not finite; they are returned all black.
    """

    film: FrameSource
    frames_read: int = 0
    bands_read: int = 0
    pixels_read: int = 0
    bytes_read: int = 0
    repeats: int = 0
    damaged: set[int] = field(default_factory=set)
    _seen: set[int] = field(default_factory=set)
    _parts: dict[tuple[int, int], FrameSource] = field(default_factory=dict)
    _kept: OrderedDict[int, NDArray[np.generic]] = field(default_factory=OrderedDict)

    def whole(self, index: int) -> NDArray[np.generic]:
        """Read a frame, or hand out again one that was read lately."""
        if index in self._kept:
            self._kept.move_to_end(index)
            return self._kept[index]
        # A copy, because a film may hand out a view of memory that it uses again.
        image = np.array(self.film[index])
        if index in self._seen:
            self.repeats += 1
        else:
            self._seen.add(index)
            self.frames_read += 1
        if image.dtype.kind == "f" and not np.isfinite(image).all():
            self.damaged.add(index)
            image = np.zeros_like(image)
        self.pixels_read += image.size
        self.bytes_read += image.nbytes
        self._kept[index] = image
        if len(self._kept) * image.nbytes > _MOST_KEPT:
            self._kept.popitem(last=False)
        return image

    def band(self, index: int, top: int, bottom: int) -> NDArray[np.float32]:
        """Read rows ``top`` to ``bottom - 1`` of a frame, or cut them out of one that was read lately."""
        if index in self._kept:
            return self._kept[index][top:bottom].astype(np.float32)
        if (top, bottom) not in self._parts:
            self._parts[top, bottom] = self.film.roi(slice(top, bottom), slice(0, self.film.shape[2]))
        image = np.asarray(self._parts[top, bottom][index])
        self.bands_read += 1
        self.pixels_read += image.size
        self.bytes_read += image.nbytes
        return np.nan_to_num(image.astype(np.float32))

    def work(self) -> dict[str, int]:
        """Return counts for a Dataset's attribute ``work``."""
        count, rows, columns = self.film.shape
        return {
            "frames_read": self.frames_read,
            "frames_total": count,
            "bands_read": self.bands_read,
            "pixels_read": self.pixels_read,
            "pixels_total": count * rows * columns,
            "bytes_read": self.bytes_read,
            "bytes_total": count * rows * columns * max(round(self.bytes_read / max(self.pixels_read, 1)), 1),
            "repeated_reads": self.repeats,
        }


def _band_about(row: float, rows: int) -> tuple[int, int]:
    """First row of the band around a row, and the row after its last, inside the frame."""
    height = min(_BAND_ROWS, rows)
    top = min(max(round(row) - height // 2, 0), rows - height)
    return top, top + height


@dataclass(frozen=True)
class Place:
    """Where a contact was seen, and how bright.

    ``x``, ``y``, ``radius`` [px]: Its circle. ``inside``, ``light`` [grey levels]: Brightness of the contact, and that
    of the fringes around it on average.
    """

    x: float
    y: float
    radius: float
    inside: float
    light: float

    def may_be_in(self, line: NDArray[np.float32], level: float) -> bool:
        """Tell whether a line through the centre, of a frame of this brightness, is as a contact near the centre."""
        first = min(max(round(self.x) - _REACH, 0), max(len(line) - _PLACE, 0))
        last = min(max(round(self.x) + _REACH, first + _PLACE), len(line))
        return bool(self.is_like(_means(line[first:last]), level).any())

    def is_like(self, grey: Floats, level: float) -> Flags:
        """Tell which mean grey levels are as those of a contact; all, where its brightness does not tell.

        The light of a film may change: in a brighter frame a dark contact is brighter, in a darker one a bright one
        is darker.
        """
        if abs(self.inside - self.light) < _TELLS * abs(self.light):
            return np.ones(grey.shape, bool)
        halfway, change = 0.5 * (self.inside + self.light), level / max(self.light, 1e-9)
        return grey < halfway * max(change, 1.0) if self.inside < self.light else grey > halfway * min(change, 1.0)


@dataclass(frozen=True)
class ReadingPlan:
    """Which frames to read whole.

    ``read``: Frames to read. ``is_resting``: Frames that are not read because they look like the contact frames
    before and after.
    """

    read: Flags
    is_resting: Flags


def plan_reading(reader: FilmReader, wanted: Flags, known: dict[int, bool], places: Sequence[Place]) -> ReadingPlan:
    """Choose the frames to read from their bands and from frames already known.

    ``reader``: The film. ``wanted``: Frames that may be read. ``known``: Frames that have been looked at, with and
    without contact. ``places``: The contacts found in them. Returns: A frame is left out when its band is nowhere
    near a centre as bright as a contact and nothing elsewhere is, or when it is like that of the frame last read while
    in contact.
    """
    count = len(wanted)
    read, resting = np.zeros(count, bool), np.zeros(count, bool)
    if not places:
        return ReadingPlan(wanted.copy(), resting)
    frames = np.flatnonzero(wanted).tolist()
    seen, noise = _look_at_rows(reader, frames, known, places)
    like = np.array([one.is_like for one in seen])
    is_elsewhere = (like & (2 * like.sum(axis=0) <= len(frames))).any(axis=1).tolist()
    last: list[NDArray[np.float32]] = []
    last_index = -LONGEST_REST
    for index, one, elsewhere in zip(frames, seen, is_elsewhere, strict=True):
        if not (elsewhere or one.is_near or known.get(index, False)):
            continue
        is_same = index - last_index < LONGEST_REST and _looks_like(one.bands, last, noise)
        if is_same and index not in known:
            resting[index] = True
            continue
        read[index] = True
        last, last_index = one.bands, index
    # The frames next to a change are read as well: the last one before it and the first after.
    for index in np.flatnonzero(read).tolist():
        for beside in (index - 1, index + 1):
            is_left_out = 0 <= beside < len(read) and wanted[beside] and not read[beside]
            if is_left_out and not resting[beside]:
                read[beside] = True
    # A stretch of rest needs a frame that is read at both ends.
    edges = np.flatnonzero(resting[:-1] & ~resting[1:] & ~read[1:])
    read[edges] = True
    resting[edges] = False
    if resting[-1]:
        read[-1], resting[-1] = True, False
    return ReadingPlan(read, resting)


@dataclass(frozen=True)
class _RowsSeen:
    """What some rows of a frame show.

    ``bands`` (column,) [grey levels]: Means over the rows of each band. ``is_near``: One of them is as a contact near
    its centre. ``is_like``: Of places all over the frame, which are as a contact in two rows next to each other.
    """

    bands: list[NDArray[np.float32]]
    is_near: bool
    is_like: Flags


def _look_at_rows(
    reader: FilmReader, frames: list[int], known: dict[int, bool], places: Sequence[Place]
) -> tuple[list[_RowsSeen], float]:
    """Look at the rows of every frame, all at once since a film may decode it whole; with the noise of known ones.

    Bands pass through the known centres. A body may come down elsewhere: of rows that far apart two next to each
    other cross every circle that is not much smaller than those known, and no fringe, which is narrow.
    """
    height = reader.film.shape[1]
    tops = sorted({_band_about(place.y, height) for place in places})
    through = [[place for place in places if _band_about(place.y, height) == top] for top in tops]
    step = max(round(_ROW_OF * float(np.median([place.radius for place in places]))), 1)
    rows = range(step // 2, height, step)
    seen, of_known = [], []
    for index in frames:
        grey = np.array([_means(reader.band(index, row, row + 1)[0])[:: _PLACE // 2] for row in rows])
        level = float(np.median(grey))
        like = np.any([place.is_like(grey, level) for place in places], axis=0)
        bands = [reader.band(index, *top) for top in tops]
        of_known += bands if index in known else []
        lines = [band.mean(axis=0) for band in bands]
        here = zip(lines, through, strict=True)
        is_near = any(place.may_be_in(line, level) for line, some in here for place in some)
        seen.append(_RowsSeen(lines, is_near, (like[1:] & like[:-1]).ravel()))
    # of a mean over the rows of bands, from neighbours in them; fringes raise it a little
    steps = np.concatenate([np.abs(np.diff(band, axis=0)) for band in of_known])
    return seen, max(float(np.median(steps)) / 0.954, 0.3) / math.sqrt(len(of_known[0]))


def _means(line: NDArray[np.float32] | Floats) -> Floats:
    """Mean grey levels of all places of a line (column,)."""
    width = min(_PLACE, len(line))
    sums = np.concatenate([[0.0], np.cumsum(line, dtype=np.float64)])
    return np.asarray((sums[width:] - sums[:-width]) / width)


def _looks_like(now: list[NDArray[np.float32]], other: list[NDArray[np.float32]], noise: float) -> bool:
    """Tell whether bands, means over rows (column,) with their noise, show nothing but that which others do not."""
    for a, b in zip(now, other, strict=bool(other)):
        difference, deviation = (a - b).astype(np.float64), noise * math.sqrt(2.0)
        columns = len(difference)
        squares, width = float((difference**2).sum()) / deviation**2, min(_PLACE, columns)
        is_local = float(np.abs(_means(difference)).max()) * math.sqrt(width) / deviation > _LOCALLY_DIFFERENT
        if is_local or squares > columns + _DIFFERENT * math.sqrt(2.0 * columns):
            return False
    return bool(other)
