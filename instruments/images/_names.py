"""Which files of a folder are images of a film, by their names alone."""

from collections.abc import Iterator
from pathlib import Path

SUFFIXES = (".png", ".tif", ".tiff", ".bmp")
#: Images that have lost detail: a film where there are no others and somebody says so, by its frame rate.
LOSSY = (".jpg", ".jpeg")
JPEG = b"\xff\xd8\xff"
"""First bytes of such an image, whatever its name ends in."""


def images_in(folder: Path, suffixes: tuple[str, ...] = SUFFIXES) -> Iterator[Path]:
    """Go through the images in a folder, without what the system keeps hidden among them."""
    return (p for p in folder.iterdir() if p.suffix.lower() in suffixes and not p.name.startswith("."))


def has_images(folder: Path, suffixes: tuple[str, ...] = SUFFIXES) -> bool:
    """Tell whether there is one, without going through the others."""
    return next(images_in(folder, suffixes), None) is not None


def is_numbered(image: Path) -> bool:
    """Tell whether there is a number in the name of an image, as the frames of a film have, and pictures need not."""
    return any(map(str.isdigit, image.stem))


def has_frames(folder: Path, suffixes: tuple[str, ...] = SUFFIXES) -> bool:
    """Tell whether there is one with a number in its name."""
    return any(map(is_numbered, images_in(folder, suffixes)))


def are_misnamed(folder: Path) -> bool:
    """Tell frames whose names alone say that they have lost detail, by the content of the first."""
    first = next(filter(is_numbered, images_in(folder, LOSSY)), None)
    if first is None or not first.is_file():
        return False
    with first.open("rb") as stream:
        return stream.read(len(JPEG)) not in (JPEG, b"")
