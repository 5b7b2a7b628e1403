"""Which code a result can come from: the definitions that its function reaches, as digests.

From the text of a function (``"package.module:name"``) every definition is followed that it
mentions: through imports, also those inside functions, through packages that only pass names on, and
through tables that name functions as text. What is reached counts by its syntax tree, without
comments, docstrings and positions; of other distributions the version counts. So a changed line
changes the identity of exactly those results that can depend on it.

- A definition is a function, a class (whole) or an assignment at the top of a module; all other
  statements there (loops, calls) count as soon as anything of the module is reached.
- A module that is used other than by its attributes counts whole, as does one that is imported
  for nothing but its effects.
- The class of an annotation counts by its methods: the values of an object come from elsewhere.
  Imports for the type checker alone count for nothing.
- A definition that looks for files of a package (:mod:`importlib.resources`, ``PackageLoader``,
  ``__file__``) reaches all files there that are no modules.
"""

import ast
import contextlib
import importlib.machinery
import importlib.metadata
import importlib.util
import os
import sys
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextvars import ContextVar
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from labpipe import files
from labpipe.errors import InstallationError, SourceError, StorageError
from labpipe.garbage import uncollected
from labpipe.stamps import Stamp
from labpipe.workflow._definitions import OURS, Module, joined, short

_ENDINGS = (*importlib.machinery.EXTENSION_SUFFIXES, ".py", ".pyc")
_DISTRIBUTIONS = {"cv2": ("opencv-python-headless", "opencv-python", "opencv-contrib-python")}
"""Distributions that are not called as what they install; others are looked up."""
_COMPILED = Path(__file__).parent / "__pycache__"
"""Beside this module compiled, what all sessions that use this installation can share."""
_BORN = time.time_ns()
_awaited: dict[str, Stamp] = {}
"""Files of modules that this process had not yet loaded when it was asked for their code."""


Tree = dict[str, dict[str, Stamp]]
"""Every file of a package by its path: those of a module under its name, others under ``""``."""


def tree(top: str, search: Sequence[str] | None = None) -> Tree:
    """List the files of a package, which is not imported; none where it is not found.

    Examples
    --------
    >>> list(tree("no_such_package"))
    []
    """
    try:
        find = importlib.util.find_spec
        spec = find(top) if search is None else importlib.machinery.PathFinder.find_spec(top, search)
    except (ImportError, ValueError):  # as of the script that runs
        spec = None
    if spec is None:
        return {}
    found: Tree = {}
    if spec.submodule_search_locations is None:
        if spec.origin is not None and Path(spec.origin).is_file():
            found[top] = {spec.origin: Stamp.of(Path(spec.origin).stat())}
        return found
    waiting = [(top, folder) for folder in spec.submodule_search_locations]
    while waiting:
        name, folder = waiting.pop()
        with contextlib.suppress(OSError), os.scandir(folder) as entries:
            for entry in entries:
                if entry.name.startswith((".", "__pycache__")):
                    continue
                if entry.is_dir():
                    waiting.append((f"{name}.{entry.name}", entry.path))
                    continue
                stem = next((entry.name.removesuffix(e) for e in _ENDINGS if entry.name.endswith(e)), "")
                module = name if stem == "__init__" else f"{name}.{stem}" if stem else ""
                with contextlib.suppress(FileNotFoundError):  # a link to nothing
                    found.setdefault(module, {})[entry.path] = Stamp.of(entry.stat())
    return found


@cache
def _module(path: str, name: str, stamp: Stamp) -> Module:
    """Take a file apart; a compiled module counts by all its bytes.

    Raises
    ------
    SourceError
        It cannot be read or is no Python.
    """
    del stamp  # part of what is remembered
    is_package = Path(path).stem == "__init__"
    try:
        data = Path(path).read_bytes()
        if not path.endswith(".py"):
            data = f"__getattr__ = {short(data)!r}".encode()
        return Module(data, name, is_package=is_package)
    except OSError as error:
        raise SourceError(path, f"cannot be read: {error.strerror}") from error
    except SyntaxError as error:
        hint = "Correct the module, or remove what it belongs to."
        raise SourceError(path, f"is no Python: {error.msg}", line=error.lineno, hint=hint) from error
    except (ValueError, RecursionError, MemoryError) as error:
        raise SourceError(path, f"is no Python: {error}") from error


