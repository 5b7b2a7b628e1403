"""Images in files: a folder of PNG, TIFF, BMP or JPEG, and the pages of a TIFF.

Headers are read before anything is decoded, as a few bytes can declare an image of any size: by tifffile those of
TIFF, by Pillow those of the others. Accepted are PNG, TIFF, BMP and JPEG of 8 bits, PNG and TIFF of 16.
"""

import logging
import re
import struct
import warnings
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property
from pathlib import Path
from threading import Lock
from typing import Any, Literal, NamedTuple
from weakref import finalize

import cv2
import numpy as np
import tifffile
from numpy.typing import NDArray
from PIL import Image

from instruments._stored_film import StoredFrames
from instruments.images import LOSSY, SUFFIXES, images_in, is_tiff
from labpipe.arrays import Flags, Floats
from labpipe.errors import SourceError, warn_of
from labpipe.frames import IncompleteFilmWarning, SmoothedFilmWarning
from labpipe.text import first_bytes

Channel = Literal["red", "green", "blue"]
CHANNELS: tuple[Channel, ...] = ("blue", "green", "red")  # in the order in which OpenCV decodes them
SMOOTHED = "smooths fine detail away, which no uncertainty here contains"
ROUNDED = 4  # levels by which the compression of videos and JPEG rounds the three colours of grey apart
_NUMBER = re.compile(r"[-+]?\d+")
_COUNT = "Where names hold times, number the images in the order they were taken: frame_0001.png, …"
_ONE_FILM = f"Put only the images of one film into the folder. {_COUNT}"
#: Bits of 16 that cameras of 14, 12 and 10 bits leave empty, fewest last; and images that are looked at for it.
_UNUSED_BITS, _LOOKED_AT = (6, 4, 2), 9
_MOST_PIXELS = 1 << 26  # of one image: four times the largest camera
_ENDS = {"PNG": b"\x00\x00\x00\x00IEND\xaeB`\x82", "JPEG": b"\xff\xd9", "BMP": b""}
_COMPRESSIONS = {1, 5, 7, 8, 32773, 32946}  # of TIFF: none, LZW, JPEG, deflate by two numbers, PackBits
_COPY = "It is damaged: copy it from the camera again."
_EXPORT = "Export the film as grey TIFF without compression, or as PNG images."
_UNREADABLE = (  # errors of Pillow and tifffile over a damaged file
    OSError, ValueError, TypeError, SyntaxError, EOFError, IndexError, struct.error, Image.DecompressionBombError,
    tifffile.TiffFileError, MemoryError,
)  # fmt: skip
logging.getLogger("tifffile").setLevel(logging.CRITICAL)  # damage is reported once, by an error or a warning of ours


class ImageHeader(NamedTuple):
    """Size and bits of one image, by content "PNG", "JPEG", "BMP" or "TIFF", in page ``page`` of a file.

    ``fault`` names damage that shows without decoding; ``is_compressed`` if only decoding shows whether it is whole.
    """

    rows: int
    columns: int
    bits: int
    kind: str
    path: Path
    page: int = 0
    is_compressed: bool = False
    fault: str = ""


class CutOffError(SourceError):
    """An image ends before its header does, or has none: nothing of it can be read."""


def one_intensity(image: NDArray[Any], allowed: int, path: Path, name: str, channel: Channel | None) -> NDArray[Any]:
    """Return the intensity of an image, of the channel or of colours that are equal within so many levels."""
    if image.ndim == 2:
        return image
    if channel is not None:
        return image[:, :, CHANNELS.index(channel)]
    if int(np.ptp(image[:, :, :3].astype(np.int32), axis=2).max()) > allowed:
        hint = 'Choose the channel that is measured, channel="green" (or "red", "blue"; in session.toml: channel = '
        hint += '"green"), or export the film as grey. Green is the finest of most colour sensors.'
        raise SourceError(path, f"{name} is in colour, expected grey", hint=hint)
    return image[:, :, 1]


def read_headers(path: Path) -> list[ImageHeader]:
    """Return the header of every image in a PNG, TIFF, BMP or JPEG file.

    CutOffError where it ends within its first header or is none of these, SourceError for an image that is not read.
    """
    if not (head := first_bytes(path, 34)):
        raise CutOffError(path, "the image is empty")
    with path.open("rb") as stream:
        size = stream.seek(0, 2)
        stream.seek(-min(size, 64), 2)
        tail = stream.read()
    if is_tiff(head):
        return _tiff(path, size)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of sizes, which are checked below
            with Image.open(path, formats=tuple(_ENDS)) as image:
                kind, (columns, rows) = str(image.format), image.size
    except Image.DecompressionBombError as error:
        raise SourceError(path, f"declares an image that no camera takes: {error}", hint=_COPY) from None
    except _UNREADABLE:
        text = "ends within its header, or is neither PNG nor TIFF nor BMP nor JPEG"
        raise CutOffError(path, f"{text}: it starts with {head[:8]!r}", hint=_EXPORT) from None
    is_whole = int.from_bytes(head[2:6], "little") <= size if kind == "BMP" else _ENDS[kind] in tail
    fault = "" if is_whole else f"the {kind} is cut off: its end is missing"
    header = ImageHeader(rows, columns, head[24] if kind == "PNG" else 8, kind, path, 0, kind == "JPEG", fault)
    return [_checked(header)]


