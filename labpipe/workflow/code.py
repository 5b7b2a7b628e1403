"""Which code a result can come from: the definitions that its function reaches, as digests.

From the text of a function (``"package.module:name"``) every definition is followed that it
mentions: through imports, also those inside functions, through faces that only pass names on, and
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

A path reads ``module:name.attribute``, ``data:package`` for the files of a package, and
``group:name`` for entry points; ``()`` behind it stands for the methods of a class.
"""

import ast
import contextlib
import hashlib
import importlib.machinery
import importlib.metadata
import importlib.util
import os
import re
import sys
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cache, cached_property
from pathlib import Path
from typing import Any, NamedTuple

from labpipe import files
from labpipe.errors import InputError, SourceError, StorageError

OURS = ("labpipe", "instruments", "calibration", "pipelines")
"""Packages that are followed; of a plug-in, also the package that holds the function."""

_TEXT = re.compile(r"[^\W\d]\w*(?:\.\w+)*:[^\W\d]\w*")
_GROUP = re.compile(r"labpipe\.\w+")  # of entry points; what is a module is none
_DOTTED = re.compile(r"[^\W\d]\w*(?:\.\w+)+")
_DATA = ("importlib:resources", "importlib.resources:", "pkgutil:", "jinja2:PackageLoader")
_ENDINGS = (*importlib.machinery.EXTENSION_SUFFIXES, ".py", ".pyc")
_DISTRIBUTIONS = {"cv2": ("opencv-python-headless", "opencv-python", "opencv-contrib-python")}
"""Distributions that are not called as what they install; others are looked up."""
_UNWRITTEN = {"ctx", "type_comment", "type_ignores", "kind"}
_RACE = 2_000_000_000
"""Nanoseconds in which a file may change without a new time."""
_DIGITS = 16
_BORN = time.time_ns()
_awaited: dict[str, "Stamp"] = {}
"""Files of modules that this process had not yet loaded when it was asked for their code."""

Scope = Mapping[str, str | None]
"""Path of every name that is visible; None for a local one."""
_Functions = ast.FunctionDef | ast.AsyncFunctionDef
_Comprehensions = ast.ListComp | ast.SetComp | ast.DictComp | ast.GeneratorExp


# --- one module --------------------------------------------------------------------------------


class Module:
    """A module taken apart.

    Parameters
    ----------
    source : bytes
        Its text.
    name : str
        Dotted.
    is_package : bool
        Whether it is the face of a package.

    Attributes
    ----------
    passed : dict
        Names that come from elsewhere, with their paths.
    defined : dict
        Statements that define a name; those that define none under the empty name.

    Raises
    ------
    SyntaxError, ValueError
        It is no Python.
    """

    def __init__(self, source: bytes, name: str, *, is_package: bool = False) -> None:
        self.name, self.is_package = name, is_package
        self.home = name if is_package else name.rpartition(".")[0]
        self.body = ast.parse(source).body
        self.passed = _imported(_run(self.body), self.home)
        self.defined: dict[str, list[ast.stmt]] = {"": []}
        for statement in _run(self.body, deep=False):
            if not isinstance(statement, ast.Import | ast.ImportFrom):
                for defined in _defines(statement) or [""]:
                    self.defined.setdefault(defined, []).append(statement)
        inside = _bound(self.defined[""]).keys() - self.passed.keys()
        self.scope = self.passed | {n: f"{name}:{n}" for n in (*self.defined, *inside) if n}
        self.defined |= {n: [] for n in inside if n not in self.defined}
        self._known: dict[str, tuple[str, list[str]]] = {}

    def definition(self, name: str) -> tuple[str, list[str]]:
        """Digest and references of a definition, a class's methods (``Name()``), or the rest."""
        if name not in self._known:
            bare = name.removesuffix("()")
            statements = self.defined[bare]
            digest, references = _walked(
                statements if bare == name else _methods(statements), self.scope, self.home
            )
            if name in self.passed:  # an import that is replaced
                references.append(self.passed[name])
            self._known[name] = digest, references + (self._effects() if not name else [])
        return self._known[name]

    def _effects(self) -> list[str]:
        """Return what is reached with the module: imports that nobody uses, and what registers."""
        used = _used(self.body) | _texts(self.defined.get("__all__", ()))
        unused = () if self.is_package else self.passed.keys() - used
        return [
            *(self.passed[name] for name in unused),
            *_stars(self.body, self.home),
            *(
                f"{self.name}:{n}"
                for n, given in self.defined.items()
                if self._is_registered(given)
            ),
        ]

    def _is_registered(self, statements: Iterable[ast.stmt]) -> bool:
        """Whether a decorator of ours may have kept it somewhere."""
        decorators = [d for s in statements for d in getattr(s, "decorator_list", ())]
        paths = _walked(decorators, self.scope, self.home)[1]
        return any(
            p.partition(":")[0].partition(".")[0] in {*OURS, *self.home.split(".")[:1]}
            for p in paths
        )

    @cached_property
    def lazy(self) -> dict[str, str]:
        """Tables of a face that imports its names when they are first used."""
        return _tables(self.body) if "__getattr__" in self.defined else {}


