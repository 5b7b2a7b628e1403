"""The installation: version, packages and their names, compiled code, and the folder for caches."""

import ast
import contextlib
import hashlib
import importlib.util
import os
import re
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

from labpipe.errors import InstallationError

__version__ = "0.1.0"

# All four packages carry this mark; a foreign package of the same name does not (see `doctor`).
BUILD = f"labpipe {__version__}"

_MARK = "from labpipe.installation import BUILD"  # in the __init__ of each of our packages


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
        import atexit  # rarely
        import shutil
        import tempfile

        try:
            base = Path(tempfile.mkdtemp(prefix="labpipe-"))
        except OSError:
            return
        atexit.register(shutil.rmtree, base, ignore_errors=True)
    os.environ["NUMBA_CACHE_DIR"] = str(base / name)
    if "numba" in sys.modules:
        sys.modules["numba"].config.CACHE_DIR = str(base / name)


_KERNELS = re.compile(r"\bnjit\b|labpipe\.compilation")
_IMPORTED = re.compile(r"^from ((?:labpipe|pipelines)[\w.]*) import", re.MULTILINE)
_DIGEST = re.compile(r"[0-9a-f]{16}")
_RACE = 2_000_000_000
"""ns in which a file may change again without another time of modification."""
_ROOM = 50_000_000
"""Bytes; all kernels together take a tenth of it."""


def kernel_digest(*folders: Path) -> str:
    """Digest of the source of all kernels and of the modules that they import, remembered while no file changes."""
    paths = {name: status for folder in folders for name, status in _modules(str(folder))}
    seen = repr([(name, status.st_size, status.st_mtime_ns) for name, status in sorted(paths.items())])
    signature = hashlib.sha256(seen.encode()).hexdigest()
    memory = cache_folder() / f"kernels-at-{hashlib.sha256(repr(folders).encode()).hexdigest()[:16]}"
    try:
        known, _, digest = memory.read_text("utf-8").partition(" ")
    except (OSError, UnicodeDecodeError):
        known = digest = ""
    if known == signature and _DIGEST.fullmatch(digest):
        return digest
    digest = _read_kernels(folders, sorted(paths))
    if max((status.st_mtime_ns for status in paths.values()), default=0) < time.time_ns() - _RACE:
        from labpipe.errors import StorageError
        from labpipe.files import write_text

        with contextlib.suppress(StorageError):  # it only saves time
            write_text(memory, f"{signature} {digest}")
    return digest


def _modules(folder: str) -> Iterator[tuple[str, os.stat_result]]:
    with os.scandir(folder) as entries:
        for entry in entries:
            if entry.name.endswith(".py"):
                yield entry.path, entry.stat()
            elif not entry.name.startswith((".", "__")) and entry.is_dir():
                yield from _modules(entry.path)


def _read_kernels(folders: Sequence[Path], paths: Sequence[str]) -> str:
    above = [folder.parent if folder.name == "labpipe" else folder.parents[1] for folder in folders]
    sources: dict[str, str] = {}
    for path in map(Path, paths):
        root = next(root for root in above if path.is_relative_to(root))
        sources[".".join(path.relative_to(root).with_suffix("").parts)] = path.read_text("utf-8", "replace")
    kernels = {name for name, text in sources.items() if _KERNELS.search(text)}
    imported = {name for kernel in kernels for name in _IMPORTED.findall(sources[kernel])}
    texts = [sources[name] for name in sorted(kernels | (imported & sources.keys()))]
    return hashlib.sha256("".join(texts).encode("utf-8", "replace")).hexdigest()[:16]


def _has_room(folder: Path) -> bool:
    """Whether a folder, which need not exist, can be written to and has room."""
    import shutil

    there = next(path for path in (folder, *folder.parents) if path.exists())
    try:
        return there.is_dir() and os.access(there, os.W_OK | os.X_OK) and shutil.disk_usage(there).free > _ROOM
    except OSError:
        return False


# --- names that packages import when they are first used (PEP 562) ---------------------------


def lazily(package: str, above: Sequence[str] = ()) -> Callable[[str], Any]:
    """Return a ``__getattr__`` for a package, which imports the module of a name on its first use.

    Parameters
    ----------
    package : str
        The package's ``__name__``. Its public names are those that it imports under
        ``if TYPE_CHECKING:``, by whole names of modules, and those that it imports at once as themselves
        or defines; all are its ``__all__``, and what ``dir`` lists.
    above : sequence of str
        Packages of the same distribution that a name may come from: another distribution may have
        replaced them, which is told (InstallationError) before any of them is imported.
    """
    homes: dict[str, tuple[str, str]] = {}
    unchecked = set(above)

    def load(name: str) -> Any:
        if not homes:
            homes.update(_for_the_checker(package))
        if name == "__all__":
            return sorted({*homes, *_there_at_once(package)})
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        module, inner = homes[name]
        if module.partition(".")[0] in unchecked:  # once, not each time that a name is used
            if (clash := foreign_package(above)) is not None:
                raise InstallationError(clash)
            unchecked.clear()
        return getattr(importlib.import_module(module), inner)

    sys.modules[package].__dict__["__dir__"] = lambda: load("__all__")
    return load


def _statements(package: str) -> list[ast.stmt]:
    """Return what stands in a package's ``__init__``."""
    loader: Any = sys.modules[package].__loader__
    return ast.parse(loader.get_source(package)).body


def _there_at_once(package: str) -> Iterator[str]:
    """Yield the public names that a package defines, or imports as themselves, when it is imported."""
    for statement in _statements(package):
        if isinstance(statement, ast.ImportFrom):
            yield from (n.name for n in statement.names if n.asname == n.name)
        elif isinstance(statement, ast.FunctionDef | ast.ClassDef) and not statement.name.startswith("_"):
            yield statement.name
        elif isinstance(statement, ast.Assign):
            named = (target.id for target in statement.targets if isinstance(target, ast.Name))
            yield from (name for name in named if not name.startswith("_"))


def _for_the_checker(package: str) -> Iterator[tuple[str, tuple[str, str]]]:
    """Yield the names that a package imports for the type checker alone, with module and name there."""
    for statement in _statements(package):
        if isinstance(statement, ast.If) and ast.unparse(statement.test) == "TYPE_CHECKING":
            for part in statement.body:
                if isinstance(part, ast.ImportFrom) and part.module:
                    yield from ((n.asname or n.name, (part.module, n.name)) for n in part.names)