def _checked(header: ImageHeader) -> ImageHeader:
    if min(header.rows, header.columns) < 1 or header.rows * header.columns > _MOST_PIXELS:
        text = f"declares {header.columns} × {header.rows} px; expected at least one and at most {_MOST_PIXELS}"
        raise SourceError(header.path, text, hint="No camera takes such images: the header is damaged.")
    if header.bits not in (8, 16):
        text = f"holds {header.bits} bits per pixel; expected 8 or 16"
        raise SourceError(header.path, text, hint="Export the film as grey TIFF or PNG of 16 bits.")
    return header


def _tiff(path: Path, size: int) -> list[ImageHeader]:
    """Go through the pages of a TIFF; no pixel is touched."""
    headers: list[ImageHeader] = []
    said = "a page ends behind the file"
    try:
        with tifffile.TiffFile(path) as film:
            count, is_broken = _pages(path, film)
            stated = int((film.imagej_metadata or {}).get("images", 1)) if film.is_imagej else 1
            if stated > count and not is_broken:  # ImageJ describes only the first image of a stack beyond 4 GB
                text = f"ImageJ states {stated} images, of which {count} are described in the file"
                raise SourceError(path, text, hint="Save the stack as an image sequence of TIFF or PNG files.")
            for number in range(count):
                page: Any = film.pages[number]
                samples, meaning, bits = page.samplesperpixel, int(page.photometric), page.bitspersample
                is_grey, is_colour = samples == 1 and meaning in (0, 1, 3), samples in (3, 4) and meaning == 2
                note, packing, text = page.tags.get(274), page.compression, ""
                if not (is_grey or is_colour) or packing not in _COMPRESSIONS:
                    text = (
                        f"a page has {samples} samples per pixel of interpretation {meaning}, compression {packing}; "
                        "expected grey or RGB"
                    )
                elif (note is not None and note.value != 1) or (count > 1 and is_colour and bits != 8):
                    text = "its images are turned by a note of orientation, or its pages are in colours of 16 bits"
                if text:
                    raise SourceError(path, text, hint=_EXPORT)
                starts, counts = page.dataoffsets, page.databytecounts
                is_whole = len(starts) == len(counts) > 0 and max(map(sum, zip(starts, counts, strict=True))) <= size
                fault = "" if is_whole else "the TIFF page is cut off"
                shape = page.imagelength, page.imagewidth
                headers.append(_checked(ImageHeader(*shape, bits, "TIFF", path, number, packing != 1, fault)))
    except _UNREADABLE as error:
        is_broken, said = True, str(error)
    if is_broken and not headers:
        raise CutOffError(path, f"the TIFF is cut off or damaged: {said}", hint=_COPY)
    if is_broken:
        fault = "the TIFF breaks off before it, and the number of pages behind it is not known"
        headers.append(headers[0]._replace(page=len(headers), fault=fault))
    return headers


def _pages(path: Path, film: tifffile.TiffFile) -> tuple[int, bool]:
    """Count the pages of a TIFF, each of which names the place of the next, and find out whether they break off."""
    form, handle, seen, at = film.tiff, film.filehandle, set[int](), film.pages[0].offset
    while at and at not in seen:
        try:
            handle.seek(at)
            (entries,) = struct.unpack(form.tagnoformat, handle.read(form.tagnosize))
            handle.seek(at + form.tagnosize + entries * form.tagsize)
            (following,) = struct.unpack(form.offsetformat, handle.read(form.offsetsize))
        except (struct.error, ValueError, OSError):
            return len(seen), True
        seen.add(at)
        at = following
    if at:
        raise SourceError(path, "the TIFF's pages form a circle", offset=at, hint=_COPY)
    return len(seen), False


