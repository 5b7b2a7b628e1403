"""Biomomentum Mach-1 Motion text files: blocks of time, position and force, read and written."""

from typing import TYPE_CHECKING, TypedDict

from instruments._instrument import Instrument, text_of
from labpipe.installation import lazily

if TYPE_CHECKING:
    from instruments.mach1._blocks import Block as Block
    from instruments.mach1._dataset import assemble as assemble, encode as encode, read as read, write as write
    from instruments.mach1._synthetic import LOAD_CELLS as LOAD_CELLS, LoadCell as LoadCell, make_block as make_block
else:
    __getattr__ = lazily(__name__)


class Options(TypedDict, total=False):
    """Options for a file that was changed or cut; see :func:`read`."""

    decimal: str | None
    allow_incomplete: bool


INSTRUMENT = Instrument(
    name="mach1",
    title="Mach-1 Motion file",
    content="force",
    sniff=lambda head, _: text_of(head).lstrip().lstrip('"').startswith("<Mach-1 File>"),
    reader="instruments.mach1:read",
    options=Options,
)
