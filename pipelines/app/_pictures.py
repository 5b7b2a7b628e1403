"""Small pictures of files: curves of a table, frames of a film, a photograph made smaller."""

import io
import tempfile
import threading
import warnings
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

from labpipe.errors import InputError

if TYPE_CHECKING:
    from PIL import Image

_WIDTH = 480
_LARGEST = 200_000_000
"""Bytes of a file that is read for a picture, unless it is a film, of which only frames are read."""
_MAKING = threading.Lock()
PHOTOGRAPHS = {".jpg", ".jpeg", ".png", ".bmp"}
_FILMS = {".cine", ".avi", ".tif", ".tiff"}


def small_picture(path: Path) -> bytes:
    """Return a PNG of a file; pictures are made one at a time, and those of files that have not changed are kept.

    Raises
    ------
    LabpipeError
        The file holds nothing to draw, or is too large to be read for it.
    """
    status = path.stat()
    with _MAKING:
        return _picture(path, status.st_size, status.st_mtime_ns)


@lru_cache(400)
def _picture(path: Path, size: int, modified: int) -> bytes:
    del modified
    if size > _LARGEST and path.suffix.lower() not in _FILMS:
        raise InputError(f"{path.name} is too large for a small picture")
    if path.suffix.lower() in PHOTOGRAPHS:
        image = photograph(path)
        image.thumbnail((_WIDTH, _WIDTH))
        stream = io.BytesIO()
        image.save(stream, "png")
        return stream.getvalue()
    from pipelines.session import write_sheet

    with tempfile.TemporaryDirectory() as place, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # told where the file is inspected or processed
        target = Path(place) / "picture.png"
        write_sheet(path, target)
        return target.read_bytes()


def photograph(path: Path) -> "Image.Image":
    """Open a picture as RGB or grey levels, turned as the camera was held.

    Raises
    ------
    InputError
        It is no picture, is damaged, or has more pixels than a camera.
    """
    from PIL import Image, ImageOps

    with warnings.catch_warnings():
        warnings.simplefilter("error")  # a picture that would fill the memory
        try:
            with Image.open(path) as image:
                return ImageOps.exif_transpose(image).convert("L" if image.mode in ("1", "L", "I;16", "I") else "RGB")
        except Exception as error:  # whatever a hostile file makes the decoder raise
            raise InputError(f"{path.name} cannot be read as a picture: {error}") from None
