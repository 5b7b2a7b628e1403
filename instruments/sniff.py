"""Which instrument wrote a file, told by its first bytes; numpy is not needed for that.

Every function takes the first :data:`HEAD_BYTES` bytes (none for a folder) and the path.
"""

import re
from pathlib import Path

HEAD_BYTES = 4096  # enough for every magic number and every text header known

_KEYENCE = re.compile(
    r"keyence|\bLK-?[GHNS]|\bCL-?3|\bCL-?[PLHS]\d|\bIL-?\d|\bOUT ?\d|sampling (?:cycle|period)",
    re.IGNORECASE,
)


def head(path: Path) -> bytes:
    """Return the first bytes of a file; nothing of a folder or of a file that does not open."""
    try:
        with path.open("rb") as stream:
            return stream.read(HEAD_BYTES)
    except OSError:
        return b""


def _text(head: bytes) -> str:
    if head.startswith((b"\xff\xfe", b"\xfe\xff")):
        return head.decode("utf-16", errors="replace")
    return head.decode("latin-1").removeprefix("ï»¿")


def is_mach1(head: bytes, path: Path) -> bool:
    """Tell a Biomomentum Mach-1 Motion text by its first line, ``<Mach-1 File>``."""
    del path
    return _text(head).lstrip().lstrip('"').startswith("<Mach-1 File>")


def is_keyence(head: bytes, path: Path) -> bool:
    """Tell a Keyence storage export by the model, an output or a sampling cycle in its header."""
    del path
    # A film or any other binary file may hold these letters by chance, but no text holds a NUL.
    text = _text(head)
    return "\0" not in text and _KEYENCE.search(text) is not None


def is_phantom(head: bytes, path: Path) -> bool:
    """Tell a Phantom .cine by its magic "CI" and the length of its first header."""
    del path
    return head[:4] == b"CI\x2c\x00"


_ANTON_PAAR = re.compile(
    r'^"?[^\t;,\n]{4,60}:"?[\t;,]+"?[0-9]{1,9}"?[\t;,]+"?[0-9]{1,9}"?[\t;,]*\r?$'
    r"|^\"?(?:Data Series Information|Datenreihen ?-?Information)"
    r"|Rheo\.Repository\.",
    re.MULTILINE,
)
_ANTON_PAAR_SHEET = re.compile(r"interval[^<]{0,40}:|abschnitt[^<]{0,40}:", re.IGNORECASE)


def is_anton_paar(head: bytes, path: Path) -> bool:
    """Tell a RheoCompass or RheoPlus export by the line that begins a table, or its window XML."""
    if head.startswith(b"PK\x03\x04"):
        return _is_anton_paar_workbook(path)
    text = _text(head)
    return "\0" not in text and _ANTON_PAAR.search(text) is not None


def _is_anton_paar_workbook(path: Path) -> bool:
    """Look for the label of an interval in the beginning of the texts of a workbook."""
    import zipfile
    import zlib

    try:
        with zipfile.ZipFile(path) as archive:
            names = [
                n for n in archive.namelist()
                if n == "xl/sharedStrings.xml" or n.startswith("xl/worksheets/sheet1")
            ]  # fmt: skip
            for name in names:
                with archive.open(name) as stream:
                    text = stream.read(16 * HEAD_BYTES).decode("utf-8", errors="replace")
                if _ANTON_PAAR_SHEET.search(text):
                    return True
    except (zipfile.BadZipFile, zlib.error, OSError, EOFError, RuntimeError, NotImplementedError):
        return False  # not told apart from any other archive; the reader says what is wrong
    return False


def is_plain_table(head: bytes, path: Path) -> bool:
    """Tell a plain table of sweeps or shift factors by the quantities in its first line."""
    from instruments.plain_table_words import recognises

    del path
    text = _text(head)
    first = next((line for line in text.splitlines() if line.strip()), "")
    return "\0" not in text and recognises(first.removeprefix("\N{ZERO WIDTH NO-BREAK SPACE}"))


def is_dice(head: bytes, path: Path) -> bool:
    """Tell results of DICe by the names in the folder, or by the fields of one file."""
    if path.is_dir():
        return any(path.glob("DICe_solution_*.txt"))
    return b"COORDINATE_X" in head and b"DISPLACEMENT_X" in head


def is_image_stack(head: bytes, path: Path) -> bool:
    """Tell a folder of PNG or TIFF images, a TIFF, or an AVI."""
    if path.is_dir():
        return any(p.suffix.lower() in {".png", ".tif", ".tiff"} for p in path.iterdir())
    is_tiff = head[:4] in {b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"}
    return is_tiff or (head[:4] == b"RIFF" and head[8:12] == b"AVI ")