_look: ContextVar["dict[Path, Code] | None"] = ContextVar("look", default=None)


@contextlib.contextmanager
def one_look() -> Iterator[None]:
    """List the packages once for all that is done here, as one verb plans, computes and judges."""
    token = _look.set({} if _look.get() is None else _look.get())
    try:
        yield
    finally:
        _look.reset(token)


class Identity(NamedTuple):
    """Digest of what is reached of every module and data file, and versions of libraries."""

    modules: dict[str, str]
    libraries: dict[str, str | None]

    @property
    def digest(self) -> str:
        """All of it in one."""
        return short(files.canonical(self))


class Code:
    """The code behind functions.

    Parameters
    ----------
    memory : Path, optional
        File that keeps what was found for as long as no file of the packages changes; a missing
        or damaged one is an empty one.
    search : sequence of str, optional
        Folders with the packages; by default those that Python searches. What was found there is
        also kept with the installation, where Python keeps compiled modules: a new session begins
        without following all imports again.

    Attributes
    ----------
    is_asked : bool
        Without it, the code behind everything is called unknown, at once: nothing is stored yet.
    n_read : int
        Modules that were asked for, as a count of work.
    """

    def __init__(self, memory: Path | None = None, search: Sequence[str] | None = None) -> None:
        self._memory, self._search = memory, search
        self._is_shared = memory is not None and search is None and not sys.dont_write_bytecode
        shared = sorted(_COMPILED.glob("reached-*.json")) if self._is_shared else []
        self._unread = [] if memory is None else [memory, *shared]
        self._trees: dict[str, Tree] = {}
        self._groups: dict[str, list[str]] = {}
        self._modules: dict[str, Module] = {}
        self._identities: dict[str, Identity] = {}
        self._versions: dict[str, str | None] = {}
        self._known: dict[str, Any] = {}
        self._is_new = False
        self.is_asked = True
        self.n_read = 0

    @classmethod
    def kept_in(cls, memory: Path) -> "Code":
        """Return the code that a session remembers, the same within :func:`one_look`."""
        look = _look.get()
        if look is None:
            return cls(memory)
        if memory not in look:
            look[memory] = cls(memory)
        look[memory].is_asked = True
        return look[memory]

    def behind(self, *functions: str) -> Identity:
        """Return the identity of all code that some functions can reach.

        ``*functions``: ``"package.module:name"``. Raises SourceError: a module that is reached is no Python.
        """
        if not self.is_asked:
            return Identity({}, {})
        label = " ".join(functions)
        while label not in self._known and self._unread:
            self._known |= self._kept(self._unread.pop(0))
        if label not in self._known:
            tops = {name.partition(":")[0].partition(".")[0] for name in functions}
            reached = Reached(self, {*OURS, *tops})
            with uncollected():
                reached.follow(functions)
            self._known[label] = [reached.digests(), sorted(reached.libraries)]
            self._is_new = True
        if label not in self._identities:
            modules, libraries = self._known[label]
            versions = {name: self.version(name) for name in libraries}
            self._identities[label] = Identity(modules, versions)
            _awaited.update(self._files(name for name in modules if name not in sys.modules))
        return self._identities[label]

    def save(self) -> None:
        """Keep what was found; files that were just written may change again unnoticed."""
        stamps = [s for t in self._trees.values() for part in t.values() for s in part.values()]
        if self._memory is None or not self._is_new or any(stamp.is_recent() for stamp in stamps):
            return
        kept = {"state": self._state(self._trees, self._groups), "trees": [*self._trees], "groups": [*self._groups]}
        # One file for each set of packages: a plug-in makes nobody else follow all imports again.
        shared = _COMPILED / f"reached-{short(files.canonical(sorted(self._trees)))}.json"
        for memory in [self._memory, shared] if self._is_shared else [self._memory]:
            # What other runs found meanwhile is kept beside it. It only saves time: where it cannot
            # be kept, the next call finds it again.
            with contextlib.suppress(StorageError):
                files.write_bytes(memory, files.seal(kept | {"known": self._kept(memory) | self._known}))
                self._is_new = False

    def _kept(self, memory: Path) -> dict[str, Any]:
        try:
            kept = files.unseal(memory.read_bytes())
            trees, groups = kept["trees"], kept["groups"]
            is_same = kept["state"] == self._state(
                {top: self.tree(top) for top in trees}, {name: self.group(name) for name in groups}
            )
            return dict(kept["known"]) if is_same else {}
        except (OSError, TypeError, KeyError, ValueError):  # absent, damaged, or another record
            return {}

    def _state(self, trees: Mapping[str, Tree], groups: Mapping[str, list[str]]) -> str:
        return short(files.canonical([trees, groups]))

    def refuse_changed(self, modules: Iterable[str]) -> None:
        """Refuse modules that are no more what this process has loaded, or will load.

        Raises
        ------
        InstallationError
            The file of one was changed while the program ran.
        """
        for path, stamp in self._files(modules).items():
            is_known = max(stamp.modified, stamp.changed) < _BORN or _awaited.get(path) == stamp
            if not is_known or Stamp.of(Path(path).stat()) != stamp:
                raise InstallationError(f"{path} was changed while this program ran; start it again")

    def _files(self, modules: Iterable[str]) -> dict[str, Stamp]:
        """Files of modules."""
        found: dict[str, Stamp] = {}
        for name in modules:
            found |= self.tree(name.partition(".")[0]).get(name, {})
        return found

    # --- what is there ---

    def tree(self, top: str) -> Tree:
        """Files of a package, as they were when they were first asked for."""
        if top not in self._trees:
            self._trees[top] = tree(top, self._search)
        return self._trees[top]

    def group(self, name: str) -> list[str]:
        """Return what the entry points of a group name."""
        if name not in self._groups:
            self._groups[name] = _group(name, tuple(sys.path))
        return self._groups[name]

    def version(self, top: str) -> str | None:
        """Version of the distribution that installs a package; None where there is none."""
        if top not in self._versions:
            self._versions[top] = _version(top)
        return self._versions[top]

    def module(self, name: str) -> Module | None:
        """Return a module taken apart; None where there is none."""
        if name in self._modules:
            return self._modules[name]
        found = self.tree(name.partition(".")[0]).get(name)
        if not found:
            return None
        path = min(found, key=lambda p: next(i for i, e in enumerate(_ENDINGS) if p.endswith(e)))
        stamp = found[path]
        take = _module.__wrapped__ if stamp.is_recent() else _module
        self._modules[name] = take(path, name, stamp)
        self.n_read += 1
        return self._modules[name]

    def data(self, package: str) -> Iterator[tuple[str, str]]:
        """Name and digest of every file of a package that is no module."""
        everything = self.tree(package.partition(".")[0])
        for face in everything.get(package, ()):
            folder = Path(face).parent
            for path in sorted(Path(p) for p in everything.get("", ())):
                if path.is_relative_to(folder) and Path(face).stem == "__init__":
                    name = f"{package}/{path.relative_to(folder).as_posix()}"
                    yield name, files.digest(path)[:16]


