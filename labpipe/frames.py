"""Film interface: the contract between camera readers and imaging functions."""

from collections.abc import Iterable, Iterator, Sized
from typing import Protocol, cast, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Flags, Floats
from labpipe.errors import InputError, SourceWarning
from labpipe.notebook import html_table
from labpipe.units import Quantity


class IncompleteFilmWarning(SourceWarning):
    """The file of a film lacks frames that it should hold, or holds some that are damaged."""


class SmoothedFilmWarning(SourceWarning):
    """Compression smoothed the frames of a film, by an amount that its file does not state."""


@runtime_checkable
class FrameSource(Sized, Iterable[NDArray[np.integer]], Protocol):
    """A lazy sequence of grey images; nothing is decoded before it is asked for.

    ``source[i]`` is a (row, column) array with the first row at the top, in the camera's integer type, linear in light.
    """

    @property
    def time(self) -> Floats:
        """Time of every frame in s, the trigger being 0; shape (frame,)."""

    @property
    def exposure(self) -> Floats | None:
        """Exposure time of every frame in s, shape (frame,), or None when unknown."""

    @property
    def shape(self) -> tuple[int, int, int]:
        """Number of frames, rows, columns."""

    @property
    def valid(self) -> Flags:
        """False for frames that the file damaged; shape (frame,)."""

    @property
    def levels(self) -> tuple[float, float]:
        """Black and white level in the units of the pixels."""

    def __getitem__(self, index: int) -> NDArray[np.integer]:
        """Return one frame; negative indices count from the end, IndexError beyond."""

    def roi(self, rows: slice, columns: slice) -> "FrameSource":
        """Return a view of a rectangle; rows outside are not read."""


class ShownFrames:
    """Length, iteration and representation of a film of any kind; nothing is decoded for the latter."""

    def __len__(self) -> int:
        return cast("FrameSource", self).shape[0]

    def __iter__(self) -> Iterator[NDArray[np.integer]]:
        return map(cast("FrameSource", self).__getitem__, range(len(self)))

    def __repr__(self) -> str:
        film = cast("FrameSource", self)
        rows, columns = film.shape[1:]
        size = f"film of {len(film)} frames, {rows} rows × {columns} columns"
        if not len(film):
            return size
        exposure = "" if film.exposure is None else f", exposure {Quantity(film.exposure[0], 0.0, 's')}"
        return f"{size}, {film.time[0]:.4g} to {film.time[-1]:.4g} s{exposure}"

    def _repr_html_(self) -> str:
        return html_table(repr(self), (), ())


class ArrayFrames(ShownFrames):
    """A (frame, row, column) array in memory as a :class:`FrameSource`.

    Parameters
    ----------
    images : array (frame, row, column)
        Grey levels of any integer or floating type. A frame with a level that is NaN or infinite counts as damaged.
    time : array (frame,), optional [s]
        Defaults to the frame index.
    exposure : array (frame,) or float, optional [s]
        Exposure time.
    levels : (float, float), optional
        Black and white level; default the range of the integer type, or 0 and 1.
    """

    def __init__(
        self,
        images: NDArray[np.generic],
        time: Floats | None = None,
        exposure: Floats | float | None = None,
        levels: tuple[float, float] | None = None,
    ) -> None:
        if images.ndim != 3:
            raise InputError(f"images must be (frame, row, column), found {images.ndim} dimensions")
        self._images = images
        count, rows, columns = images.shape
        self.shape = count, rows, columns
        self.time: Floats = np.arange(count, dtype=float) if time is None else np.asarray(time, float)
        given = exposure if exposure is None else np.broadcast_to(np.asarray(exposure, float), count)
        self.exposure: Floats | None = given
        largest = float(np.iinfo(str(images.dtype)).max) if images.dtype.kind in "iu" else 1.0
        self.levels = levels or (0.0, largest)

    @property
    def valid(self) -> Flags:
        """False for frames with a pixel that is no number; whole numbers always are."""
        if self._images.dtype.kind != "f":
            return np.ones(len(self), dtype=bool)
        return np.array([bool(np.isfinite(image).all()) for image in self._images], dtype=bool)

    def __getitem__(self, index: int) -> NDArray[np.integer]:
        """Return one frame."""
        return self._images[index]

    def roi(self, rows: slice, columns: slice) -> "ArrayFrames":
        """Return a view of a rectangle."""
        return ArrayFrames(self._images[:, rows, columns], self.time, self.exposure, self.levels)


def as_frames(frames: "FrameSource | NDArray[np.generic]") -> FrameSource:
    """Accept a :class:`FrameSource` or a (frame, row, column) array."""
    return ArrayFrames(frames) if isinstance(frames, np.ndarray) else frames
