"""Faces that load what they give away when it is first used (PEP 562)."""

import importlib
from collections.abc import Callable, Mapping
from typing import Any


def lazily(package: str, homes: Mapping[str, str], *, from_the_top: bool = False) -> Callable[[str], Any]:
    """Return a ``__getattr__`` for a face, which loads the module of a name on its first use.

    Parameters
    ----------
    package : str
        The face's ``__name__``.
    homes : mapping
        Public name to the inner module that defines it; ``"module:name"`` where it has another
        name there.
    from_the_top : bool
        The modules are named whole and may lie elsewhere.
    """

    def load(name: str) -> Any:
        if name not in homes:
            message = f"module {package!r} has no attribute {name!r}"
            raise AttributeError(message)
        module, _, inner = homes[name].partition(":")
        home = module if from_the_top else f"{package}.{module}"
        return getattr(importlib.import_module(home), inner or name)

    return load
