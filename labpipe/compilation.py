"""Decorators for compiled kernels, by public options of numba.

The machine code is kept in ``NUMBA_CACHE_DIR``, which labpipe sets when it is imported
(:func:`labpipe.installation.keep_compiled_code`).
"""

from collections.abc import Callable
from functools import partial
from typing import Any

from numba import njit

njit()(lambda: None)()  # fills the tables of the compiler, which processes that are forked from this one then share

_Decorator = Callable[[Callable[..., Any]], Any]


def compiled(**options: Any) -> _Decorator:
    """Compile a kernel that Python calls, and keep its machine code; ``options`` are those of ``numba.njit``."""
    return njit(cache=True, **options)


def part(**options: Any) -> _Decorator:
    """Compile a function that only kernels call: each of them holds its code."""
    return njit(**options)


#: The same where a division by zero gives infinity, as in NumPy.
lean = partial(compiled, error_model="numpy")
inner = partial(part, error_model="numpy")
