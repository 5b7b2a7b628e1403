"""Identity of the code behind a result: digests of the source files of the packages that it belongs to.

A function belongs to the foundations (:data:`FOUNDATIONS`), to its own package, to the package ``shared``
next to that one, and to the files of the packages around it. Their files count whole, comments included: a
changed line may compute its kind anew, a changed kernel everything. Plug-ins that read files belong to
everything; of other distributions the version counts.
"""

import contextlib
import hashlib
import importlib.metadata
import importlib.util
import os
import time
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

from labpipe import files
from labpipe.errors import InstallationError, StorageError
from labpipe.installation import cache_folder

FOUNDATIONS = ("labpipe", "instruments", "calibration")
READERS = "labpipe.instruments"
"""Entry points of plug-ins that read files."""
LIBRARIES = ("numpy", "scipy", "pandas", "xarray", "netCDF4", "numba", "opencv-python-headless", "matplotlib")
"""Distributions whose versions can change a number or a picture."""

_SHARED = "shared"
_OF_PAGES = (".css", ".html", ".js")
"""Endings of files that nothing but a page depends on."""
_DIGITS = 16
_RACE = 2_000_000_000
"""ns in which a file may change again without another time of modification."""
_LOADED = time.time_ns()
"""Moment from which on this process may have loaded any of the files."""


class Identity(NamedTuple):
    """Digests of the source files by package, and versions of libraries."""

    packages: dict[str, str]
    libraries: dict[str, str | None]

    @property
    def digest(self) -> str:
        """All of it in one."""
        return _short(repr(self).encode())


@cache
def behind(*names: str, is_page: bool = False) -> Identity:
    """Return the identity of the code behind functions.

    Parameters
    ----------
    *names : str
        ``"package.module:function"``, or a package, which counts with all packages inside it.
    is_page : bool
        Whether style sheets, templates and scripts count too.
    """
    packages = {
        part: digest[is_page]
        for name in (*FOUNDATIONS, *_readers(), *names)
        for package, is_whole in _belonging(name)
        for part, digest in _digests(package, is_whole).items()
    }
    return Identity(dict(sorted(packages.items())), {name: version(name) for name in LIBRARIES})


def refuse_changed() -> None:
    """Refuse to go on where a source file was changed since this process may have loaded it.

    Raises
    ------
    InstallationError
        With the file.
    """
    for path, before in _seen.items():
        try:
            now = Path(path).stat().st_mtime_ns
        except OSError:
            now = -1
        if now != before or before >= _LOADED:
            raise InstallationError(f"{path} was changed while this program ran; start it again")


@cache
def version(distribution: str) -> str | None:
    """Version of an installed distribution; None where there is none."""
    try:
        return importlib.metadata.version(distribution)
    except importlib.metadata.PackageNotFoundError:
        return None


_seen: dict[str, int] = {}
"""Time of modification of every file that belongs to an identity."""
_known: dict[str, list[str]] = {}
"""By folder: signature of the names, sizes and times of its files, and the two digests."""
_new: dict[str, list[str]] = {}


def _memory() -> Path:
    return cache_folder() / "code.json"


def save() -> None:
    """Keep the digests for other processes, which then need not read files whose sizes and times are the same."""
    if _new and time.time_ns() - max(_seen.values()) > _RACE:
        with contextlib.suppress(StorageError):  # it only saves time
            files.write_bytes(_memory(), files.seal(_remembered() | _new))
            _new.clear()


def _remembered() -> dict[str, list[str]]:
    with contextlib.suppress(OSError, TypeError, ValueError):
        return dict(files.unseal(_memory().read_bytes()))
    return {}


@cache
def _readers() -> tuple[str, ...]:
    """Functions that plug-ins for reading files name."""
    return tuple(sorted(entry.value for entry in importlib.metadata.entry_points(group=READERS)))


def _belonging(name: str) -> Iterator[tuple[str, bool]]:
    """Yield packages that a function or package belongs to, and whether each counts with those inside it."""
    module, colon, _ = name.partition(":")
    home = module.rpartition(".")[0] or module if colon else module
    yield home, True
    parts = home.split(".")
    for count in range(1, len(parts)):
        yield ".".join(parts[:count]), False
    if len(parts) > 1:
        yield ".".join([*parts[:-1], _SHARED]), True


@cache
def _digests(package: str, is_whole: bool) -> dict[str, tuple[str, str]]:
    """Digests of a package's files, and of each package inside, without and with the files of pages."""
    top, *inner = package.split(".")
    try:
        spec = importlib.util.find_spec(top)
    except ValueError:  # as of a notebook
        spec = None
    if spec is None or spec.origin is None:
        return {package: ("absent", "absent")}
    if spec.submodule_search_locations is None:
        folder, name = os.path.split(spec.origin)
        return {package: _digest(folder, [(name, os.stat(spec.origin))])}  # noqa: PTH116 (as below)
    folder = os.path.join(spec.submodule_search_locations[0], *inner)  # noqa: PTH118
    if not os.path.isdir(folder):  # noqa: PTH112
        return {}
    own, below = _listed(folder, "")
    found = {package: _digest(folder, own)}
    for name in below if is_whole else ():
        entries, waiting = [], [f"{name}/"]
        while waiting:
            prefix = waiting.pop()
            more, deeper = _listed(folder, prefix)
            entries += more
            waiting += [f"{prefix}{one}/" for one in deeper]
        found[f"{package}.{name}"] = _digest(folder, entries)
    return found


_Entries = list[tuple[str, os.stat_result]]


def _listed(folder: str, prefix: str) -> tuple[_Entries, list[str]]:
    """Files, and names of the folders, in a folder; paths as text, since there are hundreds."""
    with os.scandir(f"{folder}/{prefix}") as found:
        entries = [entry for entry in found if not entry.name.startswith((".", "__pycache__"))]
    own = [(prefix + entry.name, entry.stat()) for entry in entries if not entry.is_dir()]
    return own, sorted(entry.name for entry in entries if entry.is_dir())


def _digest(folder: str, entries: _Entries) -> tuple[str, str]:
    """Digest of files by content, or as it is remembered for their sizes and times."""
    if not _known:
        _known.update(_remembered())
    entries.sort()
    _seen.update((f"{folder}/{name}", status.st_mtime_ns) for name, status in entries)
    signature = _short(repr([(name, s.st_size, s.st_mtime_ns) for name, s in entries]).encode())
    place = f"{folder}/{entries[0][0] if entries else ''}"
    if _known.get(place, [""])[0] != signature:
        contents = [[name, _short(Path(folder, name).read_bytes())] for name, _ in entries]
        plain = [entry for entry in contents if not entry[0].endswith(_OF_PAGES)]
        _new[place] = _known[place] = [signature, _short(repr(plain).encode()), _short(repr(contents).encode())]
    _, without, whole = _known[place]
    return without, whole


def _short(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()[:_DIGITS]
