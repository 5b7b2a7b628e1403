"""Whether the compiled steps can be had, and what to say when they cannot.

Numba refuses to load a function whose compiled code it can keep nowhere (a read-only home, site
packages and ``NUMBA_CACHE_DIR``), and does not import at all beside a numpy that it does not know.
Neither is a reason to fail: the same steps exist in numpy. Compiling in every process instead would
cost more than most drops take.
"""

import importlib
from functools import cache

_HINT = (
    "the drop takes its steps in numpy, about ten times slower and with the same answer; set "
    "NUMBA_CACHE_DIR to a folder that can be written, or give compiled=False to silence this"
)


@cache
def why_not_compiled() -> str:
    """Return why the compiled steps cannot be loaded in this process, or nothing.

    Returns
    -------
    str
        Reason and hint in one sentence; empty when they can.
    """
    try:
        importlib.import_module("labpipe.contact.impact._bounce_compiled")
    # RuntimeError: nowhere to keep the compiled code. The others: a broken installation.
    except (RuntimeError, ImportError, OSError) as error:
        return said(error)
    return ""


def said(error: BaseException) -> str:
    """Return what went wrong with the compiled steps and what to do.

    Examples
    --------
    >>> said(OSError("no space left on device"))[:56]
    'compiled steps cannot be had (no space left on device); '
    """
    return f"compiled steps cannot be had ({str(error).splitlines()[0]}); {_HINT}"
