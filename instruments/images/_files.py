"""Images in files: a folder of PNG, TIFF, BMP or JPEG, and the pages of a TIFF."""

import re
import warnings
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from threading import Lock
from typing import Any
from weakref import finalize

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from instruments.images import LOSSY, SUFFIXES, images_in, is_numbered
from instruments.images._colours import ROUNDED, SMOOTHED, Channel, one_intensity
from instruments.images._headers import UNREADABLE, CutOffError, ImageHeader, checksum_fault, read_headers
from labpipe.arrays import Flags, Floats
from labpipe.errors import SourceError, warn_of
from labpipe.frames import IncompleteFilmWarning, SmoothedFilmWarning

_NUMBER = re.compile(r"[-+]?\d+")
_COUNT = "Where names hold times, number the images in the order they were taken: frame_0001.png, …"
#: Bits of 16 that cameras of 14, 12 and 10 bits leave empty, fewest last; and images that are looked at for it.
_UNUSED_BITS, _LOOKED_AT = (6, 4, 2), 9


@dataclass(frozen=True, slots=True)
class _Place:
    """Where one image is: its file and, in a file of several, its page."""

    path: Path
    page: int
    header: ImageHeader


def folder_images(folder: Path, channel: Channel | None = None) -> tuple["ImageFiles", Floats]:
    """Open the images of a folder, sorted by the number in their names, and return these; warn of gaps."""
    exact, lossy = (sorted(p for p in images_in(folder, of) if p.is_file()) for of in (SUFFIXES, LOSSY))
    named = exact or lossy
    if not named:
        raise SourceError(folder, f"the folder holds no image ({', '.join(SUFFIXES + LOSSY)})")
    hint = f"Put only the images of one film into the folder. {_COUNT}"
    words = [_NUMBER.sub("#", path.stem).lower() for path in named]
    other = next((k for k, of in enumerate(words) if of != words[0] and words.count(of) > 1), None)
    if other is not None and words.count(words[0]) > 1:
        text = f"belongs to another film than {named[0].name}, as their names differ in more than their numbers"
        raise SourceError(named[other], text, hint=hint)
    numbered = sorted(zip(_numbers(named), named, strict=True))
    numbers = np.array([number for number, _ in numbered])
    steps = np.diff(numbers)
    twice = np.flatnonzero(steps == 0)
    if len(twice):
        (number, first), (_, second) = numbered[twice[0]], numbered[twice[0] + 1]
        raise SourceError(second, f"number {number} occurs twice, also in {first.name}", hint=hint)
    paths = [path for _, path in numbered]
    read_all = [_header(path) for path in paths]
    whole = next((header for header in read_all if isinstance(header, ImageHeader)), None)
    if whole is None:
        raise next(error for error in read_all if isinstance(error, CutOffError))
    headers = [each if isinstance(each, ImageHeader) else whole._replace(fault=each.message) for each in read_all]
    left_out = [path for path in lossy if exact and is_numbered(path)]
    if any(each.kind == "JPEG" for each in headers):
        text = "JPEG images have their levels baked in (gain, brightness, gamma), so their intensities are not "
        warn_of(folder.name, f"{text}calibrated; their compression {SMOOTHED}", category=SmoothedFilmWarning)
    elif left_out:
        text = f"JPEG images among the others are left out, {len(left_out)} with a number in the name, the first "
        text += f"{left_out[0].name}: if they are frames of the film, export them as the others"
        warn_of(folder.name, text)
    usual = int(np.min(steps)) if len(steps) else 1
    missing = int(np.sum(steps // usual - 1))
    if usual > 1:
        text = f"the numbers of the images go up by {usual}, so its times do by {usual} / frame rate; "
        warn_of(folder.name, text + "if every frame of the camera is here, number them one by one")
    if missing:
        after = int(numbers[int(np.flatnonzero(steps > usual)[0])])
        text = f"{'1 image is' if missing == 1 else f'{missing} images are'} missing, the first after number {after}; "
        warn_of(folder.name, text + "times follow the numbers, so the film has gaps")
    places = [_Place(path, 0, header) for path, header in zip(paths, headers, strict=True)]
    return ImageFiles(folder, places, channel), numbers.astype(float)


def pages(path: Path, channel: Channel | None = None) -> "ImageFiles":
    """Open the pages of a TIFF, or the one image of another file."""
    return ImageFiles(path, [_Place(path, i, header) for i, header in enumerate(read_headers(path))], channel)


def _numbers(paths: Sequence[Path]) -> list[int]:
    """Read the places of images from their names: the last of the numbers that counts them.

    Names may end in a number that holds for the whole film, such as its frame rate or its bits, and may hold the times
    of a clock. The numbers of frames are multiples of one step apart; times of a clock are rounded, and do not count.
    """
    has_plus = any(match.group()[0] == "+" for path in paths for match in _NUMBER.finditer(path.stem))
    found = [[_signed(path.stem, match, has_plus) for match in _NUMBER.finditer(path.stem)] for path in paths]
    unnumbered = next((path for path, values in zip(paths, found, strict=True) if not values), None)
    if unnumbered is not None:
        raise SourceError(
            unnumbered,
            "the image has no number in its name, so its place in the film is unknown",
            hint="Name images like frame_0001.png; move what is no image of the film out of the folder.",
        )
    shared = min(map(len, found))
    columns = [[values[-k] for values in found] for k in range(1, shared + 1)]
    wholly = [tuple(values[-shared:]) for values in found]
    varying = [column for column in columns if len(set(column)) > 1] or columns[:1]
    counted = next((column for column in varying if _counts(column, wholly)), None)
    if counted is None and len(set(varying[0])) == len(found):
        text = f"no number in the names counts the frames, as times of a clock do not; before it comes {paths[0].name}"
        raise SourceError(paths[-1], text, hint=_COUNT)
    return counted or varying[0]


def _counts(column: list[int], wholly: list[tuple[int, ...]]) -> bool:
    """Whether numbers are multiples of one step apart, and in the order of all numbers of their names."""
    order = sorted(range(len(column)), key=column.__getitem__)
    steps = np.diff(np.array([column[i] for i in order], dtype=object))
    is_even = not len(steps) or bool(min(steps) > 0 and not any(steps % min(steps)))
    return is_even and order == sorted(order, key=wholly.__getitem__)


def _header(path: Path) -> ImageHeader | CutOffError:
    """Return the header of a file's one image, or why there is none."""
    try:
        headers = read_headers(path)
    except CutOffError as error:
        return error
    if len(headers) != 1:
        raise SourceError(
            path,
            f"holds {len(headers)} images, expected one per file",
            hint="Name this file itself as the film, or export one image per file.",
        )
    return headers[0]


def _signed(stem: str, found: "re.Match[str]", has_plus: bool) -> int:
    """Read the number; a minus sign counts only where other names have a plus, or it cannot be a hyphen of words."""
    text = found.group()
    is_hyphen = text.startswith("-") and not has_plus and found.start() > 0 and stem[found.start() - 1].isalnum()
    return int(text.removeprefix("-") if is_hyphen else text)


class ImageFiles:
    """Images in files; damage of one is found when it is asked for.

    ``path`` is the folder or file that warnings name; ``channel`` is the one that is taken of colours.
    """

    def __init__(self, path: Path, places: Sequence[_Place], channel: Channel | None) -> None:
        first = places[0].header
        other = next((place for place in places if place.header[:3] != first[:3]), None)
        if other is not None:
            rows, columns, bits, *_ = other.header
            text = f"{f'image {other.page + 1}: ' if other.page else ''}{columns} × {rows} px of {bits} bits, but the "
            text += f"first of the film has {first.columns} × {first.rows} px of {first.bits} bits"
            raise SourceError(other.path, text, hint=f"Put only the images of one film into the folder. {_COUNT}")
        self._path, self._places, self._channel = path, places, channel
        self._faults: dict[int, str] = {}
        cut = [i for i, place in enumerate(places) if place.header.fault]
        self._warn(cut, "not whole")
        self._n_warned = len(cut)
        self._pages = _Pages(path) if places[-1].page else None

    @property
    def size(self) -> tuple[int, int]:
        """Rows and columns."""
        return self._places[0].header[:2]

    def __len__(self) -> int:
        """Return the number of images."""
        return len(self._places)

    @cached_property
    def valid(self) -> Flags:
        """False for images that are cut off, contradict their own checksums or cannot be decoded."""
        with ThreadPoolExecutor() as pool:
            faults = list(pool.map(self.fault, range(len(self))))
        bad = [i for i, fault in enumerate(faults) if fault]
        if len(bad) > self._n_warned:
            self._warn(bad, "damaged")
        return np.array([not fault for fault in faults])

    def _warn(self, bad: Sequence[int], how: str) -> None:
        """Warn of images without a value, as after a copy that broke off."""
        if not bad:
            return
        first, count = self._places[bad[0]], len(self._places)
        is_one = len({place.path for place in self._places}) == 1
        which = f"image {bad[0] + 1}" if is_one else first.path.name
        verb, named = ("is", which) if len(bad) == 1 else ("are", f"the first {which}")
        text = f"{len(bad)} of {count} images {verb} {how} and left out, {named}: {self.fault(bad[0])}. "
        warn_of(self._path.name, text + "Copy the film from the camera again", category=IncompleteFilmWarning)

    def fault(self, index: int) -> str:
        """Say why an image cannot be decoded, or ""."""
        if index not in self._faults:
            place = self._places[index]
            said = place.header.fault
            if not said and place.header.kind == "PNG":
                said = checksum_fault(place.path)
            elif not said and place.header.is_compressed and self._decoded(place) is None:
                said = "its compressed pixels cannot be decoded"
            self._faults[index] = said
        return self._faults[index]

    @cached_property
    def levels(self) -> tuple[float, float]:
        """Range of the bits in use: cameras of 10 to 14 bits fill the lower or the upper bits of 16."""
        bits = self._places[0].header.bits
        sound = np.flatnonzero(self.valid) if bits == 16 else np.empty(0, int)
        if not sound.size:
            return 0.0, float(2**bits - 1)
        spread = np.unique(np.linspace(0, sound.size - 1, _LOOKED_AT).round().astype(int))
        used = int(np.bitwise_or.reduce([np.bitwise_or.reduce(self.whole(int(i)), axis=None) for i in sound[spread]]))
        lowest = (used & -used).bit_length() - 1 if used else 0
        if lowest > 1:
            return 0.0, float(2**bits - 2**lowest)
        return 0.0, float(2 ** next(bits - k for k in (*_UNUSED_BITS, 0) if used < 2 ** (bits - k)) - 1)

    def whole(self, index: int) -> NDArray[np.integer[Any]]:
        """Decode one image."""
        place = self._places[index]
        if fault := self.fault(index):
            raise SourceError(place.path, fault, hint="Use the frames marked in `.valid`.")
        image = self._decoded(place)
        if image is None or image.shape[:2] != self.size:
            found = "nothing" if image is None else f"an image of shape {image.shape}"
            hint = "Export it again, as PNG or as a TIFF without compression."
            raise SourceError(place.path, f"decodes to {found}, expected {self.size}", hint=hint)
        allowed = ROUNDED * (place.header.kind == "JPEG")
        return one_intensity(image, allowed, place.path, "the image", self._channel)

    def _decoded(self, place: _Place) -> NDArray[Any] | None:
        return _decode(place) if self._pages is None else self._pages[place.page]


def _decode(place: _Place) -> NDArray[Any] | None:
    data = np.fromfile(place.path, np.uint8)  # names of any letters; imread takes ASCII only
    if place.header.turned:  # images stay as the sensor has them, however the camera was held
        data[place.header.turned : place.header.turned + 2] = (1, 0) if data[0] == ord("I") else (0, 1)
    image = cv2.imdecode(data, cv2.IMREAD_UNCHANGED)
    if image is None:
        return None
    # packed pixels are decoded to the upper bits of 16
    unused = 16 - place.header.bits if image.dtype == np.uint16 else 0
    return np.right_shift(image, unused) if unused else np.asarray(image)


class _Pages:
    """The pages of a TIFF in any order, by Pillow; OpenCV goes through all pages before the one that is asked for."""

    def __init__(self, path: Path) -> None:
        stream = path.open("rb")
        finalize(self, stream.close)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # of fields that are not needed
                self._lock, self._image = Lock(), Image.open(stream)
        except UNREADABLE:
            raise SourceError(path, "its pages cannot be decoded", hint="Export one image per file.") from None

    def __getitem__(self, index: int) -> NDArray[Any] | None:
        try:
            with self._lock, warnings.catch_warnings():
                warnings.simplefilter("ignore")
                self._image.seek(index)
                shown = self._image.convert("RGB") if self._image.mode in ("P", "RGBA") else self._image
                image = np.asarray(shown)
        except UNREADABLE:
            return None
        # as OpenCV decodes: blue, green, red
        return np.array(image[..., ::-1] if image.ndim == 3 else image)
