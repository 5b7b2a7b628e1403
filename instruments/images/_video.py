"""Videos by OpenCV's decoders: baked levels, 8 bit, no times."""

import os
from pathlib import Path
from threading import Lock
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from instruments.images._files import ROUNDED, SMOOTHED, Channel, ExportedFrames, one_intensity
from labpipe.arrays import Flags
from labpipe.errors import SourceError, SourceWarning, warn_of
from labpipe.frames import IncompleteFilmWarning, SmoothedFilmWarning

# One warning says that a film was cut off; OpenCV 5 moved the switch, 0 is silent in both.
(cv2.setLogLevel if hasattr(cv2, "setLogLevel") else cv2.utils.logging.setLogLevel)(0)
os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
_AHEAD = 16  # frames to which it is quicker to decode than to seek
_EXPORT = "Export the film as TIFF or PNG images, or give the camera's own file."
#: Formats of an AVI's pixels without compression, and codecs that give back their input.
_BARE, _LOSSLESS = (b"\0\0\0\0", b"DIB ", b"RAW ", b"Y800", b"Y8  ", b"GREY"), ("FFV1", "HFYU", "FFVH", "MPNG")


class Video(ExportedFrames):
    """Frames of a video file; every one that is counted was found."""

    levels = 0.0, 255.0

    def __init__(self, path: Path, channel: Channel | None) -> None:
        self._lock = Lock()
        with path.open("rb") as stream:
            head = stream.read(1 << 16)
        at = head.find(b"strf")  # the format of the pixels
        if head[:4] == b"RIFF" and at > 0 and head[at + 24 : at + 28].upper() in _BARE:
            # OpenCV 5 damages its memory over such a file and ends the program.
            raise SourceError(path, "an AVI without compression is not read", hint=_EXPORT)
        self._video = cv2.VideoCapture(str(path))
        sizes = (cv2.CAP_PROP_FRAME_COUNT, cv2.CAP_PROP_FRAME_HEIGHT, cv2.CAP_PROP_FRAME_WIDTH)
        declared, rows, columns = (int(self._video.get(p)) for p in sizes)
        if not self._video.isOpened() or declared < 1:
            hint = f"It may not have been copied whole: an MP4 has its index at its end. {_EXPORT}"
            raise SourceError(path, "the video cannot be decoded, or holds no frame", hint=hint)
        if head[:4] == b"RIFF" and head[24:28] == b"avih":  # a decoder counts those that it finds
            declared = max(declared, int.from_bytes(head[48:52], "little"))
        code = int(self._video.get(cv2.CAP_PROP_FOURCC)).to_bytes(4, "little").decode("latin-1").strip("\0 ")
        is_lossy = code.upper() not in _LOSSLESS
        text = (
            "a video has its levels baked in (gain, brightness, gamma), so its intensities are not calibrated; its own "
            f"{self._video.get(cv2.CAP_PROP_FPS):g} frames a second are the rate of playback, and not used"
        )
        text += f"; its compression ({code}) {SMOOTHED}" if is_lossy else ""
        warn_of(path.name, text, category=SmoothedFilmWarning if is_lossy else SourceWarning)
        count = 0
        while count < declared and self._video.grab():  # a container's count is only a claim
            count += 1
        if not count:
            raise SourceError(path, "no frame of the video can be decoded", hint=_EXPORT)
        super().__init__(path, count, (rows, columns), channel)
        self._at = [count]  # the next frame of the decoder, which all views share
        self.valid: Flags = np.ones(count, dtype=bool)  # those that cannot be decoded are not counted
        if count < declared:
            text = f"{declared} frames are declared, {count} can be read: the copy may have broken off. "
            warn_of(path.name, text + "Copy the film from the camera again", category=IncompleteFilmWarning)

    def whole(self, index: int) -> NDArray[np.integer[Any]]:
        """Decode one frame; in order it is fast."""
        with self._lock:  # a decoder has one place in its file, and films are read by several threads
            if not self._at[0] <= index <= self._at[0] + _AHEAD:
                self._video.set(cv2.CAP_PROP_POS_FRAMES, index)
                self._at[0] = index
            for _ in range(index - self._at[0]):
                self._video.grab()
            is_read, image = self._video.read()
            self._at[0] = index + 1 if is_read else self._count
            if not is_read or image.shape[:2] != self._size:
                raise SourceError(self._path, f"frame {index} cannot be decoded", hint=_EXPORT)
        grey = one_intensity(np.asarray(image, np.uint8), ROUNDED, self._path, f"frame {index}", self._channel)
        return np.ascontiguousarray(grey)