def _run(body: Iterable[ast.stmt], *, deep: bool = True) -> Iterator[ast.stmt]:
    """Go through the statements that run at the top, not those for the type checker alone."""
    for statement in body:
        if isinstance(statement, ast.If) and _is_for_checker(statement.test):
            yield from _run(statement.orelse, deep=deep)
        else:
            yield statement
            if deep and not isinstance(statement, _Functions | ast.ClassDef):
                parts = _children(statement)
                handlers = [p for p in parts if isinstance(p, ast.ExceptHandler | ast.match_case)]
                parts += [part for handler in handlers for part in handler.body]
                yield from _run(part for part in parts if isinstance(part, ast.stmt))


def _is_for_checker(test: ast.expr) -> bool:
    name = test.attr if isinstance(test, ast.Attribute) else getattr(test, "id", "")
    return name == "TYPE_CHECKING"


def _imported(statements: Iterable[ast.AST], home: str) -> dict[str, str]:
    """Names that imports bind, with the dotted path of each."""
    found = {}
    for statement in statements:
        if isinstance(statement, ast.Import):
            for name in statement.names:
                top = name.name.partition(".")[0]
                found[name.asname or top] = f"{name.name if name.asname else top}:"
        elif isinstance(statement, ast.ImportFrom):
            origin = _origin(statement, home)
            found |= {n.asname or n.name: f"{origin}:{n.name}" for n in statement.names}
    found.pop("*", None)
    return found


def _origin(statement: ast.ImportFrom, home: str) -> str:
    if not statement.level:
        return statement.module or ""
    parts = home.split(".")
    parts = parts[: len(parts) - statement.level + 1]
    return ".".join([*parts, *([statement.module] if statement.module else [])])


def _stars(body: Iterable[ast.stmt], home: str) -> list[str]:
    """Modules that are imported with a star."""
    return [
        f"{_origin(statement, home)}:"
        for statement in _run(body)
        if isinstance(statement, ast.ImportFrom) and statement.names[0].name == "*"
    ]


def _defines(statement: ast.stmt) -> list[str]:
    """Names of a definition; none where the statement does anything else."""
    if isinstance(statement, _Functions | ast.ClassDef):
        return [statement.name]
    targets: list[ast.expr] = []
    if isinstance(statement, ast.Assign):
        targets = statement.targets
    elif isinstance(statement, ast.AnnAssign):
        targets = [statement.target]
    flat = [p for t in targets for p in (t.elts if isinstance(t, ast.Tuple | ast.List) else [t])]
    names = [part.id for part in flat if isinstance(part, ast.Name)]
    return names if len(names) == len(flat) else []


def _methods(statements: Iterable[ast.stmt]) -> list[ast.stmt]:
    """Return the classes without their fields, whose types count by their methods in turn."""
    found: list[ast.stmt] = []
    for statement in statements:
        if isinstance(statement, ast.ClassDef):
            found += [part for part in statement.body if isinstance(part, _Functions)]
            fields = [part for part in statement.body if isinstance(part, ast.AnnAssign)]
            holders = [*statement.bases, *(part.annotation for part in fields)]
            found += [_annotated(holder) for holder in holders]
    return found


