"""Instruments: recognising, reading and writing their files; one package each.

:func:`read` recognises the instrument by the content of a file, never from its name. Each room is a package whose
``__init__`` defines one :class:`Instrument`; :data:`OURS` lists them in the order in which they are asked. Those of
other distributions, by entry points of the group ``labpipe.instruments``, are asked after ours.
"""

from __future__ import annotations

import os
import stat
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

from instruments import anton_paar, dice, images, keyence, mach1, phantom, photron, tables
from instruments._instrument import CONTENTS, HEAD_BYTES, Content, Instrument, NoOptions, text_of
from instruments._workbook import is_workbook, sheets
from labpipe.errors import NO_FILM, UNKNOWN_FORMAT, InputError, LabpipeError, SourceError, UsageError
from labpipe.installation import BUILD
from labpipe.plugins import Plugin, survey, tell

if TYPE_CHECKING:
    import xarray as xr

    from labpipe.frames import FrameSource

__all__ = ["BUILD", "CONTENTS", "HEAD_BYTES", "OURS", "Content", "Instrument", "NoOptions", "Options", "added"]
__all__ += ["by_name", "identify", "known", "read", "read_table", "sheets", "text_of"]

# The Keyence layout has no magic number, so it is asked last.
OURS = tuple(room.INSTRUMENT for room in (mach1, phantom, photron, anton_paar, tables, dice, images, keyence))


class Options(keyence.Options, mach1.Options, anton_paar.Options, tables.Options, images.Options, dice.Options):
    """Every option of :func:`read`; each instrument takes those of its own ``Options``."""


@cache
def added() -> tuple[Plugin[Instrument], ...]:
    """Return the plug-ins of other distributions, and why one of them is left out."""
    from importlib.metadata import entry_points  # slow to import

    entries = entry_points(group="labpipe.instruments")
    found = tuple(
        replace(plugin, found=None, problem=f'its content is "{plugin.found.content}"; known are {", ".join(CONTENTS)}')
        if plugin.found is not None and plugin.found.content not in CONTENTS
        else plugin
        for plugin in survey(entries, Instrument, [each.name for each in OURS])
    )
    tell(found)
    return found


def known() -> tuple[Instrument, ...]:
    """Return all instruments in the order in which they are asked: ours, then plug-ins."""
    return (*OURS, *(plugin.found for plugin in added() if plugin.found is not None))


def by_name(name: str) -> Instrument:
    """Return one instrument by its name. UsageError where no instrument has that name."""
    for group in (lambda: OURS, known):
        for each in group():
            if each.name == name:
                return each
    raise UsageError(f'no instrument "{name}"; known are {", ".join(each.name for each in known())}')


def identify(path: str | os.PathLike[str], *, fps: float | None = None) -> str:
    """Name the instrument that wrote a file or folder, by its content.

    Parameters
    ----------
    path, fps : path-like, float [1/s]
        The file or folder; a frame rate, with which a folder of JPEG images is a film, else photographs.

    Returns
    -------
    str
        The name of one of :func:`known`; SourceError where none recognises it.
    """
    return _identify(Path(path), fps).name


def _identify(path: Path, fps: float | None = None) -> Instrument:
    head = _head(path)
    for each in OURS:
        if each.sniff(head, path):
            return each
    if images.is_lossy_film(path, fps):
        return images.INSTRUMENT
    for plugin in added():
        try:
            if plugin.found is not None and plugin.found.sniff(head, path):
                return plugin.found
        except Exception as error:  # somebody else's code may raise anything; it is reported once
            if plugin.name not in _FAILED:
                _FAILED.add(plugin.name)
                tell([replace(plugin, problem=f"its sniff raised {type(error).__name__}: {error}")])
    raise _unknown(path, head)


_FAILED: set[str] = set()


def _unknown(path: Path, head: bytes) -> SourceError:
    """Explain that no instrument knows a file or folder, and how it may be read all the same."""
    if path.name.startswith(("~$", ".~lock.")):
        text = "a spreadsheet program keeps this file next to an open workbook"
        return SourceError(path, text, hint="Name the workbook.")
    if path.is_dir():
        return SourceError(path, "the folder holds no film that can be read", hint=images.folder_hint(path)).because(
            NO_FILM
        )
    if not head:
        return SourceError(path, "the file is empty", hint="Copy it from the instrument again.")
    if is_workbook(head):
        try:
            sheets(path)
        except SourceError as error:
            return error.because(UNKNOWN_FORMAT)
    hint = 'If you know the instrument that wrote it, name it: instrument="keyence" (or another of these).'
    if path.suffix.lower() in (".png", ".bmp", ".jpg", ".jpeg"):
        hint = "One image is no film: name the folder of its images, or the camera's own file."
    elif path.suffix.lower() in (".raw", ".mraw", ".cih", ".cihx"):
        hint = images.RAW_FRAMES
    elif b"\0" in head and not is_workbook(head):
        hint = "It is binary, of no format that is known: export readings as text, films as TIFF or PNG."
    elif named := tables.columns_hint(head, path):
        hint += f" {named}"
    elif head.lstrip()[:5].lower() in (b"<html", b"<!doc", b"<tabl"):
        hint = "This is a page of HTML, whatever its name ends in; save it from a spreadsheet as .xlsx or CSV."
    tried = ", ".join(each.name for each in known())
    return SourceError(path, f"no instrument recognises the content; tried {tried}", hint=hint).because(UNKNOWN_FORMAT)


