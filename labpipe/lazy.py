"""Public interfaces of packages whose modules are imported when they are first used (PEP 562)."""

import ast
import importlib
import sys
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from labpipe.errors import InstallationError
from labpipe.installation import foreign_package


def lazily(package: str, above: Sequence[str] = ()) -> Callable[[str], Any]:
    """Return a ``__getattr__`` for a package, which imports the module of a name on its first use.

    Parameters
    ----------
    package : str
        The package's ``__name__``. Its public names are those that it imports under
        ``if TYPE_CHECKING:``, by whole names of modules; they are its ``__all__`` too.
    above : sequence of str
        Packages of the same distribution that a name may come from: another distribution may have
        replaced them, which is told (InstallationError) before any of them is imported.
    """
    homes: dict[str, tuple[str, str]] = {}
    unchecked = set(above)

    def load(name: str) -> Any:
        if not homes:
            homes.update(_for_the_checker(package))
        if name == "__all__":
            return sorted(homes)
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        module, inner = homes[name]
        if module.partition(".")[0] in unchecked:  # once, not each time that a name is used
            if (clash := foreign_package(above)) is not None:
                raise InstallationError(clash)
            unchecked.clear()
        return getattr(importlib.import_module(module), inner)

    return load


def _for_the_checker(package: str) -> Iterator[tuple[str, tuple[str, str]]]:
    """Yield the names that a package imports for the type checker alone, with module and name there."""
    loader: Any = sys.modules[package].__loader__
    for statement in ast.parse(loader.get_source(package)).body:
        if isinstance(statement, ast.If) and ast.unparse(statement.test) == "TYPE_CHECKING":
            for part in statement.body:
                if isinstance(part, ast.ImportFrom) and part.module:
                    yield from ((n.asname or n.name, (part.module, n.name)) for n in part.names)
