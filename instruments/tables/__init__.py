"""Tables of a dynamic mechanical analysis, text or workbook, as analysers and other software export them."""

import re
from pathlib import Path
from typing import TYPE_CHECKING, TypedDict

from instruments._instrument import HEAD_BYTES, Instrument, text_of
from labpipe.installation import lazily
from labpipe.text import unmarked_codec

if TYPE_CHECKING:
    from instruments.tables._plain import read as read
else:
    __getattr__ = lazily(__name__)


# Codecs of spreadsheets without Unicode, where words are found in none that is more usual.
CODECS = ("cp932", "gbk", "euc_kr", "cp1251", "cp1250", "cp1254")
_FAR = 64 * HEAD_BYTES  # how far into a file the lines about specimen and procedure may reach
_PROCEDURE = (
    "[File Parameters]",
    "[step]",
    "#EXPORTTYPE",
    "#FORMAT",
    "#SEPARATOR",
    "Instrument name",
    "Curve Name",
    "StartOfData",
    "Nsig",
)


class Options(TypedDict, total=False):
    """How a table is to be read where it does not decide; see :func:`read`."""

    encoding: str | None
    decimal: str | None
    columns: str | None
    allow_incomplete: bool


def _sniff(head: bytes, path: Path) -> bool:
    """Tell a table of sweeps, responses or shift factors by the quantities in its headings."""
    if head.startswith(b"PK\x03\x04"):
        from instruments.tables._workbook import names_quantities

        return names_quantities(path)
    text = _text(head)
    # a page or a document of JSON is no table; of its long lines every part would be tried as a heading
    if "\0" in text or not head or text.lstrip("\ufeff \t\r\n").startswith(("{", "<!", "<html", "<?xml")):
        return False
    if any(word in text for word in _PROCEDURE):  # many lines before the first table
        try:
            with path.open("rb") as stream:
                head = stream.read(_FAR)
        except OSError:
            return False
        text = _text(head)
    if _has_headings(text):
        return True
    whole = head[: head.rfind(b"\n") + 1 or None]
    texts = () if text.isascii() else (whole.decode(codec, errors="replace") for codec in CODECS)
    return any(_has_headings(other, new=True) for other in texts)


def _has_headings(text: str, *, new: bool = False) -> bool:
    """Look for headings; in a text that was decoded in other ``new`` ways, where that makes a difference."""
    from instruments.tables._layout import headings_of, joined, signals_of

    lines = [line for _, line in joined(text.removeprefix("\N{ZERO WIDTH NO-BREAK SPACE}").splitlines())]
    asked = [line for line in lines if not (new and line.isascii())]
    return any(headings_of(line) is not None for line in (*asked, signals_of(lines)) if line.strip())


def holds_rows(head: bytes) -> bool:
    """Tell whether the beginning of a file holds rows of three numbers or more, as a table does."""
    from instruments.tables._cells import numbers_of

    text = _text(head)
    return "\0" not in text and any(len(numbers_of(line)) > 2 for line in text.splitlines()[:-1])


def workbook_hint(head: bytes) -> str:
    """Say how a workbook of another program, or one that names no quantities, can be read; "" of other files."""
    if head.startswith(b"\xd0\xcf\x11\xe0") or b"opendocument.spreadsheet" in head[:200]:
        return "This is a workbook of an older or another program (.xls, .ods); save it as .xlsx or as CSV."
    if head.startswith(b"PK\x03\x04"):
        return (
            "In a workbook a row names the columns, with their units in it or in the row below: "
            "f (Hz), E' (MPa), E'' (MPa), T (degC); name them, or save the sheet as CSV."
        )
    if re.match(rb"\s*<(?:!doctype|html|table)", head, re.IGNORECASE):
        return (
            "This is a page of HTML, whatever its name ends in; open it in a spreadsheet and save it as .xlsx or CSV."
        )
    return ""


def _text(head: bytes) -> str:
    """Decode the beginning of a file; symbols such as E′ stand in headings."""
    if unmarked_codec(head):
        return text_of(head)
    try:
        return head[: head.rfind(b"\n") + 1 or None].decode("utf-8")
    except UnicodeDecodeError:
        return text_of(head)


INSTRUMENT = Instrument(
    name="plain_table",
    title="plain table of sweeps or shift factors",
    content="sweep",
    sniff=_sniff,
    reader="instruments.tables:read",
    options=Options,
)
