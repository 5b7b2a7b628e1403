"""Identity of the code behind a result: digests of the source files of the packages that it belongs to.

A function belongs to the foundations (:data:`FOUNDATIONS`), to its own package, to the package ``shared``
next to that one, and to the files of the packages around it. Their files count whole, comments included: a
changed line may compute its kind anew, a changed kernel everything. Guides and licences do not count. Plug-ins
that read files belong to everything; of other distributions the version counts.
"""

import hashlib
import importlib.metadata
import importlib.util
import os
import time
from collections.abc import Mapping
from functools import cache
from pathlib import Path

from labpipe.errors import InstallationError

FOUNDATIONS = ("labpipe", "instruments", "calibration")
READERS = "labpipe.instruments"
"""Entry points of plug-ins that read files."""
LIBRARIES = ("numpy", "scipy", "pandas", "xarray", "netCDF4", "numba", "opencv-python-headless", "matplotlib")
"""Distributions whose versions can change a number or a picture."""

_SHARED = "shared"
_FOR_READERS = (".md", ".LICENSE", ".typed")
"""Endings of files that no result depends on, as on those in folders called ``documentation``."""
_LOADED = time.time_ns()
"""Moment from which on this process may have loaded any of the files."""
_seen: dict[str, tuple[int, str]] = {}
"""Time of modification and digest of every file that belongs to an identity."""


@cache
def behind(*names: str) -> dict[str, str | None]:
    """Return the identity of the code behind functions, ``"package.module:function"``, or whole packages.

    It has the digest of every package, and the version of every library.
    """
    packages: dict[str, str] = {}
    for name in (*FOUNDATIONS, *readers(), *names):
        module, colon, _ = name.partition(":")
        home = (module.rpartition(".")[0] or module) if colon else module
        *around, _ = home.split(".")
        for count in range(1, len(around) + 1):
            packages |= _digests(".".join(around[:count]), False)
        for package in (home, ".".join([*around, _SHARED])) if around else (home,):
            packages |= _digests(package, True)
    return dict(sorted(packages.items())) | {f"{name} (library)": version(name) for name in LIBRARIES}


def refuse_changed(function: str, known: Mapping[str, str | None]) -> None:
    """Refuse a result where the code behind its function is not that of the plan, or may not be what was loaded.

    Raises InstallationError: with the function, or with the file that was changed.
    """
    if behind(function) != known:
        text = "files of the program were changed while it ran, or are others on this machine; start it again"
        raise InstallationError(f"{function}: {text}")
    for path, (before, _) in _seen.items():
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


@cache
def readers() -> tuple[str, ...]:
    """Functions that plug-ins for reading files name."""
    return tuple(sorted(entry.value for entry in importlib.metadata.entry_points(group=READERS)))


@cache
def _digests(package: str, is_whole: bool) -> dict[str, str]:
    """Digest of a package's own files and, of a whole one, of each package inside it."""
    top, *inner = package.split(".")
    try:
        spec = importlib.util.find_spec(top)
    except ValueError:  # as of a notebook
        spec = None
    if spec is None or spec.origin is None:
        return {package: "absent"}
    if spec.submodule_search_locations is None:
        return {package: _digest(spec.origin)}
    found: dict[str, list[tuple[str, str]]] = {}
    root = os.path.join(spec.submodule_search_locations[0], *inner)  # noqa: PTH118 (text: there are hundreds of files)
    for place, below, names in os.walk(root):
        kept = [name for name in below if not name.startswith((".", "__pycache__", "documentation"))]
        below[:] = sorted(kept) if is_whole else []
        within = place[len(root) + 1 :]
        part = within.partition(os.sep)[0]
        entries = found.setdefault(f"{package}.{part}" if part else package, [])
        for name in sorted(names):
            if not name.startswith(".") and not name.endswith(_FOR_READERS):
                entries.append((f"{within}/{name}", _digest(f"{place}/{name}")))
    return {part: _short(repr(files).encode()) for part, files in found.items() if files}


def _digest(path: str) -> str:
    """Digest of a file, read once."""
    if path not in _seen:
        with open(path, "rb") as stream:  # noqa: PTH123 (as above)
            _seen[path] = os.fstat(stream.fileno()).st_mtime_ns, _short(stream.read())
    return _seen[path][1]


def _short(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()[:16]
