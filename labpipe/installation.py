"""The installation: version, the mark of our packages, and names that packages import when they are first used."""

import ast
import importlib.util
import sys
from collections.abc import Callable, Iterable, Sequence
from typing import Any

from labpipe.errors import InstallationError

__version__ = "1.0.0"

# All four packages carry this mark; a foreign package of the same name does not (see `doctor`).
BUILD = f"labpipe {__version__}"

_MARK = "from labpipe.installation import BUILD"  # in the __init__ of each of our packages


def foreign_package(names: Iterable[str]) -> str | None:
    """Name the first of our packages that another distribution has replaced or removed, if any.

    Each carries the mark of the build. Its source is read, not run: nothing of a foreign package of the same name
    should run before this is said.
    """
    for name in names:
        spec = importlib.util.find_spec(name)
        place = None if spec is None else spec.origin
        source = getattr(spec.loader, "get_source", lambda _: "")(name) if spec is not None and place else ""
        if _MARK not in (source or ""):
            what = f"at {place} is not labpipe's" if place else "of labpipe is missing or has lost its files"
            why = "another distribution has installed or removed a package of the same name"
            return f"the module `{name}` {what}: {why}; use a separate environment for labpipe, and install it there"
    return None


def lazily(package: str, above: Sequence[str] = ()) -> Callable[[str], Any]:
    """Return a ``__getattr__`` for a package, which imports the module of a name on its first use (PEP 562).

    Public names of the package, its ``__all__``, are those that it imports under ``if TYPE_CHECKING:``, perhaps renamed
    by an assignment, and those that it imports at once as themselves or defines. ``above`` are packages of the same
    distribution: where another one has replaced them, InstallationError is raised before any of them is imported.
    """
    homes: dict[str, tuple[str, str]] = {}
    at_once, unchecked = set[str](), set(above)
    loader: Any = sys.modules[package].__loader__
    for statement in ast.parse(loader.get_source(package)).body:
        if isinstance(statement, ast.If) and ast.unparse(statement.test) == "TYPE_CHECKING":
            for part in statement.body:
                if isinstance(part, ast.ImportFrom) and part.module:
                    homes.update({name.asname or name.name: (part.module, name.name) for name in part.names})
                elif isinstance(part, ast.Assign):
                    homes[ast.unparse(part.targets[0])] = homes.pop(ast.unparse(part.value))
        elif isinstance(statement, ast.ImportFrom):
            at_once.update(name.name for name in statement.names if name.asname == name.name)
        elif isinstance(statement, ast.FunctionDef | ast.ClassDef):
            at_once.add(statement.name)
        elif isinstance(statement, ast.Assign):
            at_once.update(target.id for target in statement.targets if isinstance(target, ast.Name))

    def load(name: str) -> Any:
        if name == "__all__":
            return sorted({*homes, *(own for own in at_once if not own.startswith("_") and own != "BUILD")})
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
