"""Plain tables of a dynamic mechanical analysis, as other software exports them."""

from pathlib import Path
from typing import TYPE_CHECKING, TypedDict

from instruments._instrument import Instrument, text_of
from labpipe.lazy import lazily

if TYPE_CHECKING:
    from instruments.tables._plain import read
else:
    _HOMES = {"read": "_plain"}
    __getattr__ = lazily(__name__, _HOMES)

__all__ = ["INSTRUMENT", "Options", "read"]


class Options(TypedDict, total=False):
    """How a table is to be read where it does not decide; see :func:`read`."""

    encoding: str | None
    decimal: str | None
    allow_incomplete: bool


def _sniff(head: bytes, path: Path) -> bool:
    """Tell a plain table of sweeps or shift factors by the quantities in its first line."""
    from instruments.tables._words import recognises

    del path
    text = text_of(head)
    first = next((line for line in text.splitlines() if line.strip()), "")
    return "\0" not in text and recognises(first.removeprefix("\N{ZERO WIDTH NO-BREAK SPACE}"))


INSTRUMENT = Instrument(
    name="plain_table",
    title="plain table of sweeps or shift factors",
    content="sweep",
    sniff=_sniff,
    reader="instruments.tables:read",
    options=Options,
)