def _annotated(annotation: ast.expr) -> ast.stmt:
    """Return a function of that annotation alone."""
    empty = ast.arguments([], [ast.arg("_", annotation)], None, [], [], None, [])
    return ast.FunctionDef("_", empty, [], [], None, None)


def _texts(nodes: Iterable[ast.AST]) -> set[str]:
    return {text for node in nodes for part in ast.walk(node) if (text := _text(part)) is not None}


def _text(node: ast.AST | None) -> str | None:
    value = node.value if isinstance(node, ast.Constant) else None
    return value if isinstance(value, str) else None


def _tables(body: Iterable[ast.stmt]) -> dict[str, str]:
    """Homes by name, of tables that give a home to a name, or names to a home."""
    found: dict[str, str] = {}
    tables = [n for s in _run(body, deep=False) for n in ast.walk(s) if isinstance(n, ast.Dict)]
    for key, value in ((k, v) for t in tables for k, v in zip(t.keys, t.values, strict=True)):
        name, home = _text(key), _text(value)
        if name is not None and home is not None:
            found[name] = home
        elif name is not None and isinstance(value, ast.Tuple | ast.List):
            found |= dict.fromkeys(_texts(value.elts), name)
    return found


def _bound(body: Iterable[ast.AST]) -> dict[str, None]:
    """Names that statements bind in the scope in which they stand."""
    found: dict[str, None] = {}
    outer: set[str] = set()
    waiting = list(body)
    while waiting:
        node = waiting.pop()
        if isinstance(node, _Functions | ast.ClassDef):
            found[node.name] = None
            continue
        if isinstance(node, _Comprehensions | ast.Lambda):
            continue
        if isinstance(node, ast.Name) and not isinstance(node.ctx, ast.Load):
            found[node.id] = None
        elif isinstance(node, ast.Global | ast.Nonlocal):
            outer.update(node.names)
        elif isinstance(node, ast.ExceptHandler | ast.MatchAs | ast.MatchStar) and node.name:
            found[node.name] = None
        elif isinstance(node, ast.MatchMapping) and node.rest:
            found[node.rest] = None
        waiting += _children(node)
    return {name: None for name in found if name not in outer}


def _walked(statements: Iterable[ast.AST], scope: Scope, home: str) -> tuple[str, list[str]]:
    """Digest and references of some statements."""
    walk = _Walk(home)
    for statement in statements:
        walk.visit(statement, scope)
    if walk.looks_for_files:
        named = {f"data:{text}" for text in walk.texts if _DOTTED.fullmatch(text)}
        walk.references |= named or {f"data:{home}"}
    text = "".join(walk.written)
    return _hash(text) if text else "", sorted(walk.references)


def _hash(text: str) -> str:
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()[:_DIGITS]


