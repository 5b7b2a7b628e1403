"""Films that were exported: a folder of PNG, TIFF or BMP, a multipage TIFF, an AVI, MP4, MOV or MKV."""

from pathlib import Path
from typing import TYPE_CHECKING, TypedDict

from instruments._instrument import Instrument
from instruments.images._headers import is_tiff
from instruments.images._names import LOSSY, are_misnamed, has_frames, has_images
from labpipe.installation import lazily

if TYPE_CHECKING:
    from instruments.images._stack import NEEDS_RATE as NEEDS_RATE, ExportedFrames as ExportedFrames, read as read
else:
    __getattr__ = lazily(__name__)


RAW_FRAMES = (
    "Raw frames name neither their size nor their bits: keep the header (.cih or .cihx) of a .mraw in its folder, or "
    "export the film as TIFF."
)


class Options(TypedDict, total=False):
    """What images do not say of themselves; see :func:`read`."""

    fps: float | None
    exposure: float | None
    channel: str | None


def _sniff(head: bytes, path: Path) -> bool:
    """Tell a folder of frames, a TIFF, or a video."""
    if path.is_dir():
        return has_frames(path) or are_misnamed(path)
    is_avi = head[:4] == b"RIFF" and head[8:12] == b"AVI "
    return is_tiff(head) or is_avi or head[4:8] == b"ftyp" or head[:4] == b"\x1aE\xdf\xa3"


def is_lossy_film(folder: Path, fps: float | None) -> bool:
    """Tell a folder of numbered JPEG images that somebody calls a film by giving its frame rate."""
    return fps is not None and folder.is_dir() and has_frames(folder, LOSSY)


def folder_hint(folder: Path) -> str:
    """Say what to do with a folder that holds no film."""
    if has_images(folder):
        return "The names of its images hold no number, so their order is not known: name them frame_0001.png, …"
    inside = next((p for p in sorted(folder.iterdir()) if p.is_dir() and has_frames(p)), None)
    if inside is not None:
        return f"Its images lie one folder deeper: name {folder.name}/{inside.name}."
    if has_images(folder, LOSSY):
        return (
            "It holds JPEG images, whose compression smooths away the detail that is measured, by an amount that "
            "nothing tells: have the camera's program export the film as PNG or TIFF, or give the camera's own file. "
            "Numbered and with a frame rate (fps=10000, in session.toml: frame_rate) they are read all the same, "
            'those in colour with channel="green" (or "red", "blue").'
        )
    return f"A folder is read when it holds the PNG, TIFF or BMP images of a film. {RAW_FRAMES}"


INSTRUMENT = Instrument(
    name="image_stack",
    title="film exported as images",
    content="film",
    sniff=_sniff,
    reader="instruments.images:read",
    options=Options,
)
