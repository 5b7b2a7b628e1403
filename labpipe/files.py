"""The only module that writes files, with the checks of names and contents.

A file is written under a temporary name in its own folder, read back and compared, flushed to the disk and only then
renamed; so a kill or a full disk leaves the old file or the new one, never a part of one. A lock is held by the
operating system and ends with its process. The netCDF side is :mod:`labpipe.netcdf`, imported when a Dataset is written
or read; nothing numerical is imported here.
"""

import contextlib
import errno
import functools
import hashlib
import json
import os
import re
import secrets
import shutil
import sys
import time
import unicodedata
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any

from labpipe.errors import InputError, SourceError, StorageError, StoreError

if TYPE_CHECKING:
    import xarray as xr

PART_SUFFIX = ".part"
"""Ending of a file that is still being written; such a file is never read."""


def write_bytes(path: str | os.PathLike[str], data: bytes | Iterable[bytes], size: int = 0) -> None:
    """Write a file, and missing folders, so that it exists complete or not at all.

    One too large to hold in memory is given in pieces, which have ``size`` bytes together. Raises StorageError: there
    is no space, or no permission; the message holds the bytes needed. An older file of that name is left as it was.
    """
    pieces, total = [data] if isinstance(data, bytes) else data, hashlib.sha256()
    with _part(Path(path), len(data) if isinstance(data, bytes) else size) as part:
        with part.open("xb") as stream:
            for chunk in pieces:
                total.update(chunk)
                stream.write(chunk)
        if digest(part) != total.hexdigest():
            raise StorageError(f"{path}: what was written cannot be read back; the disk is failing or full")


def write_text(path: str | os.PathLike[str], text: str) -> None:
    """Write text as UTF-8 with the line ends it has; see :func:`write_bytes`."""
    write_bytes(path, text.encode("utf-8"))


def write_dataset(path: str | os.PathLike[str], dataset: "xr.Dataset") -> "xr.Dataset":
    """Write a Dataset as netCDF-4 with checksums, verified value by value before it exists; see :func:`write_bytes`.

    The bytes depend on the Dataset alone. Attributes that netCDF cannot hold (None, bool, dict,
    lists of anything but numbers) become JSON text. Variables are numbers, booleans or text; times are numbers in s.

    Returns the Dataset as :func:`read_dataset` does. Raises InputError: it holds something that netCDF
    cannot give back unchanged; StorageError: there is no space, or no permission.
    """
    from labpipe import netcdf

    prepared = netcdf.prepare(dataset)
    with _part(Path(path), int(prepared.nbytes * 1.05) + 65536) as part:  # with the overhead of the format
        return netcdf.write(part, prepared)


def read_dataset(path: str | os.PathLike[str]) -> "xr.Dataset":
    """Read a netCDF file whole, and refuse one that is damaged.

    The sizes that the file declares are compared with its real size before anything is allocated.

    Raises SourceError: there is no such file; StoreError: the file is damaged: truncated, a checksum that does not fit,
    sizes that cannot be true.
    """
    from labpipe import netcdf

    source = Path(path)
    if not source.is_file():
        raise SourceError(source, "there is no such file")
    try:
        return netcdf.decode(source.read_bytes())
    except Exception as error:  # the libraries answer damage with anything
        raise StoreError(f"{source}: damaged: {error}; delete it and run again") from error


def append_line(path: str | os.PathLike[str], text: str) -> None:
    """Append one line to a log; raises StorageError where there is no space, or no permission.

    A last line that a killed process left without its end is closed first, so that it spoils no other line.
    """
    target = Path(path)
    data = text.encode("utf-8", "replace") + b"\n"
    with _writing(target, len(data)), target.open("ab+") as stream:
        if end := stream.seek(0, os.SEEK_END):
            stream.seek(end - 1)
            data = data if stream.read(1) == b"\n" else b"\n" + data
        stream.write(data)


