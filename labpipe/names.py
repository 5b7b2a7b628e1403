"""File names from untrusted text: which may become a path inside a session folder."""

import os
import re
import unicodedata
from pathlib import Path, PurePosixPath

from labpipe.errors import InputError

_RESERVED = re.compile(r"(?i)^(con|prn|aux|nul|com[0-9¹²³]|lpt[0-9¹²³]|conin\$|conout\$)(\.|$)")
_LONGEST_NAME = 255
"""Bytes in one component of a path: the limit of ext4, XFS, APFS and NTFS alike."""


def safe_join(root: str | os.PathLike[str], name: str) -> Path:
    """Join a name from a file to a folder, and refuse one that leads out of it.

    Parameters
    ----------
    root : path-like
        The folder that must not be left.
    name : str
        A relative path with forward slashes.

    Returns
    -------
    Path
        The resolved path; it need not exist.

    Raises
    ------
    InputError
        The name is empty, absolute, contains ``..``, a backslash, a control or direction
        character, a name that Windows reserves, or a component beyond 255 bytes; or a symbolic
        link on the way leads out of the folder or in a circle.

    Examples
    --------
    >>> safe_join("/data/session", "../secret")
    Traceback (most recent call last):
    labpipe.errors.InputError: "../secret" is not a path inside the session folder: it contains ".."
    """
    base = Path(root).resolve()
    joined = base / name
    problem = name_problem(name) or _link_problem(joined, base)
    if problem is not None:
        shown = printable(name if len(name) <= _LONGEST_NAME else name[:60] + "…")
        raise InputError(f'"{shown}" is not a path inside the session folder: {problem}')
    return joined.resolve()


def name_problem(name: str) -> str | None:
    """Say why a session cannot name a file so, or None when it can."""
    if not name.strip():
        return "it is empty"
    if any(unicodedata.category(c) in ("Cc", "Cs") or _is_direction(c) for c in name):
        return "it contains a control character or one that turns the reading direction"
    if "\\" in name:
        return "it contains a backslash; separate folders by /"
    if name.startswith(("/", "~")) or re.match(r"^[A-Za-z]:", name):
        return "it is absolute; write it relative to the session folder"
    parts = PurePosixPath(name).parts
    return next(filter(None, map(_part_problem, parts)), None)


def _link_problem(joined: Path, base: Path) -> str | None:
    """Say where links lead that must not be followed.

    A circle shows in ``stat``; what ``resolve`` does with one hangs on the version of Python.
    """
    try:
        joined.stat()
    except FileNotFoundError:
        if joined.is_symlink():
            return "a symbolic link leads nowhere"
    except (PermissionError, NotADirectoryError):
        pass  # for the reader of the file to say
    except OSError:
        return "a symbolic link on the way leads in a circle, or the path is too long"
    is_inside = joined.resolve().is_relative_to(base)
    return None if is_inside else "a symbolic link leads out of the folder"


def _part_problem(part: str) -> str | None:
    """Say what is wrong with one component of a path on any of the common file systems."""
    if part == "..":
        return 'it contains ".."'
    if _RESERVED.match(part):
        return f'"{part}" is reserved on Windows'
    if part.endswith((" ", ".")):
        return f'"{part}" ends with a space or a full stop, which Windows drops'
    if any(c in '<>:"|?*' for c in part):
        return f'"{part}" contains one of < > : " | ? *, which Windows forbids'
    if len(part.encode("utf-8")) > _LONGEST_NAME:
        return f"a part of it is longer than {_LONGEST_NAME} bytes"
    return None


def _is_direction(character: str) -> bool:
    """Embeddings, overrides and isolates can make a name read as another one; marks cannot."""
    return "\u202a" <= character <= "\u202e" or "\u2066" <= character <= "\u2069"


def printable(text: str) -> str:
    """Return a text with the codes of characters that are not seen, or turn the reading direction."""
    return "".join(f"\\u{ord(c):04x}" if unicodedata.category(c) in ("Cc", "Cs", "Cf") else c for c in text)