class _Walk:
    """Writes syntax trees as text that is the same for all versions of Python, and refers.

    An empty or absent part of a node is not written, because versions differ in those.
    """

    def __init__(self, home: str) -> None:
        self.home = home
        self.written: list[str] = []
        self.references: set[str] = set()
        self.texts: set[str] = set()
        self.looks_for_files = False

    def refer(self, path: str) -> None:
        """Note a dotted path."""
        self.references.add(path)
        self.looks_for_files |= path.startswith(_DATA)

    def visit(self, node: Any, scope: Scope) -> None:
        """Write a node, a list of nodes, or a plain value."""
        if isinstance(node, list):
            for part in node:
                self.visit(part, scope)
        elif isinstance(node, ast.AST):
            getattr(self, f"on_{type(node).__name__}", self.parts)(node, scope)
        else:
            self.written.append(f"{node!r},")

    def parts(self, node: ast.AST, scope: Scope) -> None:
        """Write a node as its name and its parts."""
        self.written.append(f"{type(node).__name__}(")
        for name in node._fields:
            value = getattr(node, name, None)
            if value is not None and value != [] and name not in _UNWRITTEN:
                self.written.append(f"{name}=")
                self.visit(value, scope)
        self.written.append(")")

    def nothing(self, node: ast.AST, scope: Scope) -> None:
        """Leave out what does nothing, and imports: what they bind counts where it is used."""

    on_Pass = on_Import = on_ImportFrom = nothing

    def on_Expr(self, node: ast.Expr, scope: Scope) -> None:
        """Leave out docstrings, those of attributes too."""
        if not isinstance(node.value, ast.Constant):
            self.parts(node, scope)

    def on_If(self, node: ast.If, scope: Scope) -> None:
        """Leave out what is for the type checker alone."""
        if _is_for_checker(node.test):
            self.visit(node.orelse, scope)
        else:
            self.parts(node, scope)

    def on_Constant(self, node: ast.Constant, scope: Scope) -> None:
        """Write type and value; a text may name a function."""
        value = node.value
        self.written.append(f"{type(value).__name__} {value!r},")
        if isinstance(value, str):
            self.texts.add(value)
            if _TEXT.fullmatch(value):
                self.refer(value)
            elif _GROUP.fullmatch(value):
                self.references.add(f"group:{value}")

    def on_JoinedStr(self, node: ast.JoinedStr, scope: Scope) -> None:
        """Write a text with values; Python 3.12 puts empty texts between them."""
        self.written.append("JoinedStr(")
        for part in node.values:
            if not (isinstance(part, ast.Constant) and part.value == ""):
                self.visit(part, scope)
        self.written.append(")")

    def on_Name(self, node: ast.expr, scope: Scope) -> None:
        """Write ``alias.part.name`` by what it leads to, and refer to that."""
        attributes: list[str] = []
        base = node
        while isinstance(base, ast.Attribute):
            attributes.insert(0, base.attr)
            base = base.value
        if isinstance(base, ast.Name):
            path = scope.get(base.id)
            self.written.append(f"Name {path or base.id},")
            self.looks_for_files |= base.id == "__file__"
            if path is not None and (attributes or isinstance(base.ctx, ast.Load)):
                self.refer(_joined(path, attributes))
        else:
            self.visit(base, scope)
        self.written += [f"Attribute {name}," for name in attributes]

    on_Attribute = on_Name

    def on_Call(self, node: ast.Call, scope: Scope) -> None:
        """Refer to what is imported by its name."""
        name = getattr(node.func, "attr", getattr(node.func, "id", ""))
        if name in {"import_module", "__import__"}:
            self.references |= {f"{text}:" for text in _texts(node.args)}
        self.parts(node, scope)

    def generated(self, node: Any, scope: Scope) -> None:
        """Write a comprehension, whose names are its own."""
        self.visit(node.generators[0].iter, scope)  # the only part that runs outside
        self.parts(node, {**scope, **_bound(part.target for part in node.generators)})

    on_ListComp = on_SetComp = on_DictComp = on_GeneratorExp = generated

    def on_AnnAssign(self, node: ast.AnnAssign, scope: Scope) -> None:
        """Write an assignment; its annotation is for readers."""
        self.annotations([node.annotation], scope)
        if node.value is not None:
            self.written.append("AnnAssign(")
            self.visit([node.target, node.value], scope)
            self.written.append(")")

    def on_ClassDef(self, node: ast.ClassDef, scope: Scope) -> None:
        """Write a class, whose annotations make its fields."""
        inner = {**scope, **_imported(_run(node.body), self.home)}
        self.written.append(f"ClassDef {node.name}(")
        self.visit([*node.decorator_list, *node.bases, *node.keywords], scope)
        for part in node.body:
            (self.parts if isinstance(part, ast.AnnAssign) else self.visit)(part, inner)
        self.written.append(")")

    def on_FunctionDef(self, node: Any, scope: Scope) -> None:
        """Write a function; its annotations only where something decorates it."""
        decorators: list[ast.expr] = getattr(node, "decorator_list", [])
        body = node.body if isinstance(node.body, list) else [node.body]
        arguments = [a for a in ast.iter_child_nodes(node.args) if isinstance(a, ast.arg)]
        imported = _imported(_run(body), self.home)
        for name in imported.keys() - (_used(body) if imported else set()):
            self.refer(imported[name])
        annotations = [*(a.annotation for a in arguments), getattr(node, "returns", None)]
        self.annotations(annotations, scope, are_written=bool(decorators))
        self.written.append(f"{type(node).__name__} {getattr(node, 'name', '')}(")
        self.visit(decorators, scope)
        for title in node.args._fields:
            part = getattr(node.args, title)
            named = [a.arg if isinstance(a, ast.arg) else a for a in _listed(part)]
            self.written.append(f"{title}=")
            self.visit(["none" if each is None else each for each in named], scope)
        self.visit(
            body, {**scope, **dict.fromkeys(a.arg for a in arguments), **_bound(body), **imported}
        )
        self.written.append(")")

    on_AsyncFunctionDef = on_Lambda = on_FunctionDef

    def annotations(
        self, given: Iterable[ast.expr | None], scope: Scope, *, are_written: bool = False
    ) -> None:
        """Refer to the methods of the classes that annotations name."""
        walk = _Walk(self.home)
        walk.visit([annotation for annotation in given if annotation is not None], scope)
        self.references |= {f"{path}()" for path in walk.references}
        if are_written:
            self.written += walk.written


