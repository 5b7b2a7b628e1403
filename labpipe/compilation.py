"""Decorators for compiled kernels, by public options of numba.

The machine code is kept in ``NUMBA_CACHE_DIR``, which labpipe sets when it is imported
(:func:`labpipe.installation.keep_compiled_code`).
"""

from functools import partial

from numba import njit

njit(lambda: None)()  # fills the tables of the compiler, which processes that are forked from this one then share

#: A kernel that Python calls; its machine code is kept.
compiled = partial(njit, cache=True)
#: The same where a division by zero gives infinity, as in NumPy.
lean = partial(compiled, error_model="numpy", no_cfunc_wrapper=True)
#: A function that only kernels call: each holds its code.
part = partial(njit, no_cfunc_wrapper=True, no_cpython_wrapper=True)
#: The same where a division by zero gives infinity.
inner = partial(part, error_model="numpy")
