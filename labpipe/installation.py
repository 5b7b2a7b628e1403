"""Where labpipe is installed and keeps what it can make again, and whether its packages are its own."""

import atexit
import hashlib
import importlib.util
import os
import re
import shutil
import sys
import tempfile
from collections.abc import Iterable
from pathlib import Path

_MARK = "from labpipe.build import BUILD"  # in the __init__ of each of our packages


def foreign_package(names: Iterable[str]) -> str | None:
    """Name the first of our packages that another distribution has replaced or removed, if any.

    Each carries the mark of the build. Its source is read, not run: what a foreign package of the
    same name does or fails to import is nothing that labpipe should begin with.
    """
    for name in names:
        spec = importlib.util.find_spec(name)
        if spec is None or spec.origin is None:
            return (
                f"the module `{name}` of labpipe is missing or has lost its files: removing another distribution with "
                "a package of the same name takes them away; install labpipe again, in a separate environment"
            )
        get_source = getattr(spec.loader, "get_source", lambda _: "")
        if _MARK not in (get_source(name) or ""):
            return (
                f"the module `{name}` at {spec.origin} is not labpipe's: another distribution has "
                "installed a package of the same name; use a separate environment for labpipe"
            )
    return None


def cache_folder() -> Path:
    """Folder of the user for what can be made again: ``$XDG_CACHE_HOME/labpipe``, or what the system has for it."""
    home = Path(os.path.expanduser("~"))  # noqa: PTH111 (Path.home raises where there is none)
    if sys.platform == "win32":
        base = Path(os.environ.get("LOCALAPPDATA") or home / "AppData/Local")
    elif sys.platform == "darwin":
        base = home / "Library/Caches"
    else:
        base = Path(os.environ.get("XDG_CACHE_HOME") or home / ".cache")
    return base / "labpipe"


def keep_compiled_code(*folders: Path) -> None:
    """Let numba keep machine code in a folder that belongs to the present source of all kernels.

    By itself numba looks at the file of a kernel alone, not at those of the kernels and types that its code holds.
    The folder lies in ``NUMBA_CACHE_DIR`` where that is stated, otherwise in that of the user for caches. Where
    nothing can be written, or the disk is full, it lies in a temporary one, and this program compiles again.

    Parameters
    ----------
    *folders : Path
        Packages with kernels.
    """
    name = f"kernels-{kernel_digest(*folders)}"
    base = Path(os.environ.get("NUMBA_CACHE_DIR") or cache_folder())
    if base.name.startswith("kernels-"):  # of the program that started this one
        base = base.parent
    if not _has_room(base / name):
        try:
            base = Path(tempfile.mkdtemp(prefix="labpipe-"))
        except OSError:
            return
        atexit.register(shutil.rmtree, base, ignore_errors=True)
    os.environ["NUMBA_CACHE_DIR"] = str(base / name)
    if "numba" in sys.modules:
        sys.modules["numba"].config.CACHE_DIR = str(base / name)


_KERNELS = re.compile(rb"\bnjit\b|labpipe\.compilation")
_IMPORTED = re.compile(rb"^from ((?:labpipe|pipelines)[\w.]*) import", re.MULTILINE)
_ROOM = 50_000_000
"""Bytes; all kernels together take a tenth of it."""


def kernel_digest(*folders: Path) -> str:
    """Digest of the source of all kernels and of the modules that they import."""
    sources: dict[bytes, bytes] = {}
    for folder in folders:
        above = folder.parent if folder.name == "labpipe" else folder.parents[1]
        for at, _, names in os.walk(folder):
            module = os.path.relpath(at, above).replace(os.sep, ".")
            for name in names:
                if name.endswith(".py"):
                    with open(f"{at}/{name}", "rb", 0) as file:  # noqa: PTH123 (hundreds of files, at every start)
                        sources[f"{module}.{name[:-3]}".encode()] = file.read()
    kernels = {name for name, text in sources.items() if _KERNELS.search(text)}
    imported = {name for kernel in kernels for name in _IMPORTED.findall(sources[kernel])}
    digest = hashlib.sha256()
    for name in sorted(kernels | (imported & sources.keys())):
        digest.update(sources[name])
    return digest.hexdigest()[:16]


def _has_room(folder: Path) -> bool:
    """Whether a folder, which need not exist, can be written to and has room."""
    there = next(path for path in (folder, *folder.parents) if path.exists())
    try:
        return there.is_dir() and os.access(there, os.W_OK | os.X_OK) and shutil.disk_usage(there).free > _ROOM
    except OSError:
        return False