def _joined(path: str, attributes: Iterable[str]) -> str:
    """Path of an attribute of what a path leads to."""
    added = ".".join(attributes)
    return path + added if path.endswith(":") or not added else f"{path}.{added}"


def _listed(part: Any) -> list[Any]:
    return part if isinstance(part, list) else [] if part is None else [part]


def _used(body: Iterable[ast.AST]) -> set[str]:
    """Every name that is mentioned."""
    found, waiting = set(), list(body)
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.Name):
            found.add(node.id)
        else:
            waiting += _children(node)
    return found


def _children(node: ast.AST) -> list[Any]:
    """Nodes right below one; quicker than the library's, which asks for every field by name."""
    found: list[Any] = []
    for value in vars(node).values():
        if isinstance(value, list):
            found += [part for part in value if isinstance(part, ast.AST)]
        elif isinstance(value, ast.AST) and not isinstance(value, ast.expr_context):
            found.append(value)
    return found


# --- all modules -------------------------------------------------------------------------------


class Stamp(NamedTuple):
    """What says that a file is still the same."""

    size: int
    modified: int
    changed: int
    inode: int


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
        spec = (
            find(top) if search is None else importlib.machinery.PathFinder.find_spec(top, search)
        )
    except (ImportError, ValueError):  # as of the script that runs
        spec = None
    if spec is None:
        return {}
    found: Tree = {}
    if spec.submodule_search_locations is None:
        if spec.origin is not None and Path(spec.origin).is_file():
            found[top] = {spec.origin: _stamp(Path(spec.origin).stat())}
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
                stem = next(
                    (entry.name.removesuffix(e) for e in _ENDINGS if entry.name.endswith(e)), ""
                )
                module = name if stem == "__init__" else f"{name}.{stem}" if stem else ""
                found.setdefault(module, {})[entry.path] = _stamp(entry.stat())
    return found


def _stamp(status: os.stat_result) -> Stamp:
    return Stamp(status.st_size, status.st_mtime_ns, status.st_ctime_ns, status.st_ino)


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
            data = f"__getattr__ = {hashlib.sha256(data).hexdigest()!r}".encode()
        return Module(data, name, is_package=is_package)
    except OSError as error:
        raise SourceError(path, f"cannot be read: {error.strerror}") from error
    except SyntaxError as error:
        hint = "Correct the module, or remove what it belongs to."
        raise SourceError(
            path, f"is no Python: {error.msg}", line=error.lineno, hint=hint
        ) from error
    except (ValueError, RecursionError, MemoryError) as error:
        raise SourceError(path, f"is no Python: {error}") from error


class Identity(NamedTuple):
    """Digest of what is reached of every module and data file, and versions of libraries."""

    modules: dict[str, str]
    libraries: dict[str, str | None]

    @property
    def digest(self) -> str:
        """All of it in one."""
        return _hash(files.canonical(self))


