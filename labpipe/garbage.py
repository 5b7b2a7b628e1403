"""Work that makes many objects and no circles of them, without the search for circles."""

import gc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def uncollected() -> Iterator[None]:
    """Look for circles of objects after the block, not while it runs.

    Python looks through all objects whenever so many have been made. Where most of them stay, as the
    syntax trees of a package do, that takes up to 40 % of the time and finds nothing.
    """
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()
