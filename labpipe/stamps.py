"""Whether a file is still the same, and digests kept as long as it is: raw data are not read in every run."""

import contextlib
import os
import time
from pathlib import Path
from typing import NamedTuple

from labpipe import files
from labpipe.errors import SourceError, StorageError

_RACE = 2_000_000_000
"""ns: a file touched this recently may be touched again within the same tick of its time stamp."""


class Stamp(NamedTuple):
    """What says that a file is still the same, without reading it.

    The inode's change time is part of it, which no program can set back; so new content under an
    old modification time is noticed.
    """

    size: int
    modified: int
    changed: int
    inode: int

    @classmethod
    def of(cls, status: os.stat_result) -> "Stamp":
        """Return the stamp of what the operating system says of a file."""
        return cls(status.st_size, status.st_mtime_ns, status.st_ctime_ns, status.st_ino)

    def is_recent(self) -> bool:
        """Whether the file may change again without another stamp."""
        return time.time_ns() - max(self.modified, self.changed) <= _RACE


_Known = dict[str, tuple[Stamp, str]]


class HashIndex:
    """Digests of files, remembered as long as their stamps stay the same.

    Parameters
    ----------
    path : path-like
        Where the index is kept; a missing or damaged one is an empty one.
    paranoid : bool
        Read every file again, whatever the index says.
    """

    def __init__(self, path: str | os.PathLike[str], *, paranoid: bool = False) -> None:
        self._path = Path(path)
        self._paranoid = paranoid
        self._known: _Known | None = None
        self._fresh: _Known = {}

    @property
    def _entries(self) -> _Known:
        """What was kept, read when it is first asked for: most who open a store read one result."""
        if self._known is None:
            self._known = self._load()
        return self._known

    def digest(self, path: str | os.PathLike[str]) -> str:
        """Return the SHA-256 of a file or folder; see :func:`labpipe.files.digest`."""
        source = Path(path).absolute()
        if source.is_dir():
            return files.folder_digest(source, self.digest)
        name = os.path.relpath(source, self._path.absolute().parent)
        try:
            stamp = Stamp.of(source.stat())
        except OSError as error:
            raise SourceError(source, f"cannot be read: {error.strerror}") from error
        known = self._fresh.get(name)
        if known is None and not self._paranoid:
            known = self._entries.get(name)
        if known is not None and known[0] == stamp:
            return known[1]
        found = files.digest(source)
        if not stamp.is_recent():
            self._fresh[name] = stamp, found
        return found

    def save(self) -> None:
        """Keep what was learnt; entries that another process added meanwhile are kept too."""
        if not self._fresh:
            return
        # The index only saves time: where it cannot be kept, the next call reads again.
        with contextlib.suppress(StorageError), files.lock(self._path.with_suffix(".lock")):
            self._known = self._load() | self._fresh
            files.write_bytes(
                self._path, files.seal({name: [*stamp, found] for name, (stamp, found) in self._known.items()})
            )
            self._fresh = {}

    def _load(self) -> _Known:
        try:
            found = files.unseal(self._path.read_bytes())
            return {name: (Stamp(*stamp), digest) for name, (*stamp, digest) in found.items()}
        except (OSError, AttributeError, TypeError, ValueError):  # absent, damaged, or another record of ours
            return {}