@cache
def _group(name: str, search: tuple[str, ...]) -> list[str]:
    """Look once, as for the plug-ins themselves; `search` is where."""
    del search
    return sorted(p.value for p in importlib.metadata.entry_points(group=name))


@cache
def _version(top: str) -> str | None:
    for name in _DISTRIBUTIONS.get(top, (top,)):
        with contextlib.suppress(importlib.metadata.PackageNotFoundError):
            return importlib.metadata.version(name)
    if importlib.machinery.PathFinder.find_spec(top) is None:  # a word of some text, no library
        return None
    for name in _installed().get(top, ()):
        return importlib.metadata.version(name)
    return None


@cache
def _installed() -> Mapping[str, Sequence[str]]:
    """Distributions by what they install: it reads the records of all of them."""
    return importlib.metadata.packages_distributions()


class Reached:
    """What has been reached so far."""

    def __init__(self, code: Code, ours: set[str]) -> None:
        self.code, self.ours = code, ours
        self.found: dict[str, dict[str, str]] = {}
        self.files: dict[str, str] = {}
        self.libraries: set[str] = set()

    def digests(self) -> dict[str, str]:
        """One digest for every module, and for every file."""
        made = {
            name: short(files.canonical(sorted(parts.items())))
            for name, parts in self.found.items()
            if any(parts.values())
        }
        return dict(sorted((made | self.files).items()))

    def follow(self, paths: Iterable[str]) -> None:
        """Reach what paths lead to and all that is mentioned there."""
        waiting, seen = list(paths), set(paths)
        while waiting:
            new = [path for path in self.step(waiting.pop()) if path not in seen]
            seen.update(new)
            waiting += new

    def step(self, path: str) -> Iterable[str]:
        """Reach what one path leads to, and return the paths that are mentioned there."""
        module, _, attributes = path.partition(":")
        if module == "data":
            self.files |= dict(self.code.data(attributes)) if self.is_ours(attributes) else {}
            return []
        if module == "group":
            if attributes in self.code.tree(OURS[0]):
                return []
            values = self.code.group(attributes)
            self.ours |= {value.partition(":")[0].partition(".")[0] for value in values}
            return [value if ":" in value else f"{value}:" for value in values]
        if not module.strip("."):
            return []  # what stands between two names that are put together at run time
        return self.name(module, attributes) if self.is_ours(module) else []

    def is_ours(self, module: str) -> bool:
        """Whether the code of a module is followed; of a library, its version counts."""
        top = module.partition(".")[0]
        if top in self.ours:
            return True
        if top not in sys.stdlib_module_names and top not in self.libraries:
            if self.code.version(top) is None and self.code.tree(top):
                self.ours.add(top)  # of no distribution, so it has no version
                return True
            self.libraries.add(top)
        return False

    def name(self, module: str, attributes: str) -> list[str]:
        """Reach a name of a module, or the whole module."""
        found = self.code.module(module)
        if found is None:
            self.found.setdefault(module, {})["absent"] = "absent"
            return []
        bare = attributes.removesuffix("()")
        suffix = attributes[len(bare) :]
        first, _, rest = bare.partition(".")
        if not first:
            return [] if suffix else self.all(found)
        if first in found.defined:
            kind = suffix if not rest else ""
            if kind and not any(isinstance(s, ast.ClassDef) for s in found.defined[first]):
                return [p if p.endswith("()") else f"{p}()" for p in found.definition(first)[1]]
            return self.take(found, first + kind)
        if found.passed.get(first, path := f"{module}:{first}") != path:  # not its own module
            return [joined(found.passed[first], rest.split(".") if rest else []) + suffix]
        if f"{module}.{first}" in self.code.tree(module.partition(".")[0]):
            return [f"{module}.{first}:{rest}{suffix}"]
        if first in found.lazy:
            return self.lazily(found, first) + self.take(found, "")
        return self.take(found, "") if first.startswith("__") else self.all(found)

    def lazily(self, found: Module, name: str) -> list[str]:
        """Follow a package that imports its names when they are first used."""
        home, _, inner = found.lazy[name].partition(":")
        places = [home, f"{found.name}.{home}"]
        named = [f"{place}:{inner or name}" for place in places if self.code.module(place)]
        return named or self.all(found)

    def all(self, found: Module) -> list[str]:
        """Reach a whole module, and the names that a package passes on."""
        paths = [path for name in found.defined for path in self.take(found, name)]
        return paths + (list(found.passed.values()) if found.is_package else [])

    def take(self, found: Module, name: str) -> list[str]:
        """Reach one definition, and what its module and the packages around it do at the top."""
        mine = self.found.setdefault(found.name, {})
        around: list[str] = []
        if "" not in mine:
            mine[""], around = found.definition("")
            package = found.name.rpartition(".")[0]
            outer = self.code.module(package) if package else None
            around = around + (self.take(outer, "") if outer is not None else [])
        mine[name], paths = found.definition(name)
        return [*around, *paths]
