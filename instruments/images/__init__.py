"""Films that were exported as images: a folder of PNG or TIFF, a multipage TIFF, or an AVI."""

from pathlib import Path
from typing import TYPE_CHECKING, TypedDict

from instruments._instrument import Instrument
from labpipe.lazy import lazily

if TYPE_CHECKING:
    from instruments.images._stack import ImageFrames, VideoFrames, read
else:
    __getattr__ = lazily(__name__)

__all__ = ["INSTRUMENT", "ImageFrames", "Options", "VideoFrames", "read"]


class Options(TypedDict, total=False):
    """What images do not say of themselves; see :func:`read`."""

    fps: float | None
    exposure: float | None


def _sniff(head: bytes, path: Path) -> bool:
    """Tell a folder of PNG or TIFF images, a TIFF, or an AVI."""
    if path.is_dir():
        return any(p.suffix.lower() in {".png", ".tif", ".tiff"} for p in path.iterdir())
    is_tiff = head[:4] in {b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"}
    return is_tiff or (head[:4] == b"RIFF" and head[8:12] == b"AVI ")


INSTRUMENT = Instrument(
    name="image_stack",
    title="film exported as images",
    content="film",
    sniff=_sniff,
    reader="instruments.images:read",
    options=Options,
    unproposed=("images hold no time; add the experiment by hand, with the folder or file as its film and frame_rate"),
)
