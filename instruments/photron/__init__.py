"""Photron films: a header in text (.cih) or XML (.cihx), the frames in a .mraw of the same name."""

from pathlib import Path
from typing import TYPE_CHECKING

from instruments._instrument import Instrument
from labpipe.installation import lazily

if TYPE_CHECKING:
    from instruments.photron._film import MrawFrames as MrawFrames, read as read
else:
    __getattr__ = lazily(__name__)

HEADERS = (".cih", ".cihx")


def header_of(path: Path) -> Path | None:
    """Return the header of a pair, given either of its files; None where there is none."""
    found = (p for p in sorted(path.parent.glob("*.[cC][iI][hH]*")) if p.stem == path.stem)
    return path if path.suffix.lower() in HEADERS else next(found, None)


def frames_of(header: Path) -> Path | None:
    """Return the frames that belong to a header; None where there are none."""
    return next((p for p in sorted(header.parent.glob("*.[mM][rR][aA][wW]")) if p.stem == header.stem), None)


def _sniff(head: bytes, path: Path) -> bool:
    """Recognise a header by its content, frames by the header of the same name."""
    if path.suffix.lower() == ".mraw":
        return header_of(path) is not None
    return head.lstrip(b"\xef\xbb\xbf").startswith(b"#Camera Information Header") or b"<cih>" in head


INSTRUMENT = Instrument("photron", "Photron film", "film", _sniff, "instruments.photron:read")