class Code:
    """The code behind functions.

    Parameters
    ----------
    memory : Path, optional
        File that keeps what was found for as long as no file of the packages changes; a missing
        or damaged one is an empty one.
    search : sequence of str, optional
        Folders with the packages; by default those that Python searches.

    Attributes
    ----------
    is_asked : bool
        Without it, the code behind everything is called unknown, at once: nothing is stored yet.
    n_read : int
        Modules that were asked for, as a count of work.
    """

    def __init__(self, memory: Path | None = None, search: Sequence[str] | None = None) -> None:
        self._memory, self._search = memory, search
        self._trees: dict[str, Tree] = {}
        self._groups: dict[str, list[str]] = {}
        self._modules: dict[str, Module] = {}
        self._identities: dict[str, Identity] = {}
        self._versions: dict[str, str | None] = {}
        self._known: dict[str, Any] | None = None
        self._is_new = False
        self.is_asked = True
        self.n_read = 0

    def behind(self, *functions: str) -> Identity:
        """Return the identity of all code that some functions can reach.

        Parameters
        ----------
        *functions : str
            ``"package.module:name"``.

        Raises
        ------
        SourceError
            A module that is reached is no Python.
        """
        if not self.is_asked:
            return Identity({}, {})
        if self._known is None:
            self._known = self._remembered()
        label = " ".join(functions)
        if label not in self._known:
            tops = {name.partition(":")[0].partition(".")[0] for name in functions}
            reached = Reached(self, {*OURS, *tops})
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
        newest = max((max(s.modified, s.changed) for s in stamps), default=0)
        if self._memory is None or not self._is_new or time.time_ns() - newest < _RACE:
            return
        # It only saves time: where it cannot be kept, the next call finds it again.
        with contextlib.suppress(StorageError):
            kept = {"state": self._state(self._trees, self._groups), "known": self._known,
                    "trees": [*self._trees], "groups": [*self._groups]}  # fmt: skip
            files.write_bytes(self._memory, files.seal(kept))
            self._is_new = False

    def _remembered(self) -> dict[str, Any]:
        try:
            kept = files.unseal(self._memory.read_bytes()) if self._memory is not None else {}
            trees, groups = kept["trees"], kept["groups"]
            is_same = kept["state"] == self._state(
                {top: self.tree(top) for top in trees}, {name: self.group(name) for name in groups}
            )
            return dict(kept["known"]) if is_same else {}
        except (OSError, TypeError, KeyError, ValueError):  # absent, damaged, or another record
            return {}

    def _state(self, trees: Mapping[str, Tree], groups: Mapping[str, list[str]]) -> str:
        return _hash(files.canonical([trees, groups]))

    def refuse_changed(self, modules: Iterable[str]) -> None:
        """Refuse modules that are no more what this process has loaded, or will load.

        Raises
        ------
        InputError
            The file of one was changed while the program ran.
        """
        for path, stamp in self._files(modules).items():
            is_known = max(stamp.modified, stamp.changed) < _BORN or _awaited.get(path) == stamp
            if not is_known or _stamp(Path(path).stat()) != stamp:
                message = f"{path} was changed while this program ran; start it again"
                raise InputError(message)

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
            self._groups[name] = sorted(
                p.value for p in importlib.metadata.entry_points(group=name)
            )
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
        is_old = time.time_ns() - max(stamp.modified, stamp.changed) > _RACE
        take = _module if is_old else _module.__wrapped__
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
                    yield name, files.digest(path)[:_DIGITS]


@cache
def _version(top: str) -> str | None:
    for name in _DISTRIBUTIONS.get(top, (top,)):
        with contextlib.suppress(importlib.metadata.PackageNotFoundError):
            return importlib.metadata.version(name)
    for name in importlib.metadata.packages_distributions().get(top, ()):
        return importlib.metadata.version(name)
    return None


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
            name: _hash(files.canonical(sorted(parts.items())))
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
            return [_joined(found.passed[first], rest.split(".") if rest else []) + suffix]
        if f"{module}.{first}" in self.code.tree(module.partition(".")[0]):
            return [f"{module}.{first}:{rest}{suffix}"]
        if first in found.lazy:
            return self.lazily(found, first) + self.take(found, "")
        return self.take(found, "") if first.startswith("__") else self.all(found)

    def lazily(self, found: Module, name: str) -> list[str]:
        """Follow the table of a face that imports its names when they are first used."""
        home, _, inner = found.lazy[name].partition(":")
        places = [home, f"{found.name}.{home}"]
        named = [f"{place}:{inner or name}" for place in places if self.code.module(place)]
        return named or self.all(found)

    def all(self, found: Module) -> list[str]:
        """Reach a whole module, and what a face passes on."""
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
