"""The steps of a drop, compiled ahead of the first drop that somebody waits for."""

import warnings

from labpipe.compilation import is_missing
from labpipe.contact.impact._contact import contact
from labpipe.contact.impact._drop import drop
from labpipe.materials import load


def compile_drop() -> None:
    """Compile the steps of a drop where they were not yet, and keep the code for all processes."""
    if not is_missing(contact):
        return
    with warnings.catch_warnings(action="ignore"):  # whoever drops something is told
        drop(load("acrylic"), 9.525e-3, 0.505, 1.5e-3, 0.03)