def folder_images(folder: Path) -> tuple[list[ImageHeader], Floats]:
    """Return the headers of the images of a folder, sorted by the number in their names, and these; warn of gaps.

    JPEG images count where there are no others.
    """
    named, lossy = (sorted(p for p in images_in(folder, of) if p.is_file()) for of in (SUFFIXES, LOSSY))
    if not (named := named or lossy):
        raise SourceError(folder, f"the folder holds no image ({', '.join(SUFFIXES + LOSSY)})")
    words = [_NUMBER.sub("#", path.stem).lower() for path in named]
    other = next((k for k, of in enumerate(words) if of != words[0] and min(map(words.count, (of, words[0]))) > 1), 0)
    if other:
        text = f"belongs to another film than {named[0].name}, as their names differ in more than their numbers"
        raise SourceError(named[other], text, hint=_ONE_FILM)
    numbered = sorted(zip(_numbers(named), named, strict=True))
    numbers = np.array([number for number, _ in numbered])
    steps = np.diff(numbers)
    twice = np.flatnonzero(steps == 0)
    if len(twice):
        (number, first), (_, second) = numbered[twice[0]], numbered[twice[0] + 1]
        raise SourceError(second, f"number {number} occurs twice, also in {first.name}", hint=_ONE_FILM)
    headers: list[ImageHeader] = []
    cut: dict[int, CutOffError] = {}
    for place, (_, path) in enumerate(numbered):
        try:
            found = read_headers(path)
        except CutOffError as found_cut:
            cut[place] = found_cut
            continue
        if len(found) != 1:
            hint = "Name this file itself as the film, or export one image per file."
            raise SourceError(path, f"holds {len(found)} images, expected one per file", hint=hint)
        headers += found
    if not headers:
        raise cut[0]
    for place, cut_off in cut.items():
        headers.insert(place, headers[0]._replace(path=numbered[place][1], fault=cut_off.message))
    if any(each.kind == "JPEG" for each in headers):
        text = "JPEG images have their levels baked in (gain, brightness, gamma), so their intensities are not "
        warn_of(folder.name, f"{text}calibrated; their compression {SMOOTHED}", category=SmoothedFilmWarning)
    usual = int(np.min(steps)) if len(steps) else 1
    if usual > 1:
        text = f"the numbers of the images go up by {usual}, so its times do by {usual} / frame rate; "
        warn_of(folder.name, text + "if every frame of the camera is here, number them one by one")
    if missing := int(np.sum(steps // usual - 1)):
        after = int(numbers[int(np.flatnonzero(steps > usual)[0])])
        text = f"{'1 image is' if missing == 1 else f'{missing} images are'} missing, the first after number {after}; "
        warn_of(folder.name, text + "times follow the numbers, so the film has gaps")
    return headers, numbers.astype(float)


def _numbers(paths: Sequence[Path]) -> list[int]:
    """Read the places of images from their names: the last of the numbers that go up by multiples of one step.

    Times of a clock do not. A minus may be a hyphen where no name has a plus.
    """
    number = _NUMBER if any(re.search(r"\+\d", path.stem) for path in paths) else re.compile(r"(?:(?<![^\W_])-)?\d+")
    rows = [[int(text) for text in number.findall(path.stem)] for path in paths]
    if bare := next((path for path, row in zip(paths, rows, strict=True) if not row), None):
        text = "the image has no number in its name, so its place in the film is unknown"
        hint = "Name images like frame_0001.png; move what is no image of the film out of the folder."
        raise SourceError(bare, text, hint=hint)
    shared = min(map(len, rows))
    wholly = [tuple(values[-shared:]) for values in rows]
    columns = [[values[-k] for values in rows] for k in range(1, shared + 1)]
    varying = [column for column in columns if len(set(column)) > 1] or columns[:1]
    for column in varying:
        order = sorted(range(len(column)), key=column.__getitem__)
        steps = np.diff(np.array([column[i] for i in order], dtype=object))
        is_even = not len(steps) or bool(min(steps) > 0 and not any(steps % min(steps)))
        if is_even and order == sorted(order, key=wholly.__getitem__):
            return column
    if len(set(varying[0])) == len(rows):
        text = f"no number in the names counts the frames, as times of a clock do not; before it comes {paths[0].name}"
        raise SourceError(paths[-1], text, hint=_COUNT)
    return varying[0]


class ExportedFrames(StoredFrames):
    """Frames of a decoder, which gives whole images; one is decoded when it is asked for.

    ``time`` and ``exposure`` (frame,) [s] are set by whoever opens the film.
    """

    time: Floats
    exposure: Floats | None = None

    def __init__(self, path: Path, count: int, size: tuple[int, int], channel: Channel | None) -> None:
        super().__init__(count, *size)
        self._path, self._size, self._channel = path, size, channel
        # The image that was decoded last, shared by all views: parts of one image are mostly asked for in a row.
        self._last: dict[int, NDArray[np.integer[Any]]] = {}

    def fault(self, index: int) -> str:
        """Say why an image cannot be decoded, or ""; one of a video that cannot is not counted."""
        del index
        return ""

    def whole(self, index: int) -> NDArray[np.integer[Any]]:
        """Decode one image."""
        raise NotImplementedError

    def __getitem__(self, index: int) -> NDArray[np.integer[Any]]:
        """Decode one frame; those of a video fastest in order."""
        index = self._place(index)
        image = self._last.get(index)
        if image is None:
            image = self.whole(index)
            self._last.clear()
            self._last[index] = image
        return image[self._rows.start : self._rows.stop, self._columns.start : self._columns.stop].copy()


class ImageFiles(ExportedFrames):
    """Images in files; damage of one is found when it is asked for."""

    def __init__(self, path: Path, headers: Sequence[ImageHeader], channel: Channel | None) -> None:
        first = headers[0]
        super().__init__(path, len(headers), first[:2], channel)
        for one in headers:
            if one[:3] != first[:3]:
                text = f"{f'image {one.page + 1}: ' if one.page else ''}{one.columns} × {one.rows} px of {one.bits} "
                text += f"bits, but the first of the film has {first.columns} × {first.rows} px of {first.bits} bits"
                raise SourceError(one.path, text, hint=_ONE_FILM)
        self._headers, self._faults = headers, dict[int, str]()
        self._n_warned = self._warn([i for i, one in enumerate(headers) if one.fault], "not whole")
        self._pages = _Pages(path) if headers[-1].page else None

    @cached_property
    def valid(self) -> Flags:
        """False for images that are cut off, contradict their own checksums or cannot be decoded."""
        with ThreadPoolExecutor() as pool:
            faults = list(pool.map(self.fault, range(len(self))))
        bad = [i for i, fault in enumerate(faults) if fault]
        if len(bad) > self._n_warned:
            self._warn(bad, "damaged")
        return np.array([not fault for fault in faults])

    def _warn(self, bad: Sequence[int], how: str) -> int:
        """Warn of images without a value, as after a copy that broke off, and count them."""
        if bad:
            is_one = len({one.path for one in self._headers}) == 1
            which = f"image {bad[0] + 1}" if is_one else self._headers[bad[0]].path.name
            verb, named = ("is", which) if len(bad) == 1 else ("are", f"the first {which}")
            text = f"{len(bad)} of {len(self)} images {verb} {how} and left out, {named}: {self.fault(bad[0])}. "
            warn_of(self._path.name, text + "Copy the film from the camera again", category=IncompleteFilmWarning)
        return len(bad)

    def fault(self, index: int) -> str:
        """Say why an image cannot be decoded, or ""; a PNG that contradicts its checksums would give other pixels."""
        if index not in self._faults:
            header = self._headers[index]
            said = header.fault
            if not said and header.kind == "PNG":
                try:
                    with Image.open(header.path) as image:
                        image.verify()
                except _UNREADABLE as error:
                    said = f"the PNG contradicts its checksums: {error}"
            elif not said and header.is_compressed and self._decoded(header) is None:
                said = "its compressed pixels cannot be decoded"
            self._faults[index] = said
        return self._faults[index]

    @cached_property
    def levels(self) -> tuple[float, float]:
        """Range of the bits in use: cameras of 10 to 14 bits fill the lower or the upper bits of 16."""
        bits = self._headers[0].bits
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
        header = self._headers[index]
        if fault := self.fault(index):
            raise SourceError(header.path, fault, hint="Use the frames marked in `.valid`.")
        image = self._decoded(header)
        if image is None or image.shape[:2] != self._size:
            found = "nothing" if image is None else f"an image of shape {image.shape}"
            raise SourceError(header.path, f"decodes to {found}, expected {self._size}", hint=_EXPORT)
        return one_intensity(image, ROUNDED * (header.kind == "JPEG"), header.path, "the image", self._channel)

    def _decoded(self, header: ImageHeader) -> NDArray[Any] | None:
        if self._pages is not None:
            return self._pages[header.page]
        data = np.fromfile(header.path, np.uint8)  # names of any letters; imread takes ASCII only
        return cv2.imdecode(data, cv2.IMREAD_UNCHANGED)


class _Pages:
    """The pages of a TIFF in any order, by Pillow; OpenCV goes through all pages before the one that is asked for."""

    def __init__(self, path: Path) -> None:
        stream = path.open("rb")
        finalize(self, stream.close)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # of fields that are not needed
                self._lock, self._image = Lock(), Image.open(stream)
        except _UNREADABLE:
            raise SourceError(path, "its pages cannot be decoded", hint="Export one image per file.") from None

    def __getitem__(self, index: int) -> NDArray[Any] | None:
        try:
            with self._lock, warnings.catch_warnings():
                warnings.simplefilter("ignore")
                self._image.seek(index)
                shown = self._image.convert("RGB") if self._image.mode in ("P", "RGBA") else self._image
                image = np.asarray(shown)
        except _UNREADABLE:
            return None
        # as OpenCV decodes: blue, green, red
        return np.array(image[..., ::-1] if image.ndim == 3 else image)
