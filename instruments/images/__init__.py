"""Films that were exported: a folder of PNG, TIFF or BMP, a multipage TIFF, an AVI, MP4, MOV or MKV."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, TypedDict

from instruments._instrument import Instrument
from labpipe.installation import lazily

if TYPE_CHECKING:
    from instruments.images._stack import NEEDS_RATE as NEEDS_RATE, read as read
else:
    __getattr__ = lazily(__name__)

RAW_FRAMES = "Raw frames name neither their size nor their bits: keep the header (.cih or .cihx) of a .mraw in its "
RAW_FRAMES += "folder, or export the film as TIFF."
SUFFIXES = (".png", ".tif", ".tiff", ".bmp")
#: Images that have lost detail: a film where there are no others and somebody says so, by its frame rate.
LOSSY = (".jpg", ".jpeg")
_JPEG = b"\xff\xd8\xff"
_OF_JPEG = (
    "It holds JPEG images, whose compression smooths away the detail that is measured, by an unknown amount: have the "
    "camera's program export the film as PNG or TIFF, or give the camera's own file. Numbered and with a frame rate "
    "(fps=10000, in session.toml: frame_rate) they are read all the same, those in colour with "
    'channel="green" (or "red", "blue").'
)


class Options(TypedDict, total=False):
    """Properties that images do not state; see :func:`read`."""

    fps: float | None
    exposure: float | None
    channel: str | None


def is_tiff(head: bytes) -> bool:
    """Recognise a TIFF or BigTIFF by its first bytes."""
    return head[:4] in (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")


def images_in(folder: Path, suffixes: tuple[str, ...] = SUFFIXES) -> Iterator[Path]:
    """Go through the images in a folder, without those that the system keeps hidden among them."""
    return (p for p in folder.iterdir() if p.suffix.lower() in suffixes and not p.name.startswith("."))


def is_numbered(image: Path) -> bool:
    """Return whether there is a number in the name of an image, as the frames of a film have."""
    return any(map(str.isdigit, image.stem))


def has_frames(folder: Path, suffixes: tuple[str, ...] = SUFFIXES) -> bool:
    """Return whether a folder holds an image with a number in its name."""
    return any(map(is_numbered, images_in(folder, suffixes)))


def _sniff(head: bytes, path: Path) -> bool:
    """Recognise a folder of frames, a TIFF, or a video."""
    if not path.is_dir():
        is_avi = head[:4] == b"RIFF" and head[8:12] == b"AVI "
        return is_tiff(head) or is_avi or head[4:8] == b"ftyp" or head[:4] == b"\x1aE\xdf\xa3"
    if has_frames(path):
        return True
    first = next(filter(is_numbered, images_in(path, LOSSY)), None)
    if first is None or not first.is_file():
        return False
    with first.open("rb") as stream:  # frames of which only the names say that they have lost detail
        return stream.read(len(_JPEG)) not in (_JPEG, b"")


def is_lossy_film(folder: Path, fps: float | None) -> bool:
    """Recognise a folder of numbered JPEG images that somebody calls a film by giving its frame rate."""
    return fps is not None and folder.is_dir() and has_frames(folder, LOSSY)


def folder_hint(folder: Path) -> str:
    """Give the remedy for a folder that holds no film."""
    if any(images_in(folder)):
        return "The names of its images hold no number, so their order is not known: name them frame_0001.png, …"
    inside = next((p for p in sorted(folder.iterdir()) if p.is_dir() and has_frames(p)), None)
    if inside is not None:
        return f"Its images lie one folder deeper: name {folder.name}/{inside.name}."
    if any(images_in(folder, LOSSY)):
        return _OF_JPEG
    return f"A folder is read when it holds the PNG, TIFF or BMP images of a film. {RAW_FRAMES}"


INSTRUMENT = Instrument("image_stack", "film exported as images", "film", _sniff, "instruments.images:read", Options)
