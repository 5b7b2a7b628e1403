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
        ``if TYPE_CHECKING:``, by whole names of modules, and those that it imports at once as themselves
        or defines; all are its ``__all__``, and what ``dir`` lists.
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
            return sorted({*homes, *_there_at_once(package)})
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        module, inner = homes[name]
        if module.partition(".")[0] in unchecked:  # once, not each time that a name is used
            if (clash := foreign_package(above)) is not None:
                raise InstallationError(clash)
            unchecked.clear()
        return getattr(importlib.import_module(module), inner)

    sys.modules[package].__dict__["__dir__"] = lambda: load("__all__")
    return load


def _statements(package: str) -> list[ast.stmt]:
    """Return what stands in a package's ``__init__``."""
    loader: Any = sys.modules[package].__loader__
    return ast.parse(loader.get_source(package)).body


def _there_at_once(package: str) -> Iterator[str]:
    """Yield the public names that a package defines, or imports as themselves, when it is imported."""
    for statement in _statements(package):
        if isinstance(statement, ast.ImportFrom):
            yield from (n.name for n in statement.names if n.asname == n.name)
        elif isinstance(statement, ast.FunctionDef | ast.ClassDef) and not statement.name.startswith("_"):
            yield statement.name
        elif isinstance(statement, ast.Assign):
            named = (target.id for target in statement.targets if isinstance(target, ast.Name))
            yield from (name for name in named if not name.startswith("_"))


def _for_the_checker(package: str) -> Iterator[tuple[str, tuple[str, str]]]:
    """Yield the names that a package imports for the type checker alone, with module and name there."""
    for statement in _statements(package):
        if isinstance(statement, ast.If) and ast.unparse(statement.test) == "TYPE_CHECKING":
            for part in statement.body:
                if isinstance(part, ast.ImportFrom) and part.module:
                    yield from ((n.asname or n.name, (part.module, n.name)) for n in part.names)
