"""Films that were exported as images or as a video: frames of what a decoder gives.

Such files hold no time: the frame rate must be said. Gain, brightness and gamma may have been
baked in by the exporting program, so intensities are not calibrated.
"""

import os
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from instruments.images._files import folder_images, pages
from instruments.images._headers import is_tiff
from instruments.images._names import SUFFIXES
from instruments.images._pictures import CHANNELS, Channel, Pictures
from instruments.images._video import Video
from labpipe.arrays import Flags, Floats
from labpipe.errors import InputError
from labpipe.frames import ShownFrames

NEEDS_RATE = "Images hold no time: give the camera's frame rate, fps=10000 (in session.toml: frame_rate)."


def read(
    path: str | os.PathLike[str],
    *,
    fps: float | None = None,
    exposure: float | None = None,
    channel: Channel | None = None,
) -> "ExportedFrames":
    """Open a folder of images, a multipage TIFF, or a video.

    Parameters
    ----------
    path : path-like
    fps : float [1/s]
        Frame rate of the camera; required, as the files do not know it.
    exposure : float, optional [s]
    channel : {"red", "green", "blue"}, optional
        Of colour images; without it their colours must be equal.

    Returns
    -------
    FrameSource
        Lazy frames; the first frame has time 0.

    Raises
    ------
    SourceError
        There are no images, they differ in size, are in colour without a channel, or declare impossible sizes.
    InputError
        The frame rate is missing or not positive.

    Warns
    -----
    UserWarning
        Numbers are missing in the names of the images; images are cut off; a video's levels and rate
        are not the camera's.
    """
    path = Path(path)
    if fps is None:
        raise InputError(f"{path}: no frame rate. {NEEDS_RATE}")
    if not (np.isfinite(fps) and fps > 0):
        raise InputError(f"{path}: the frame rate must be positive, found {fps}")
    if channel is not None and channel not in CHANNELS:
        raise InputError(f'{path}: channel must be "red", "green" or "blue", found "{channel}"')
    pictures, numbers = _opened(path, channel)
    film = ExportedFrames(pictures, numbers / fps, exposure)
    first = next((i for i in range(len(film)) if not pictures.fault(i)), None)
    if first is not None:
        film[first]  # what is in colour, or of an unknown compression, is refused before it is measured
    return film


def _opened(path: Path, channel: Channel | None) -> tuple[Pictures, Floats]:
    """Open what a path holds, with the number of each of its images from the first."""
    if path.is_dir():
        images, numbers = folder_images(path, channel)
        return images, numbers - numbers[0]
    if path.suffix.lower() in SUFFIXES or _is_tiff(path):
        images = pages(path, channel)
        return images, np.arange(len(images), dtype=float)
    video = Video(path, channel)
    return video, np.arange(len(video), dtype=float)


def _is_tiff(path: Path) -> bool:
    with path.open("rb") as stream:
        return is_tiff(stream.read(8))


class ExportedFrames(ShownFrames):
    """What a decoder gives, as frames with times; one is decoded when it is asked for.

    ``time`` (frame,) and ``exposure`` are in s; ``rows`` and ``columns`` a part of the images, all by default.
    ``last`` is the image that was decoded last, by its index: parts of one image are mostly asked for in a row.
    """

    def __init__(
        self,
        pictures: Pictures,
        time: Floats,
        exposure: float | None,
        rows: range | None = None,
        columns: range | None = None,
        last: "dict[int, NDArray[np.integer[Any]]] | None" = None,
    ) -> None:
        self._pictures, self._time, self._exposure = pictures, time, exposure
        self._last = {} if last is None else last
        self._rows = range(pictures.size[0]) if rows is None else rows
        self._columns = range(pictures.size[1]) if columns is None else columns
        if not self._rows or not self._columns or self._rows.step != 1 or self._columns.step != 1:
            raise InputError(f"the region of interest {self._rows}, {self._columns} is no rectangle of the image")

    @property
    def time(self) -> Floats:
        """Time of every frame in s, from the numbers and the frame rate."""
        return self._time

    @property
    def exposure(self) -> Floats | None:
        """Exposure of every frame in s, or None."""
        return None if self._exposure is None else np.full(len(self), self._exposure)

    @property
    def shape(self) -> tuple[int, int, int]:
        """Number of frames, rows, columns."""
        return len(self._time), len(self._rows), len(self._columns)

    @cached_property
    def valid(self) -> Flags:
        """False for images that are cut off, contradict their own checksums or cannot be decoded."""
        return self._pictures.valid

    @property
    def levels(self) -> tuple[float, float]:
        """Black and white level."""
        return self._pictures.levels

    def __getitem__(self, index: int) -> NDArray[np.integer[Any]]:
        """Decode one frame; those of a video fastest in order."""
        if not -len(self) <= index < len(self):
            raise IndexError(f"frame {index} of {len(self)}")
        index %= len(self)
        image = self._last.get(index)
        if image is None:
            image = self._pictures.whole(index)
            self._last.clear()
            self._last[index] = image
        return image[self._rows.start : self._rows.stop, self._columns.start : self._columns.stop].copy()

    def roi(self, rows: slice, columns: slice) -> "ExportedFrames":
        """Return a view of a rectangle; an image is decoded whole all the same."""
        shown = self._rows[rows], self._columns[columns]
        return ExportedFrames(self._pictures, self._time, self._exposure, *shown, self._last)
