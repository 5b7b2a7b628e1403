"""Checks of the pictures and links of a page."""

import re
from typing import Literal

from labpipe.errors import InputError

Level = Literal["ok", "info", "warning", "error"]

_SIGNATURES = ((b"\x89PNG\r\n\x1a\n", "image/png"), (b"\xff\xd8\xff", "image/jpeg"))
_SVG_HEAD = re.compile(rb"\s*(<\?xml[^>]*\?>\s*)?(<!--.*?-->\s*|<!DOCTYPE[^>]*>\s*)*<svg[\s>]", re.DOTALL)


def check_inside(what: str, href: str) -> None:
    """Refuse an address that leaves the folder of the page.

    Raises
    ------
    InputError
        It names another place, a scheme, or a folder above.
    """
    parts = re.split(r"[/\\]", href)
    if ":" in parts[0] or ".." in parts or parts[0] == "":
        message = f'{what}: the page "{href}" must be a path inside the folder of this page, such as drop_1.html'
        raise InputError(message)


def mime_type(data: bytes) -> str:
    """Tell what kind of picture the bytes are.

    Raises
    ------
    InputError
        They are neither PNG nor JPEG nor SVG.
    """
    for signature, name in _SIGNATURES:
        if data.startswith(signature):
            return name
    if _SVG_HEAD.match(data[:4096]):
        return "image/svg+xml"
    raise InputError(f"a picture must be a PNG, JPEG or SVG file, found {len(data)} bytes that start with {data[:8]!r}")
