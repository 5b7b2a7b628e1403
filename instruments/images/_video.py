"""Videos by OpenCV's decoders, for what they are worth: baked levels, 8 bit, no times."""

import os
from pathlib import Path
from threading import Lock
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from instruments.images._pictures import ROUNDED, SMOOTHED, Channel, one_intensity
from labpipe.arrays import Flags
from labpipe.errors import SourceError, SourceWarning, warn_of
from labpipe.frames import IncompleteFilmWarning, SmoothedFilmWarning

# Of a film that was cut off the decoders print, for every image, that its end is missing; we tell it once.
# OpenCV 5 moved the switch; 0 is silent in both.
(cv2.setLogLevel if hasattr(cv2, "setLogLevel") else cv2.utils.logging.setLogLevel)(0)
os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
#: Where an AVI holds the name of its main header, and its number of frames.
_HEADER_AT, _FRAMES_AT = 24, 48
_MOST_PIXELS = 1 << 26
#: Frames at the end of a video whose last rows are compared, and rows.
_COMPARED, _LAST_ROWS = 3, 4
#: Frames ahead to which it is quicker to decode than to seek.
_AHEAD = 16
#: Bytes in which the format of an AVI's pixels is declared, and names of formats without compression.
_LONGEST_HEAD = 1 << 16
_BARE = (b"\0\0\0\0", b"DIB ", b"RAW ", b"Y800", b"Y8  ", b"GREY")
#: Codecs that give back what went in.
_LOSSLESS = ("FFV1", "HFYU", "FFVH", "MPNG")


def warn_of_video(path: Path, playback: float, codec: str = "") -> None:
    """Warn that neither levels nor times of a video are the camera's, nor details where its codec loses them."""
    lossy = f"; its compression ({codec}) {SMOOTHED}"
    warn_of(
        path.name,
        f"a video has its levels baked in (gain, brightness, gamma), so its "
        f"intensities are not calibrated; its own {playback:g} frames a second are the rate of "
        f"playback, and not used{lossy * bool(codec)}",
        category=SmoothedFilmWarning if codec else SourceWarning,
    )


class Video:
    """Frames of a video file; every one that is counted was found."""

    def __init__(self, path: Path, channel: Channel | None = None) -> None:
        self._path, self._lock, self._channel = path, Lock(), channel
        _refuse_uncompressed(path)
        self._video = cv2.VideoCapture(str(path))
        sizes = (cv2.CAP_PROP_FRAME_COUNT, cv2.CAP_PROP_FRAME_HEIGHT, cv2.CAP_PROP_FRAME_WIDTH)
        count, rows, columns = (int(self._video.get(p)) for p in sizes)
        if not self._video.isOpened() or count < 1:
            raise SourceError(
                path,
                "the video cannot be decoded, or holds no frame",
                hint="It may not have been copied whole: an MP4 has its index at its end. Copy it again, or export "
                "the film as images.",
            )
        if rows * columns > _MOST_PIXELS:
            raise SourceError(path, f"declares {columns} × {rows} px")
        self.size, self.levels = (rows, columns), (0.0, 255.0)
        code = int(self._video.get(cv2.CAP_PROP_FOURCC)).to_bytes(4, "little").decode("latin-1").strip("\0 ")
        warn_of_video(path, self._video.get(cv2.CAP_PROP_FPS), "" if code.upper() in _LOSSLESS else code)
        self._at, self._image = -1, np.empty((0, 0), np.uint8)
        self._count = self._countable(max(count, _declared_frames(path)))

    @property
    def valid(self) -> Flags:
        """All true: frames that cannot be decoded are not counted."""
        return np.ones(self._count, dtype=bool)

    def __len__(self) -> int:
        """Return the number of frames."""
        return self._count

    def fault(self, index: int) -> str:
        """Return "": frames that cannot be decoded are not counted."""
        del index
        return ""

    def whole(self, index: int) -> NDArray[np.integer[Any]]:
        """Decode one frame; in order it is fast."""
        with self._lock:  # a decoder has one place in its file, and films are read by several threads
            image = self._image if index == self._at else self._decoded(index)
        return np.ascontiguousarray(one_intensity(image, ROUNDED, self._path, f"frame {index}", self._channel))

    def _decoded(self, index: int) -> NDArray[np.uint8]:
        if not self._at < index <= self._at + _AHEAD:
            self._video.set(cv2.CAP_PROP_POS_FRAMES, index)
        else:
            for _ in range(index - self._at - 1):
                self._video.grab()
        is_read, image = self._video.read()
        self._at = index
        if not is_read or image.shape[:2] != self.size:
            self._at = -1 - _AHEAD
            raise SourceError(
                self._path, f"frame {index} cannot be decoded", hint="Copy the video again, or export it as images."
            )
        self._image = np.asarray(image, np.uint8)
        return self._image

    def _countable(self, declared: int) -> int:
        """Count the frames that there are; a container's count is only a claim."""
        count = 0
        while count < declared and self._video.grab():
            count += 1
        count -= self._has_broken_end(count)
        self._video.set(cv2.CAP_PROP_POS_FRAMES, 0)
        if count < declared:
            warn_of_lost(self._path, declared, count)
        if not count:
            raise SourceError(self._path, "no frame of the video can be decoded", hint="Copy it from the camera again.")
        return count

    def _has_broken_end(self, count: int) -> bool:
        """Tell whether the last frame breaks off: the decoder fills it up with the one before.

        Compressed films repeat rows where nothing moves; then the frames before do as well.
        """
        if count < _COMPARED:
            return False
        self._video.set(cv2.CAP_PROP_POS_FRAMES, count - _COMPARED)
        ends: list[NDArray[Any]] = []
        for _ in range(_COMPARED):
            is_read, image = self._video.read()
            if not is_read:
                return len(ends) == _COMPARED - 1
            ends.append(image[-_LAST_ROWS:])
        return bool(np.array_equal(ends[1], ends[2]) and not np.array_equal(ends[0], ends[1]))


def _refuse_uncompressed(path: Path) -> None:
    """Refuse an AVI of bare pixels, over which OpenCV 5 damages its memory and ends the program."""
    with path.open("rb") as stream:
        head = stream.read(_LONGEST_HEAD)
    at = head.find(b"strf")
    if head[:4] == b"RIFF" and at > 0 and head[at + 24 : at + 28].upper() in _BARE:
        hint = "Export the film as TIFF or PNG images, or compress it without loss (FFV1)."
        raise SourceError(path, "an AVI without compression is not read", hint=hint)


def warn_of_lost(path: Path, declared: int, count: int) -> None:
    """Warn of frames that a video declares and does not hold."""
    warn_of(
        path.name,
        f"{declared} frames are declared, {count} can be read: the copy may have broken off. "
        "Copy the film from the camera again",
        category=IncompleteFilmWarning,
    )


def _declared_frames(path: Path) -> int:
    """Read how many frames an AVI says it holds, 0 for what is none: a decoder counts those that it finds."""
    with path.open("rb") as stream:
        head = stream.read(_FRAMES_AT + 4)
    if len(head) < _FRAMES_AT + 4 or head[:4] != b"RIFF" or head[_HEADER_AT : _HEADER_AT + 4] != b"avih":
        return 0
    return int.from_bytes(head[_FRAMES_AT:], "little")
