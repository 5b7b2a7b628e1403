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
