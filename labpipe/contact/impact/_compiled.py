"""The steps of a drop, compiled ahead of the first drop that somebody waits for."""

import warnings

from labpipe.contact.impact._drop import drop
from labpipe.materials import load


def needs_compiling() -> bool:
    """Tell whether the steps of a drop would be compiled at the first one, and kept; loads the compiler."""
    from labpipe.compilation import is_missing
    from labpipe.contact.impact._contact import contact

    return is_missing(contact)


def compile_drop() -> None:
    """Compile the steps of a drop and keep the code for all processes."""
    with warnings.catch_warnings(action="ignore"):  # whoever drops something is told
        drop(load("acrylic"), 9.525e-3, 0.505, 1.5e-3, 0.03)
