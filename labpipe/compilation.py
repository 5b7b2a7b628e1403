"""Compile numerical kernels with numba, and cache the machine code where possible."""

import re
import sys
import warnings
from collections.abc import Callable
from contextlib import ExitStack, suppress
from functools import cache, partial
from pathlib import Path
from typing import Any

import numba
from numba import njit

from labpipe.errors import StorageError
from labpipe.files import lock
from labpipe.garbage import uncollected


def compiled(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Return a decorator that compiles a kernel once per machine, or else once per process.

    Numba refuses a cached function whose code it can keep nowhere (read-only home, site packages
    and ``NUMBA_CACHE_DIR``), and fails at the first call where the disk is full. The kernels have
    no slower twin, so they are then compiled again in each process: the same answer some seconds
    later.

    Parameters
    ----------
    **options
        Passed to ``numba.njit``.
    """

    def decorate(function: Callable[..., Any]) -> Any:
        try:
            kernel = njit(cache=True, **options)(function)
        except RuntimeError as error:
            reason = str(error).splitlines()[0].partition(": ")[2]
            _warn(reason.partition(" for file")[0])
            return njit(**options)(function)
        _watch_imports(kernel, function.__module__)
        _forgive_a_full_disk(kernel)
        _wait_for_others(kernel)
        return kernel

    return decorate


def is_missing(kernel: Any) -> bool:
    """Tell whether a kernel has to be compiled here, and others will find what was compiled."""
    stored = getattr(getattr(kernel, "_cache", None), "_cache_file", None)
    return stored is not None and not stored._load_index()


def _linked_only() -> dict[str, Any]:
    """Return what makes numba leave a function to the kernels that call it, where its insides are known.

    Of a later release each function is finished by itself as well: the same answer, compiled in twice the time.
    """
    if numba.version_info.short > _LAST_KNOWN:
        return {}
    from labpipe._linked import LinkedOnly

    return {"pipeline_class": LinkedOnly}


_LAST_KNOWN = (0, 68)
#: Of kernels that allocate nothing: not counting references to their arrays halves the time to compile.
lean = partial(compiled, error_model="numpy", no_cfunc_wrapper=True, _nrt=False)
#: Of what only compiled code calls, and allocates: each kernel that calls it holds and stores it.
part = partial(njit, no_cfunc_wrapper=True, no_cpython_wrapper=True, **_linked_only())
#: The same where nothing is allocated.
inner = partial(part, error_model="numpy", _nrt=False)


def _watch_imports(kernel: Any, module: str) -> None:
    """Let stored code count as old when another module changes whose kernels or constants it holds.

    By itself numba looks at the time and size of the file of the kernel alone.
    """
    stored = getattr(getattr(kernel, "_cache", None), "_cache_file", None)
    if stored is not None:
        stored._source_stamp = (stored._source_stamp, _stamps(module))


@cache
def _stamps(module: str) -> tuple[object, ...]:
    """Time and size of the modules of labpipe that a module of kernels imports, and so on."""
    text = Path(str(sys.modules[module].__file__)).read_text("utf-8")
    found: list[object] = []
    if "labpipe.compilation" in text:
        for name in sorted(set(re.findall(r"^from ((?:labpipe|pipelines)[\w.]*) import", text, re.MULTILINE))):
            state = Path(str(sys.modules[name].__file__)).stat()
            found += [name, state.st_mtime_ns, state.st_size, *_stamps(name)]
    return tuple(found)


def _forgive_a_full_disk(kernel: Any) -> None:
    """Let a kernel that is compiled, but cannot be stored, be used all the same."""
    store = getattr(getattr(kernel, "_cache", None), "save_overload", None)
    if store is None:  # compilation is switched off, or numba keeps its cache elsewhere
        return

    def save_overload(*arguments: Any) -> None:
        try:
            store(*arguments)
        except OSError as error:
            _warn(str(error))

    kernel._cache.save_overload = save_overload


def _wait_for_others(kernel: Any) -> None:
    """Let one process compile a kernel while others that need it wait, and take what it has stored."""
    store: Any = getattr(kernel, "_cache", None)
    if getattr(store, "_cache_file", None) is None:
        return
    load, compile_here = store.load_overload, kernel.compile
    held = ExitStack()

    def load_overload(*arguments: Any) -> Any:
        found = load(*arguments)
        if found is None:
            held.close()  # of another signature, which this one is part of
            with suppress(StorageError):  # nothing will be stored there either
                held.enter_context(lock(Path(store.cache_path) / f"{store._impl.filename_base}.lock"))
                found = load(*arguments)
        return found

    def compile_one(signature: Any) -> Any:
        with held, uncollected():  # a sixth of the time
            return compile_here(signature)

    store.load_overload, kernel.compile = load_overload, compile_one


@cache  # one warning for all kernels
def _warn(reason: str) -> None:
    text = f"compiled code cannot be kept ({reason}): each process compiles it again, which takes some seconds; "
    text += "set NUMBA_CACHE_DIR to a folder that can be written"
    warnings.warn(text, UserWarning, stacklevel=3)
