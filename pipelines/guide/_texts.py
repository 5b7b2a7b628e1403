"""The texts of the guide: where they are, in which order they are read, and where their links lead."""

import re
from collections.abc import Callable
from pathlib import Path

from labpipe import files

GUIDES = Path(files.__file__).parent / "documentation"
PICTURES = GUIDES / "pictures"
"""Drawn while the site is built, and kept for those who have the package alone."""

_FIRST = ("tutorial", "page", "experimenter", "files", "analyst", "rheology", "films", "gallery")
_METHODS = ("simulator", "evidence", "scale")
_REFERENCE = ("settings", "commands", "python")
_OTHERS = ("developer", "architecture")
PARTS = {
    "First steps": _FIRST,
    "Methods and their errors": _METHODS,
    "Reference": _REFERENCE,
    "For developers": _OTHERS,
}


def linked(text: str, page_of: Callable[[str], str]) -> str:
    """Let links to other files of the guide lead to their pages; where ``page_of`` a file is empty the words remain."""

    def link(found: re.Match[str]) -> str:
        words, target = found.groups()
        file, _, anchor = target.partition("#")
        page = page_of(file)
        return f"[{words}]({page}{'#' + anchor if anchor else ''})" if page else words

    return re.sub(r"(?<!!)\[([^\]]+)\]\((?!https?:|#)([^)\s]+)\)", link, text)