@contextlib.contextmanager
def journal(path: str | os.PathLike[str]) -> Iterator[Callable[[str], None]]:
    """Make a file that grows during a measurement, locked as by :func:`lock`, so that a kill loses no reading.

    Yields a function that appends text. It is with the operating system when the call returns, and on the disk at
    least every second in which something is appended.

    Raises StorageError: there is no space, or no permission, or a file of that name exists.
    """
    target = Path(path)
    with _writing(target, 0):
        stream = target.open("xb")
    flushed = time.monotonic()

    def append(text: str) -> None:
        nonlocal flushed
        data = text.encode("utf-8")
        with _writing(target, len(data)):
            stream.write(data)
            stream.flush()
            if time.monotonic() - flushed >= 1.0:
                os.fsync(stream.fileno())
                flushed = time.monotonic()

    try:
        _acquire(stream.fileno(), wait=False)
        yield append
    finally:
        # What a full disk did not take was told by ``append``; closing would try it once more.
        with contextlib.suppress(OSError):
            stream.close()


def digest(path: str | os.PathLike[str], of_file: "Callable[[Path], str] | None" = None) -> str:
    """Return the SHA-256 of a file's content in hexadecimal; of a folder that of the names and digests of its files.

    Those are by ``of_file``, by default this function. Raises SourceError: the file cannot be read.
    """
    source = Path(path)
    if source.is_dir():
        lines = (f"{(of_file or digest)(f)}  {f.relative_to(source).as_posix()}\n" for f in files_below(source))
        return hashlib.sha256("".join(lines).encode("utf-8", "surrogateescape")).hexdigest()
    try:
        with source.open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()
    except OSError as error:
        raise SourceError(source, f"cannot be read: {error.strerror}") from error


def files_below(folder: Path) -> list[Path]:
    """All files in a folder and its sub-folders, in the order of their names."""
    return sorted(item for item in folder.rglob("*") if item.is_file())


def free_bytes(path: str | os.PathLike[str]) -> int:
    """Bytes that can still be written at a place, which need not exist yet."""
    place = Path(path).absolute()
    return shutil.disk_usage(next(part for part in (place, *place.parents) if part.exists())).free


def require_space(path: str | os.PathLike[str], needed: int) -> None:
    """Refuse to begin when a place has less than ``needed`` bytes left: StorageError with both numbers."""
    free = free_bytes(path)
    if free < needed:
        raise StorageError(f"{path}: about {needed} bytes are needed and {free} are free; make room there")


@contextlib.contextmanager
def _part(path: Path, needed: int) -> Iterator[Path]:
    """Name a temporary file next to a file, of which it takes the place once the block has written and verified it."""
    # The temporary name is short whatever the final one is, so a 255-byte name still works.
    part = path.parent / f".{_machine()}-{os.getpid()}-{secrets.token_hex(4)}{PART_SUFFIX}"
    try:
        with _writing(path, needed):
            remove_orphans(path.parent)
            yield part
            _flush(part)
            part.replace(path)
            if os.name != "nt":  # Windows can neither open nor flush a folder
                _flush(path.parent)
    finally:
        with contextlib.suppress(OSError):
            part.unlink(missing_ok=True)


@functools.cache
def _machine() -> str:
    """Distinguish process numbers of this machine from those of others on a share, or of other containers."""
    name = os.uname().nodename if hasattr(os, "uname") else ""
    with contextlib.suppress(OSError):
        name += str(Path("/proc/self/ns/pid").readlink())
    return hashlib.sha256(name.encode()).hexdigest()[:8]


def remove_orphans(folder: Path, *, is_deep: bool = False) -> None:
    """Remove half-written files of killed processes of this machine from a folder, and perhaps from all below it."""
    if os.name == "nt":  # where asking for a process would end it
        return
    head = f".{_machine()}-"
    with contextlib.suppress(OSError):
        for part in (folder.rglob if is_deep else folder.glob)(f"{head}*{PART_SUFFIX}"):
            try:
                os.kill(int(part.name.removeprefix(head).partition("-")[0]), 0)
            except ProcessLookupError:
                part.unlink(missing_ok=True)
            except (OSError, OverflowError, ValueError):  # somebody else's, or no number of a process at all
                continue


def _flush(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY if path.is_dir() else os.O_RDWR)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


_REFUSED = "no permission to write there; check the folder's owner and whether it is read-only"
_IN_THE_WAY = "a file stands where a folder is needed; move it away, or choose another place"
_WHY = {
    errno.EACCES: _REFUSED,
    errno.EPERM: _REFUSED,
    errno.EROFS: _REFUSED,
    errno.EEXIST: _IN_THE_WAY,
    errno.ENOTDIR: _IN_THE_WAY,
    errno.ENAMETOOLONG: "the path is too long for this file system; move the session to a shorter path",
    errno.EFBIG: "{needed} bytes are needed, more than the limit on the size of a file allows",
    errno.ENOSPC: "no space left: {needed} bytes are needed, {free} are free; make room there",
    errno.EDQUOT: "no space left: {needed} bytes are needed, {free} are free; make room there",
}


