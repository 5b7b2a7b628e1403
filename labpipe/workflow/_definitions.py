"""What a module defines, each definition with a digest and the paths of what it mentions.

The digest is that of the syntax tree, without comments, docstrings, positions and annotations that
nobody reads, and the same for all versions of Python. A path reads ``module:name.attribute``,
``data:package`` for the files of a package that are no modules, and ``group:name`` for entry
points; ``()`` behind a path stands for the methods of a class.
"""

import ast
import hashlib
import re
from collections.abc import Iterable, Iterator, Mapping
from functools import cached_property
from typing import Any

OURS = ("labpipe", "instruments", "calibration", "pipelines")
"""Packages that are followed; of a plug-in, also the package that holds the function."""

_TEXT = re.compile(r"[^\W\d]\w*(?:\.\w+)*:[^\W\d]\w*")
_GROUP = re.compile(r"labpipe\.\w+")  # of entry points; what is a module is none
_DOTTED = re.compile(r"[^\W\d]\w*(?:\.\w+)+")
_DATA = ("importlib:resources", "importlib.resources:", "pkgutil:", "jinja2:PackageLoader")
_UNWRITTEN = {"ctx", "type_comment", "type_ignores", "kind"}
_DIGITS = 16

Scope = Mapping[str, str | None]
"""Path of every name that is visible; None for a local one."""
_Functions = ast.FunctionDef | ast.AsyncFunctionDef
_Comprehensions = ast.ListComp | ast.SetComp | ast.DictComp | ast.GeneratorExp


def short(data: bytes | str) -> str:
    """Return the beginning of the SHA-256 of a text or of bytes."""
    raw = data.encode("utf-8", "surrogatepass") if isinstance(data, str) else data
    return hashlib.sha256(raw).hexdigest()[:_DIGITS]


class Module:
    """A module taken apart.

    ``source`` is its text, ``name`` dotted; ``passed`` are names that come from elsewhere, with their paths, and
    ``defined`` the statements that define a name, those that define none under the empty name. What is no Python raises
    SyntaxError or ValueError.
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
            digest, references = _walked(statements if bare == name else _methods(statements), self.scope, self.home)
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
            *(f"{self.name}:{n}" for n, given in self.defined.items() if self._is_registered(given)),
        ]

    def _is_registered(self, statements: Iterable[ast.stmt]) -> bool:
        """Whether a decorator of ours may have kept it somewhere."""
        decorators = [d for s in statements for d in getattr(s, "decorator_list", ())]
        paths = _walked(decorators, self.scope, self.home)[1]
        return any(p.partition(":")[0].partition(".")[0] in {*OURS, *self.home.split(".")[:1]} for p in paths)

    @cached_property
    def lazy(self) -> dict[str, str]:
        """Homes of the names that a package imports when they are first used: for the checker alone, or in tables."""
        if "__getattr__" not in self.defined:
            return {}
        for_checker = [part for s in self.body if isinstance(s, ast.If) and _is_for_checker(s.test) for part in s.body]
        return _tables(self.body) | _imported(for_checker, self.home)


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
    return short(text) if text else "", sorted(walk.references)


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
                self.refer(joined(path, attributes))
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
        self.visit(body, {**scope, **dict.fromkeys(a.arg for a in arguments), **_bound(body), **imported})
        self.written.append(")")

    on_AsyncFunctionDef = on_Lambda = on_FunctionDef

    def annotations(self, given: Iterable[ast.expr | None], scope: Scope, *, are_written: bool = False) -> None:
        """Refer to the methods of the classes that annotations name."""
        walk = _Walk(self.home)
        walk.visit([annotation for annotation in given if annotation is not None], scope)
        self.references |= {f"{path}()" for path in walk.references}
        if are_written:
            self.written += walk.written


def joined(path: str, attributes: Iterable[str]) -> str:
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