_SPECIAL = {stat.S_IFIFO: "a named pipe", stat.S_IFSOCK: "a socket", stat.S_IFCHR: "a device", stat.S_IFBLK: "a device"}


def _head(path: Path) -> bytes:
    """Return the first bytes of a file, none of a folder; refuse what is neither."""
    try:
        mode = path.stat().st_mode
        if stat.S_ISDIR(mode):
            return b""
        if not stat.S_ISREG(mode):
            text = f"is {_SPECIAL.get(stat.S_IFMT(mode), 'no regular file')}, expected a file"
            raise SourceError(path, text, hint="Save its output to a file first.")
        with path.open("rb") as stream:
            return stream.read(HEAD_BYTES)
    except FileNotFoundError:
        raise SourceError(path, "there is no such file", hint="Check the folder and the name.") from None
    except OSError as error:
        text = f"cannot be opened: {error.strerror}"
        raise SourceError(path, text, hint="Check the permission to read it.") from None


def read(
    path: str | os.PathLike[str], *, instrument: str | None = None, **options: Unpack[Options]
) -> xr.Dataset | FrameSource:
    """Read a file of any known instrument.

    Parameters
    ----------
    path : path-like
        The file, or the folder of an image stack.
    instrument : str, optional
        The name of one of :func:`known`; by default the content of the file decides.
    **options
        For the reader of that instrument, for example ``cycle="50 us"`` for Keyence; its ``Options`` list them. With
        ``columns`` any table is read whose columns they name (:func:`instruments.tables.read`).

    Returns
    -------
    Dataset or FrameSource
        A table of readings in SI, or a lazy film.

    Raises
    ------
    SourceError, UsageError
        The file is not known, is damaged, or changes while it is read; there is no such instrument or option.

    Examples
    --------
    >>> readings = read("drop_07.csv", cycle="50 us")  # doctest: +SKIP
    """
    path = Path(path)
    if instrument is None:
        reader = tables.INSTRUMENT if options.get("columns") is not None else _identify(path, options.get("fps"))
    else:
        reader = by_name(instrument)
    for _ in range(2):
        _head(path)  # no reader waits at a named pipe
        before = path.stat()
        try:
            result: xr.Dataset | FrameSource = reader.read(path, options)
        except Exception as error:
            if reader in OURS or isinstance(error, LabpipeError):
                raise
            text = f'the plug-in "{reader.name}" failed: {type(error).__name__}: {error}'
            hint = "Report it to its maintainer; `labpipe doctor` names the distribution."
            raise SourceError(path, text, hint=hint) from error
        after = path.stat() if path.exists() else before
        if (before.st_size, before.st_mtime_ns) == (after.st_size, after.st_mtime_ns):
            return result
    text, hint = "it changed twice while it was read", "Wait until the instrument has finished, then read it again."
    raise SourceError(path, f"the file is still being written: {text}", hint=hint)


def read_table(path: str | os.PathLike[str], content: Content, usual: str, **options: Unpack[Options]) -> xr.Dataset:
    """Read a file of whichever instrument, for an experiment that needs a table of some content.

    Parameters
    ----------
    path, content : path-like, str
        The file; content of the table, one of :data:`CONTENTS`.
    usual : str
        The instrument whose reader names the fault of a file that none recognises, or that holds something else.
    **options
        As of :func:`read`, whose errors are raised; None leaves the default. InputError where the file holds a film.
    """
    import xarray as xr

    given: Any = {key: value for key, value in options.items() if value is not None}
    if "columns" in given:
        name = tables.INSTRUMENT.name
    else:
        try:
            found = _identify(Path(path))
            name = found.name if found.content == content else usual
        except SourceError:
            name = usual
    table = read(path, instrument=name, **given)
    if not isinstance(table, xr.Dataset):
        raise InputError(f"{path}: expected a table of readings, found a film")
    if "columns" in given and (holds := _OF_COLUMNS.get(content)) and holds not in table:
        raise InputError(f"{path}: the columns that are named hold no {content}")
    return table


_OF_COLUMNS = {"displacement": "out1", "force": "force_z"}
