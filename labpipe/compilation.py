"""Decorators for compiled kernels, by public options of numba, and the folder that keeps their machine code.

By itself numba compares the file of a kernel alone, not those of the kernels and constants that its code holds. So
the folder belongs to the present source of all kernels; it is in ``NUMBA_CACHE_DIR``, by default the user's caches.
"""

import atexit
import contextlib
import hashlib
import os
import re
import shutil
import tempfile
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from typing import Any

import numba

from labpipe.files import free_bytes

_Decorator = Callable[[Callable[..., Any]], Any]
_KERNELS = re.compile(r"\bnjit\b|labpipe\.compilation")
_IMPORTED = re.compile(r"^from (?:\w+\.)*(\w+) import", re.MULTILINE)


@cache
def kernel_digest(*folders: Path) -> str:
    """Digest of the source of all kernels in folders, and of the modules that they import from there."""
    sources = {path: path.read_text("utf-8", "replace") for folder in folders for path in folder.rglob("*.py")}
    kernels = {path for path, text in sources.items() if _KERNELS.search(text)}
    imported = {name for path in kernels for name in _IMPORTED.findall(sources[path])}
    held = sorted(path for path in sources if path in kernels or path.stem in imported)
    return hashlib.sha256("".join(sources[path] for path in held).encode("utf-8", "replace")).hexdigest()[:16]


def place_for_code(stated: str, room: int = 50_000_000) -> Path:
    """Return a folder with room [bytes] to write: the stated one, that of the user for caches, or a temporary one.

    All kernels together take a tenth of that room.
    """
    # Path.home raises where there is none
    user = Path(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"), "labpipe")  # noqa: PTH111
    base = Path(stated) if stated else user
    with contextlib.suppress(OSError):  # where there is no temporary place either, numba looks for one itself
        there = next(path for path in (base, *base.parents) if path.exists())
        if not (there.is_dir() and os.access(there, os.W_OK | os.X_OK) and free_bytes(there) > room):
            base = Path(tempfile.mkdtemp(prefix="labpipe-"))
            atexit.register(shutil.rmtree, base, ignore_errors=True)
    return base


_HERE = Path(__file__).parent
_CONFIG: Any = numba.config  # its names are made when it is imported
_PLACE = place_for_code(_CONFIG.CACHE_DIR)
numba.njit()(lambda: None)()  # fills the tables of the compiler, which processes forked from this one then share


def njit(*, cache: bool = False, **options: Any) -> _Decorator:
    """Compile a function as ``numba.njit`` does; with ``cache`` its machine code is kept, as for one that Python calls.

    A function that only kernels call needs none: each of them holds its code.
    """

    def decorate(function: Callable[..., Any]) -> Any:
        beside = Path(function.__code__.co_filename).parent
        folders = (_HERE,) if beside.is_relative_to(_HERE) else (_HERE, beside)
        _CONFIG.CACHE_DIR = str(_PLACE / f"kernels-{kernel_digest(*folders)}")
        return numba.njit(cache=cache, **options)(function)

    return decorate


compiled = partial(njit, cache=True)
#: The same where a division by zero gives infinity, as in NumPy: for Python, and for kernels alone.
lean = partial(njit, cache=True, error_model="numpy")
inner = partial(njit, error_model="numpy")
