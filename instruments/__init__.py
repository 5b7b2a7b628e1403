"""One module per instrument: bytes to Dataset, and back.

:func:`read` tells the instrument from the content of a file, never from its name. Adding an
instrument is one line in :data:`READERS`: a name, a test of the first bytes
(:mod:`instruments.sniff`), and the reader as ``"module:function"``, imported only when needed.
"""

import importlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from instruments import sniff
from labpipe import BUILD
from labpipe.errors import SourceError, UsageError

if TYPE_CHECKING:
    import xarray as xr

    from labpipe.frames import FrameSource

__all__ = ["BUILD", "READERS", "Reader", "identify", "read"]


class Reader(NamedTuple):
    """One instrument: its name, how its files are told, and the function that reads them."""

    name: str
    sniff: Callable[[bytes, Path], bool]
    function: str


READERS: tuple[Reader, ...] = (
    Reader("mach1", sniff.is_mach1, "instruments.mach1:read"),
    Reader("phantom", sniff.is_phantom, "instruments.phantom:read"),
    Reader("anton_paar", sniff.is_anton_paar, "instruments.anton_paar:read"),
    Reader("plain_table", sniff.is_plain_table, "instruments.plain_table:read"),
    Reader("dice", sniff.is_dice, "instruments.dice:read"),
    Reader("image_stack", sniff.is_image_stack, "instruments.image_stack:read"),
    # The Keyence layout has no magic number, so it is asked last.
    Reader("keyence", sniff.is_keyence, "instruments.keyence:read"),
)


def identify(path: str | os.PathLike[str]) -> str:
    """Name the instrument that wrote a file or folder, by its content.

    Returns
    -------
    str
        A name from :data:`READERS`.

    Raises
    ------
    SourceError
        The file cannot be opened, or no instrument recognises it.

    Examples
    --------
    >>> identify("session/raw/sinusoid.txt")  # doctest: +SKIP
    'mach1'
    """
    return _identify(Path(path)).name


def _identify(path: Path) -> Reader:
    head = _head(path)
    if path.suffix == ".recording":
        raise SourceError(
            path,
            "this is an unfinished recording",
            hint=f"Finish it with `labpipe acquire recover {path}`.",
        )
    for reader in READERS:
        if reader.sniff(head, path):
            return reader
    tried = ", ".join(reader.name for reader in READERS)
    raise SourceError(
        path,
        f"no instrument recognises the content; tried {tried}",
        hint='If you know what wrote it, say so: instrument="keyence" (or another of these).',
    )


def _head(path: Path) -> bytes:
    try:
        if path.is_dir():
            return b""
        with path.open("rb") as stream:
            return stream.read(sniff.HEAD_BYTES)
    except OSError as error:
        raise _unopened(path, error) from None


def _unopened(path: Path, error: OSError) -> SourceError:
    is_absent = isinstance(error, FileNotFoundError)
    return SourceError(
        path,
        "there is no such file" if is_absent else f"cannot be opened: {error.strerror}",
        hint="Check the folder and the name." if is_absent else "Check the permission to read it.",
    )


def read(
    path: str | os.PathLike[str], *, instrument: str | None = None, **options: Any
) -> "xr.Dataset | FrameSource":
    """Read a file of any known instrument.

    Parameters
    ----------
    path : path-like
        The file, or the folder of an image stack.
    instrument : str, optional
        A name from :data:`READERS`; by default the content of the file decides.
    **options
        Passed to the reader of that instrument, for example ``cycle="50 us"`` for Keyence.

    Returns
    -------
    Dataset or FrameSource
        A table of readings in SI, or a lazy film.

    Raises
    ------
    SourceError
        The file is not known, is damaged, or changes while it is read.
    UsageError
        The instrument has no such name.

    Examples
    --------
    >>> readings = read("drop_07.csv", cycle="50 us")  # doctest: +SKIP
    """
    path = Path(path)
    reader = _identify(path) if instrument is None else _by_name(instrument)
    module, function = reader.function.split(":")
    call = getattr(importlib.import_module(module), function)
    before = _stamp(path)
    result = call(path, **options)
    if _stamp(path) != before:
        before = _stamp(path)
        result = call(path, **options)
        if _stamp(path) != before:
            raise SourceError(
                path,
                "the file is still being written: it changed twice while it was read",
                hint="Wait until the instrument has finished, then read it again.",
            )
    return result


def _by_name(name: str) -> Reader:
    for reader in READERS:
        if reader.name == name:
            return reader
    message = f'no instrument "{name}"; known are {", ".join(r.name for r in READERS)}'
    raise UsageError(message)


def _stamp(path: Path) -> tuple[int, int]:
    try:
        status = path.stat()
    except OSError as error:
        raise _unopened(path, error) from None
    return status.st_size, status.st_mtime_ns
