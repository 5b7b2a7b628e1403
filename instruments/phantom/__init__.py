"""Phantom high-speed films (.cine): lazy frames, times from the time stamps; read and written."""

from typing import TYPE_CHECKING

from instruments._instrument import Instrument
from labpipe.installation import lazily

if TYPE_CHECKING:
    from instruments.phantom._film import CineFrames as CineFrames, read as read
    from instruments.phantom._writer import Recording as Recording, write as write
else:
    __getattr__ = lazily(__name__)


# recognised by its magic "CI" and the length of its first header
INSTRUMENT = Instrument(
    "phantom", "Phantom film", "film", lambda head, _: head[:4] == b"CI\x2c\x00", "instruments.phantom:read"
)