@contextlib.contextmanager
def _writing(path: Path, needed: int) -> Iterator[None]:
    """Make the folder of a file that the block writes, and say why it cannot be written."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield
    except (OSError, RuntimeError) as error:
        free, number = None, error.errno if isinstance(error, OSError) else None
        with contextlib.suppress(OSError):  # a share that went away has no free space to report
            free = free_bytes(path)
        # HDF5 reports a limit on the size of files as a missing permission, and a full disk with no number.
        is_hdf = number is None or (number == errno.EACCES and os.access(path.parent, os.W_OK))
        if is_hdf or number not in _WHY:
            number = errno.ENOSPC if free is not None and free < needed else None
        other = "{needed} bytes could not be written ({error}); is the disk there and not full?"
        why = _WHY.get(number or 0, other).format(needed=needed, free=free, error=error)
        raise StorageError(f"{path}: {why}") from error


# --- locks -----------------------------------------------------------------------------------


@contextlib.contextmanager
def lock(path: str | os.PathLike[str], *, wait: bool = True) -> Iterator[bool]:
    """Hold a lock of the operating system on a file while the block runs; it ends with its process.

    The file is made when missing, stays, and means nothing. Yields whether it is held; always true with ``wait``.
    Raises StorageError where the file cannot be made.
    """
    target = Path(path)
    with _writing(target, 0):
        handle = os.open(target, os.O_RDWR | os.O_CREAT, 0o666)
    try:
        yield _acquire(handle, wait)
    finally:
        os.close(handle)


if sys.platform == "win32":
    import msvcrt

    def _acquire(handle: int, wait: bool) -> bool:
        while True:
            try:
                msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)
            except OSError:
                if not wait:
                    return False
                time.sleep(0.05)
            else:
                return True

else:
    import fcntl

    def _acquire(handle: int, wait: bool) -> bool:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
        except BlockingIOError:
            return False
        return True


# --- small JSON records ------------------------------------------------------------------------


def canonical(value: Any) -> str:
    """JSON text that is the same for equal values: sorted keys, no spaces, NaN refused."""
    return json.dumps(value, sort_keys=True, ensure_ascii=False, separators=(",", ":"), allow_nan=False)


def seal(value: Any) -> bytes:
    """JSON text with its own SHA-256, so that :func:`unseal` notices any damage."""
    return _sealed(canonical(value).encode())


def unseal(data: bytes) -> Any:
    """Return the value given to :func:`seal`, or None when a single bit differs."""
    body = data[len(_sealed(b"")) - 2 : -2]
    try:
        return json.loads(body) if _sealed(body) == data else None
    except (ValueError, RecursionError):  # sealed, but no JSON that can be read
        return None


def _sealed(body: bytes) -> bytes:
    return b'{"sha256":"%b","body":%b}\n' % (hashlib.sha256(body).hexdigest().encode(), body)


# --- digests, kept as long as a file is the same ------------------------------------------------


class HashIndex:
    """Digests of files, remembered in an index as long as their stamps stay the same; a damaged index is empty.

    A stamp is size, times [ns] and inode; the change time of an inode shows new content under an old modification time.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self._path = Path(path)
        self._known: dict[str, list[Any]] | None = None  # read when it is first asked for
        self._is_changed = False

    def digest(self, path: str | os.PathLike[str]) -> str:
        """Return the SHA-256 of a file or folder; see :func:`labpipe.digest`."""
        source = Path(path).absolute()
        if source.is_dir():
            return digest(source, self.digest)
        name = relative(source, self._path.absolute().parent)
        try:
            status = source.stat()
        except OSError as error:
            raise SourceError(source, f"cannot be read: {error.strerror}") from error
        stamp = [status.st_size, status.st_mtime_ns, status.st_ctime_ns, status.st_ino]
        self._known = self._load() if self._known is None else self._known
        if (known := self._known.get(name, [None]))[:-1] == stamp:
            return str(known[-1])
        found = digest(source)
        # within two seconds a file may change again without another stamp
        if time.time_ns() - max(status.st_mtime_ns, status.st_ctime_ns) > 2_000_000_000:
            self._known[name], self._is_changed = [*stamp, found], True
        return found

    def save(self) -> None:
        """Keep new digests; entries that another process added meanwhile are kept too."""
        # The index only saves time: where it cannot be kept, the next call reads again.
        if self._known is not None and self._is_changed:
            with contextlib.suppress(StorageError), lock(self._path.with_suffix(".lock")):
                self._known = self._load() | self._known
                write_bytes(self._path, seal(self._known))
                self._is_changed = False

    def _load(self) -> dict[str, list[Any]]:
        try:
            found = unseal(self._path.read_bytes())
        except OSError:
            return {}
        is_ours = isinstance(found, dict) and all(isinstance(one, list) and one for one in found.values())
        return found if is_ours else {}


