"""Films that were exported as images: a folder of PNG or TIFF, a multipage TIFF, or an AVI.

Such files hold no time: the frame rate must be said. Gain, brightness and gamma may have been
baked in by the exporting program, so intensities are not calibrated.
"""

import os
import re
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from instruments.images._headers import CutOffError, ImageHeader, png_fault, read_headers
from labpipe import files
from labpipe.errors import InputError, SourceError
from labpipe.frames import ShownFrames

_SUFFIXES = (".png", ".tif", ".tiff")
_NUMBER = re.compile(r"-?\d+")
#: Bits of 16 that cameras of 14, 12 and 10 bits leave empty, fewest last; and frames that are looked at for it.
_UNUSED_BITS, _LOOKED_AT = (6, 4, 2), 9
_NEEDS_RATE = "Images hold no time: give the camera's frame rate, fps=10000 (in session.toml: frame_rate)."
# Of a film that was cut off the decoders print, for every image, that its end is missing; we tell it once.
# OpenCV 5 moved the switch; 0 is silent in both.
(cv2.setLogLevel if hasattr(cv2, "setLogLevel") else cv2.utils.logging.setLogLevel)(0)
os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")


@dataclass(frozen=True, slots=True)
class _Place:
    """Where one image is: its file and, in a file of several, its page."""

    path: Path
    page: int
    header: ImageHeader


def read(
    path: str | os.PathLike[str], *, fps: float | None = None, exposure: float | None = None
) -> "ImageFrames | VideoFrames":
    """Open a folder of images, a multipage TIFF, or an AVI.

    Parameters
    ----------
    path : path-like
    fps : float [1/s]
        Frame rate of the camera; required, as the files do not know it.
    exposure : float, optional [s]

    Returns
    -------
    FrameSource
        Lazy frames; the first frame has time 0.

    Raises
    ------
    SourceError
        There are no images, they differ in size, are colour, or declare impossible sizes.
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
        message = f"{path}: no frame rate. {_NEEDS_RATE}"
        raise InputError(message)
    if not (np.isfinite(fps) and fps > 0):
        message = f"{path}: the frame rate must be positive, found {fps}"
        raise InputError(message)
    if path.is_file() and path.suffix.lower() not in _SUFFIXES and not _is_tiff(path):
        return VideoFrames(path, fps, exposure)
    places, numbers = _folder(path) if path.is_dir() else _pages(path)
    _check_alike(places)
    _warn_of_cut(path, places)
    film = ImageFrames(places, (numbers - numbers[0]) / fps, exposure)
    if not (places[0].header.is_grey or places[0].header.fault):
        film[0]  # what is in colour is refused before it is measured
    return film


def _is_tiff(path: Path) -> bool:
    from instruments.images._headers import is_tiff

    with path.open("rb") as stream:
        return is_tiff(stream.read(8))


def _folder(folder: Path) -> tuple[list[_Place], NDArray[np.float64]]:
    """Sort the images by the last number of their names and warn of gaps."""
    named = [p for p in files.files_below(folder) if p.suffix.lower() in _SUFFIXES]
    named = [p for p in named if p.parent == folder]
    if not named:
        raise SourceError(folder, f"the folder holds no image ({', '.join(_SUFFIXES)})")
    numbered = sorted(zip(_numbers(named), named, strict=True))
    numbers = np.array([number for number, _ in numbered])
    twice = np.flatnonzero(np.diff(numbers) == 0)
    if len(twice):
        raise SourceError(
            numbered[twice[0] + 1][1],
            f"number {numbers[twice[0]]} occurs twice, also in {numbered[twice[0]][1].name}",
            hint="Put only the images of one film into the folder.",
        )
    paths = [path for _, path in numbered]
    read_all = [_header(path) for path in paths]
    whole = next((header for header in read_all if isinstance(header, ImageHeader)), None)
    if whole is None:
        raise next(error for error in read_all if isinstance(error, CutOffError))
    headers = [each if isinstance(each, ImageHeader) else whole._replace(fault=each.message) for each in read_all]
    _warn_of_gaps(folder, numbers)
    return [_Place(path, 0, header) for path, header in zip(paths, headers, strict=True)], numbers.astype(float)


def _numbers(paths: Sequence[Path]) -> list[int]:
    """Read the places of images from their names: the last of the numbers that are not all the same.

    Names may end in what holds for the whole film, such as its frame rate or its bits.
    """
    found = [[_signed(path.stem, match) for match in _NUMBER.finditer(path.stem)] for path in paths]
    for path, values in zip(paths, found, strict=True):
        if not values:
            raise SourceError(
                path,
                "the image has no number in its name, so its place in the film is unknown",
                hint="Name images like frame_0001.png.",
            )
    shared = min(map(len, found))
    place = next((k for k in range(-1, -shared - 1, -1) if len({values[k] for values in found}) > 1), -1)
    return [values[place] for values in found]


def _header(path: Path) -> ImageHeader | CutOffError:
    """Return the header of a file's one image, or that it ends before it."""
    try:
        headers = read_headers(path)
    except CutOffError as error:
        return error
    if len(headers) != 1:
        raise SourceError(path, f"holds {len(headers)} images, expected one per file")
    return headers[0]


