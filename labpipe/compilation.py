"""Compile the image kernels with numba, and cache the machine code where possible."""

import warnings
from collections.abc import Callable
from functools import cache
from typing import Any

from numba import njit


def compiled(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Return a decorator that compiles a kernel once per machine, or else once per process.

    Numba refuses a cached function whose code it can keep nowhere (read-only home, site packages
    and ``NUMBA_CACHE_DIR``). The kernels have no slower twin, so they are then compiled again in
    each process: the same answer some seconds later.

    Parameters
    ----------
    **options
        Passed to ``numba.njit``.
    """

    def decorate(function: Callable[..., Any]) -> Any:
        try:
            return njit(cache=True, **options)(function)
        except RuntimeError as error:
            _warn(str(error).splitlines()[0].partition(": ")[2])
            return njit(**options)(function)

    return decorate


@cache  # one warning for all kernels
def _warn(reason: str) -> None:
    warnings.warn(
        f"compiled image kernels cannot be kept ({reason}): each process compiles them again, "
        "which takes some seconds; set NUMBA_CACHE_DIR to a folder that can be written",
        UserWarning,
        stacklevel=3,
    )