# --- names from untrusted text -------------------------------------------------------------------

_RESERVED = re.compile(r"(?i)^(con|prn|aux|nul|com[0-9¹²³]|lpt[0-9¹²³]|conin\$|conout\$)(\.|$)")
_LONGEST_NAME = 255
"""Bytes in one component of a path: the limit of ext4, XFS, APFS and NTFS alike."""


def safe_join(root: str | os.PathLike[str], name: str) -> Path:
    """Join a relative path with forward slashes to a folder, and refuse one that leads out of it.

    The path returned is resolved; it need not exist.

    Raises InputError: for the name see :func:`name_problem`, or a symbolic link leads out of the folder or in a circle.

    Examples
    --------
    >>> safe_join("/data/session", "../secret")
    Traceback (most recent call last):
    labpipe.errors.InputError: "../secret" is not a path inside the session folder: it contains ".."
    """
    base = Path(root).resolve()
    joined = base / name
    if (problem := name_problem(name)) is None:
        try:
            joined.stat()
        except FileNotFoundError:
            problem = "a symbolic link leads nowhere" if joined.is_symlink() else None
        except (PermissionError, NotADirectoryError):
            pass  # for the reader of the file to say
        except OSError:
            problem = "a symbolic link on the way leads in a circle, or the path is too long"
        if problem is None and not joined.resolve().is_relative_to(base):
            problem = "a symbolic link leads out of the folder"
    if problem is not None:
        shown = printable(name if len(name) <= _LONGEST_NAME else name[:60] + "…")
        raise InputError(f'"{shown}" is not a path inside the session folder: {problem}')
    return joined.resolve()


def name_problem(name: str) -> str | None:
    """Say why a session cannot name a file so on any of the common file systems, or None when it can."""
    # Embeddings, overrides and isolates can make a name read as another one; marks cannot.
    is_hidden = any(
        unicodedata.category(c) in ("Cc", "Cs") or "\u202a" <= c <= "\u202e" or "\u2066" <= c <= "\u2069" for c in name
    )
    faults: list[tuple[object, str]] = [
        (not name.strip(), "it is empty"),
        (is_hidden, "it contains a control character or one that turns the reading direction"),
        ("\\" in name, "it contains a backslash; separate folders by /"),
        (re.match(r"^(/|~|[A-Za-z]:)", name), "it is absolute; write it relative to the session folder"),
    ]
    for part in PurePosixPath(name).parts:
        is_long = len(part.encode("utf-8", "replace")) > _LONGEST_NAME
        faults += [
            (part == "..", 'it contains ".."'),
            (_RESERVED.match(part), f'"{part}" is reserved on Windows'),
            (part.endswith((" ", ".")), f'"{part}" ends with a space or a full stop, which Windows drops'),
            (any(c in '<>:"|?*' for c in part), f'"{part}" contains one of < > : " | ? *, which Windows forbids'),
            (is_long, f"a part of it is longer than {_LONGEST_NAME} bytes"),
        ]
    return next((text for is_so, text in faults if is_so), None)


def relative(path: str | os.PathLike[str], start: str | os.PathLike[str]) -> str:
    """Return the way from a folder to a path with ``/``; the whole path where it is on another drive."""
    try:
        return Path(os.path.relpath(path, start)).as_posix()
    except ValueError:
        return Path(path).as_posix()


def printable(text: str) -> str:
    """Return a text with the codes of characters that are not seen, or turn the reading direction."""
    return "".join(f"\\u{ord(c):04x}" if unicodedata.category(c) in ("Cc", "Cs", "Cf") else c for c in text)