def _signed(stem: str, found: "re.Match[str]") -> int:
    """Read the number; a minus sign counts only where it cannot be a hyphen between words."""
    text = found.group()
    is_hyphen = text.startswith("-") and found.start() > 0 and stem[found.start() - 1].isalnum()
    return int(text.removeprefix("-") if is_hyphen else text)


def _warn_of_gaps(folder: Path, numbers: NDArray[np.int64]) -> None:
    steps = np.diff(numbers)
    usual = int(np.min(steps)) if len(steps) else 1
    missing = int(np.sum(steps // usual - 1))
    if missing:
        first = int(numbers[int(np.flatnonzero(steps > usual)[0])])
        warnings.warn(
            f"{folder.name}: {missing} images are missing, the first after number {first}; times "
            "follow the numbers, so the film has gaps",
            UserWarning,
            stacklevel=4,
        )


def _pages(path: Path) -> tuple[list[_Place], NDArray[np.float64]]:
    places = [_Place(path, i, header) for i, header in enumerate(read_headers(path))]
    return places, np.arange(len(places), dtype=float)


def _warn_of_cut(path: Path, places: Sequence[_Place]) -> None:
    """Warn of images that are not whole, as after a copy that broke off."""
    cut = [place for place in places if place.header.fault]
    if cut:
        warnings.warn(
            f"{path.name}: {len(cut)} of {len(places)} images are not whole, the first {cut[0].path.name}: "
            f"{cut[0].header.fault}; they are left out. Copy the film from the camera again",
            UserWarning,
            stacklevel=4,
        )


def _check_alike(places: Sequence[_Place]) -> None:
    first = places[0].header
    for place in places:
        if place.header[:3] != first[:3]:
            rows, columns, bits, *_ = place.header
            raise SourceError(
                place.path,
                f"image {place.page}: {columns} × {rows} px of {bits} bits, but the first of the "
                f"film has {first.columns} × {first.rows} px of {first.bits} bits",
                hint="Put only the images of one film into the folder.",
            )


class ImageFrames(ShownFrames):
    """Images in files as frames; one is decoded when it is asked for."""

    def __init__(
        self,
        places: Sequence[_Place],
        time: NDArray[np.float64],
        exposure: float | None,
        rows: slice = slice(None),
        columns: slice = slice(None),
        faults: dict[int, str] | None = None,
    ) -> None:
        header = places[0].header
        self._faults = {} if faults is None else faults  # views of one film share what is known
        self._places, self._time, self._exposure = list(places), time, exposure
        self._rows, self._columns = range(header.rows)[rows], range(header.columns)[columns]
        if not self._rows or not self._columns or self._rows.step != 1 or self._columns.step != 1:
            message = f"the region of interest {rows}, {columns} is no rectangle of the image"
            raise InputError(message)

    @property
    def time(self) -> NDArray[np.float64]:
        """Time of every frame in s, from the numbers and the frame rate."""
        return self._time

    @property
    def exposure(self) -> NDArray[np.float64] | None:
        """Exposure of every frame in s, or None."""
        return None if self._exposure is None else np.full(len(self), self._exposure)

    @property
    def shape(self) -> tuple[int, int, int]:
        """Number of frames, rows, columns."""
        return len(self), len(self._rows), len(self._columns)

    @property
    def valid(self) -> NDArray[np.bool_]:
        """False for images that are cut off, or that contradict their own checksums."""
        return np.array([not self._fault(index) for index in range(len(self))])

    def _fault(self, index: int) -> str:
        if index not in self._faults:
            place = self._places[index]
            is_png = place.path.suffix.lower() == ".png"
            self._faults[index] = place.header.fault or (png_fault(place.path) if is_png else "")
        return self._faults[index]

    @cached_property
    def levels(self) -> tuple[float, float]:
        """Range of the bits in use: cameras of 10 to 14 bits fill the lower or the upper bits of 16."""
        bits = self._places[0].header.bits
        sound = np.flatnonzero(self.valid) if bits == 16 else np.empty(0, int)
        if not sound.size:
            return 0.0, float(2**bits - 1)
        spread = np.unique(np.linspace(0, sound.size - 1, _LOOKED_AT).round().astype(int))
        used = int(np.bitwise_or.reduce([np.bitwise_or.reduce(self._whole(int(i)), axis=None) for i in sound[spread]]))
        lowest = (used & -used).bit_length() - 1 if used else 0
        if lowest > 1:
            return 0.0, float(2**bits - 2**lowest)
        return 0.0, float(2 ** next(bits - k for k in (*_UNUSED_BITS, 0) if used < 2 ** (bits - k)) - 1)

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self._places)

    def __getitem__(self, index: int) -> NDArray[np.integer[Any]]:
        """Decode one frame."""
        if not -len(self) <= index < len(self):
            message = f"frame {index} of {len(self)}"
            raise IndexError(message)
        image = self._whole(index % len(self))
        return image[self._rows.start : self._rows.stop, self._columns.start : self._columns.stop]

    def _whole(self, index: int) -> NDArray[np.integer[Any]]:
        place = self._places[index]
        if fault := self._fault(index):
            raise SourceError(place.path, fault, hint="Use the frames marked in `.valid`.")
        image = _decode(place)
        expected = (place.header.rows, place.header.columns)
        if image is None or image.shape[:2] != expected:
            found = "nothing" if image is None else f"an image of shape {image.shape}"
            raise SourceError(place.path, f"decodes to {found}, expected {expected}")
        return image if image.ndim == 2 else _grey(image, 0, place.path, "the image")

    def __iter__(self) -> Iterator[NDArray[np.integer[Any]]]:
        """Go through the frames in order."""
        return (self[i] for i in range(len(self)))

    def roi(self, rows: slice, columns: slice) -> "ImageFrames":
        """Return a view of a rectangle; a compressed image is decoded whole all the same."""
        inner, across = self._rows[rows], self._columns[columns]
        return ImageFrames(
            self._places,
            self._time,
            self._exposure,
            slice(inner.start, inner.stop, inner.step),
            slice(across.start, across.stop, across.step),
            self._faults,
        )


def _grey(image: NDArray[Any], allowed: int, path: Path, what: str) -> NDArray[Any]:
    """Return the one intensity of an image whose colours say the same."""
    colours = image[:, :, :3].astype(np.int32)
    if int(np.ptp(colours, axis=2).max()) > allowed:
        raise SourceError(
            path,
            f"{what} is in colour, expected grey",
            hint="A colour image has no single intensity; export the film as grey.",
        )
    return image[:, :, 1]


def _decode(place: _Place) -> NDArray[Any] | None:
    if place.page:
        is_done, pages = cv2.imreadmulti(str(place.path), place.page, 1, flags=cv2.IMREAD_UNCHANGED)
        image = pages[0] if is_done and pages else None
    else:
        data = np.fromfile(place.path, np.uint8)  # names of any letters; imread takes ASCII only
        image = cv2.imdecode(data, cv2.IMREAD_UNCHANGED)
    if image is None:
        return None
    # packed pixels are decoded to the upper bits of 16
    unused = 16 - place.header.bits if image.dtype == np.uint16 else 0
    return np.right_shift(image, unused) if unused else np.asarray(image)


#: Where an AVI holds the name of its main header, and its number of frames.
_HEADER_AT, _FRAMES_AT = 24, 48


def _declared_frames(path: Path) -> int:
    """Read how many frames an AVI says it holds, 0 for what is none: a decoder counts those that it finds."""
    with path.open("rb") as stream:
        head = stream.read(_FRAMES_AT + 4)
    if len(head) < _FRAMES_AT + 4 or head[:4] != b"RIFF" or head[_HEADER_AT : _HEADER_AT + 4] != b"avih":
        return 0
    return int.from_bytes(head[_FRAMES_AT:], "little")


_ROUNDED = 4  # levels by which codecs of grey video round the three colours apart
#: Frames at the end of a video whose last rows are compared, and rows.
_COMPARED, _LAST_ROWS = 3, 4


class VideoFrames(ShownFrames):
    """Frames of a video file, for what an AVI is worth: baked levels, 8 bit, no times."""

    def __init__(self, path: Path, fps: float, exposure: float | None) -> None:
        self._path = path
        self._video = cv2.VideoCapture(str(path))
        sizes = (cv2.CAP_PROP_FRAME_COUNT, cv2.CAP_PROP_FRAME_HEIGHT, cv2.CAP_PROP_FRAME_WIDTH)
        count, rows, columns = (int(self._video.get(p)) for p in sizes)
        if not self._video.isOpened() or count < 1:
            raise SourceError(path, "the video cannot be decoded, or holds no frame")
        if rows * columns > 1 << 26:
            raise SourceError(path, f"declares {columns} × {rows} px")
        playback = self._video.get(cv2.CAP_PROP_FPS)
        warnings.warn(
            f"{path.name}: a video has its levels baked in (gain, brightness, gamma), so its "
            f"intensities are not calibrated; its own {playback:g} frames a second are the rate of "
            f"playback, the times here follow the stated {fps:g}",
            UserWarning,
            stacklevel=4,
        )
        declared = max(count, _declared_frames(path))
        self._count, self._size, self._fps = self._countable(declared), (rows, columns), fps
        self._exposure = exposure
        self._rows, self._columns = range(rows), range(columns)
        self._next = 0

    def _countable(self, declared: int) -> int:
        """Count the frames that there are; a container's count is only a claim."""
        count = 0
        while count < declared and self._video.grab():
            count += 1
        count -= self._has_broken_end(count)
        self._video.set(cv2.CAP_PROP_POS_FRAMES, 0)
        if count < declared:
            warnings.warn(
                f"{self._path.name}: {declared} frames are declared, {count} can be read: the copy may have broken off",
                UserWarning,
                stacklevel=5,
            )
        if not count:
            raise SourceError(self._path, "no frame of the video can be decoded")
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

    @property
    def time(self) -> NDArray[np.float64]:
        """Time of every frame in s, by the stated rate."""
        return np.arange(self._count) / self._fps

    @property
    def exposure(self) -> NDArray[np.float64] | None:
        """Exposure of every frame in s, or None."""
        return None if self._exposure is None else np.full(self._count, self._exposure)

    @property
    def shape(self) -> tuple[int, int, int]:
        """Number of frames, rows, columns."""
        return self._count, len(self._rows), len(self._columns)

    @property
    def valid(self) -> NDArray[np.bool_]:
        """All true: frames that cannot be decoded are not counted."""
        return np.ones(self._count, dtype=bool)

    @property
    def levels(self) -> tuple[float, float]:
        """Range of 8 bit."""
        return 0.0, 255.0

    def __len__(self) -> int:
        """Return the number of frames."""
        return self._count

    def __getitem__(self, index: int) -> NDArray[np.integer[Any]]:
        """Decode one frame; in order it is fast."""
        if not -self._count <= index < self._count:
            message = f"frame {index} of {self._count}"
            raise IndexError(message)
        index %= self._count
        if index != self._next:
            self._video.set(cv2.CAP_PROP_POS_FRAMES, index)
        is_read, image = self._video.read()
        self._next = index + 1
        if not is_read or image.shape[:2] != self._size:
            raise SourceError(self._path, f"frame {index} cannot be decoded")
        part = image[self._rows.start : self._rows.stop, self._columns.start : self._columns.stop]
        return np.ascontiguousarray(part if part.ndim == 2 else _grey(part, _ROUNDED, self._path, f"frame {index}"))

    def __iter__(self) -> Iterator[NDArray[np.integer[Any]]]:
        """Go through the frames in order."""
        return (self[i] for i in range(self._count))

    def roi(self, rows: slice, columns: slice) -> "VideoFrames":
        """Return a view of a rectangle; frames are decoded whole all the same."""
        view = object.__new__(VideoFrames)
        view.__dict__.update(self.__dict__)
        view._rows, view._columns = self._rows[rows], self._columns[columns]
        view._video, view._next = cv2.VideoCapture(str(self._path)), 0
        if not view._rows or not view._columns:
            message = f"the region of interest {rows}, {columns} holds no pixel"
            raise InputError(message)
        return view
