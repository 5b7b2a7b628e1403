"""Small changes that spoil a program: what the tests of the numerical core must notice.

A mutant is one module with one change. Only what is computed is changed: no text, no annotation,
no decorator, nothing inside ``raise`` or a message.
"""

import ast
from collections.abc import Callable, Iterator
from typing import NamedTuple

ARITHMETIC: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.Pow: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.Mod: ast.Mult,
    ast.MatMult: ast.Add,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
    ast.LShift: ast.RShift,
    ast.RShift: ast.LShift,
    ast.BitXor: ast.BitAnd,
}
COMPARISONS: dict[type[ast.cmpop], tuple[type[ast.cmpop], ...]] = {
    ast.Lt: (ast.LtE, ast.GtE),
    ast.LtE: (ast.Lt, ast.Gt),
    ast.Gt: (ast.GtE, ast.LtE),
    ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
    ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,),
    ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,),
}
_SPEAKS = {"warn", "InputError", "SourceError", "join"}
"""Calls whose arguments become words."""
_HUGE = 1e15
"""Beyond it, one more is the same number."""


class Mutant(NamedTuple):
    """One change: its kind, where it stands in the text, and what stands there instead."""

    module: str
    line: int
    column: int
    end_line: int
    end_column: int
    kind: str
    replacement: str

    def applied(self, source: str) -> str:
        """Return the module's text with the change."""
        lines = source.encode().splitlines(keepends=True)
        head = b"".join([*lines[: self.line - 1], lines[self.line - 1][: self.column]])
        tail = lines[self.end_line - 1][self.end_column :]
        rest = b"".join(lines[self.end_line :])
        return (head + self.replacement.encode() + tail + rest).decode()

    def told(self, source: str) -> str:
        """Write the change in one line."""
        before = " ".join((ast.get_source_segment(source, _Span(self)) or "").split())
        return f"{self.module}:{self.line} {self.kind}: {before} -> {self.replacement}"


class _Span(ast.AST):
    def __init__(self, mutant: Mutant) -> None:
        self.lineno, self.col_offset = mutant.line, mutant.column
        self.end_lineno, self.end_col_offset = mutant.end_line, mutant.end_column


Change = tuple[ast.expr | ast.stmt, str, ast.AST]
"""What is replaced, the kind of the change, what comes instead."""


def mutants(module: str, source: str) -> list[Mutant]:
    """Find every mutant of a module, in the order of the text."""
    found = [
        Mutant(
            module,
            node.lineno,
            node.col_offset,
            int(node.end_lineno or 0),
            int(node.end_col_offset or 0),
            kind,
            _text(new, node),
        )
        for node, kind, new in _changes(ast.parse(source))
    ]
    return sorted(set(found))


def _text(new: ast.AST, old: ast.AST) -> str:
    text = ast.unparse(ast.fix_missing_locations(new))
    is_bare = isinstance(old, ast.stmt | ast.Constant | ast.Slice)
    return text if is_bare else f"({text})"


def _changes(node: ast.AST) -> Iterator[Change]:
    for kind, change in CHANGES.items():
        for old, new in change(node):
            yield old, kind, new
    for child in _computed(node):
        yield from _changes(child)


def _computed(node: ast.AST) -> Iterator[ast.AST]:
    """Parts of a node that compute something."""
    if isinstance(node, ast.Raise | ast.JoinedStr | ast.Import | ast.ImportFrom):
        return
    if isinstance(node, ast.Call):
        name = node.func.attr if isinstance(node.func, ast.Attribute) else ast.unparse(node.func)
        if name in _SPEAKS:
            return
    if isinstance(node, ast.AnnAssign):
        yield from [node.value] if node.value else []
        return
    if isinstance(node, ast.FunctionDef):
        yield from [d for d in [*node.args.defaults, *node.args.kw_defaults] if d]
        yield from node.body
        return
    if isinstance(node, ast.ClassDef):
        yield from node.body
        return
    yield from ast.iter_child_nodes(node)


def _arithmetic(node: ast.AST) -> Iterator[tuple[ast.expr | ast.stmt, ast.AST]]:
    if isinstance(node, ast.BinOp) and type(node.op) in ARITHMETIC and not _is_text(node):
        yield node, ast.BinOp(node.left, ARITHMETIC[type(node.op)](), node.right)
    if isinstance(node, ast.AugAssign) and type(node.op) in ARITHMETIC and not _is_text(node):
        yield node, ast.AugAssign(node.target, ARITHMETIC[type(node.op)](), node.value)


def _is_text(node: ast.AST) -> bool:
    """Whether words are put together; the union of two types looks like arithmetic too."""
    parts = list(ast.walk(node))
    return any(
        isinstance(part, ast.JoinedStr | ast.Dict | ast.List | ast.Tuple)
        or (isinstance(part, ast.Constant) and (part.value is None or isinstance(part.value, str)))
        for part in parts
        if not isinstance(node, ast.BinOp) or part in (node.left, node.right)
    )


def _comparison(node: ast.AST) -> Iterator[tuple[ast.expr, ast.AST]]:
    if isinstance(node, ast.Compare):
        for place, operator in enumerate(node.ops):
            for other in COMPARISONS[type(operator)]:
                operators = [*node.ops[:place], other(), *node.ops[place + 1 :]]
                yield node, ast.Compare(node.left, operators, node.comparators)


def _constant(node: ast.AST) -> Iterator[tuple[ast.expr, ast.AST]]:
    if not isinstance(node, ast.Constant):
        return
    if isinstance(node.value, bool):
        yield node, ast.Constant(not node.value)
    elif isinstance(node.value, int | float):
        more = node.value + 1 if abs(node.value) < _HUGE else node.value * 2
        yield node, ast.Constant(more)


def _boolean(node: ast.AST) -> Iterator[tuple[ast.expr, ast.AST]]:
    if isinstance(node, ast.BoolOp):
        other = ast.Or() if isinstance(node.op, ast.And) else ast.And()
        yield node, ast.BoolOp(other, node.values)


def _negation(node: ast.AST) -> Iterator[tuple[ast.expr, ast.AST]]:
    if isinstance(node, ast.UnaryOp) and not isinstance(node.op, ast.UAdd):
        yield node, node.operand


def _slice(node: ast.AST) -> Iterator[tuple[ast.expr, ast.AST]]:
    if not isinstance(node, ast.Slice):
        return
    one = ast.Constant(1)
    if node.lower is not None or node.upper is not None:
        lower = one if node.lower is None else ast.BinOp(node.lower, ast.Add(), one)
        yield node, ast.Slice(lower, node.upper, node.step)
    if node.upper is not None:
        yield node, ast.Slice(node.lower, ast.BinOp(node.upper, ast.Sub(), one), node.step)


def _returned(node: ast.AST) -> Iterator[tuple[ast.stmt, ast.AST]]:
    # A truth value is changed as a constant is: None for False would be the same answer.
    is_truth = isinstance(node, ast.Return) and isinstance(node.value, ast.Constant | ast.Compare)
    if isinstance(node, ast.Return) and node.value is not None and not is_truth:
        yield node, ast.Return(ast.Constant(None))


CHANGES: dict[str, Callable[[ast.AST], Iterator[tuple[ast.expr | ast.stmt, ast.AST]]]] = {
    "arithmetic": _arithmetic,
    "comparison": _comparison,
    "constant": _constant,
    "boolean": _boolean,
    "negation": _negation,
    "slice": _slice,
    "return": _returned,
}
