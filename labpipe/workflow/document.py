"""A TOML file as a tree with lines: size, depth, syntax and numbers checked, keys not yet."""

import math
import re
import tomllib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from labpipe.errors import ConfigError, SourceError
from labpipe.workflow import _toml_lines

LARGEST_FILE = 1_000_000
"""Bytes; no configuration written by a person is longer."""
_BARE = re.compile(r"[\w-]+")
"""A key that TOML takes without quotation marks (and letters of any language, for reading)."""

DEEPEST = 32
"""Levels of nesting; settings have about five."""
_PART = r"(?:[A-Za-z0-9_-]++|\"[^\"\n]*+\"|'[^'\n]*+')"
_TOO_DEEP = re.compile(rf"(?<![\w-])(?:{_PART}[ \t]*+\.[ \t]*+){{{DEEPEST}}}{_PART}[ \t]*+[=\]]")
"""A dotted key deeper than that: the time that the parser takes grows with the square of it."""


@dataclass(slots=True)
class Document:
    """A TOML file as a tree, with the line of every value, and of the mistakes found so far."""

    path: Path
    tree: dict[str, Any]
    lines: dict[_toml_lines.Path, int]
    problems: dict[str, int] = field(default_factory=dict)

    def line(self, place: _toml_lines.Path) -> int:
        """Line of a value, or of the nearest table around it."""
        while place not in self.lines:
            place = place[:-1]
        return self.lines[place]

    def report(self, place: _toml_lines.Path, message: str) -> None:
        """Note a mistake once."""
        self.problems[self.at(place, message)] = self.line(place)

    def at(self, place: _toml_lines.Path, message: str) -> str:
        """Put before a message where it belongs: ``session.toml:14: experiments.a.height: …``."""
        shown = f"{dotted(place)}: " if place else ""
        return f"{self.path.name}:{self.line(place)}: {shown}{message}"

    def finish(self) -> None:
        """Raise ConfigError with every mistake in the order of its line, if there is any."""
        if self.problems:
            raise ConfigError(sorted(self.problems, key=self.problems.__getitem__))


def dotted(place: _toml_lines.Path) -> str:
    """Write a place as ``experiments.acrylic.laser[2]``."""
    text = ""
    for key in place:
        name = key if isinstance(key, int) or _BARE.fullmatch(key) else f'"{key}"'
        text += f"[{key}]" if isinstance(key, int) else f".{name}" if text else f"{name}"
    return text


def parse(path: Path, text: str | None = None) -> Document:
    """Read a TOML file without judging its keys.

    Parameters
    ----------
    path : Path
        The file.
    text : str, optional
        What it would hold; by default it is read.

    Raises
    ------
    SourceError
        There is no such file, or it cannot be read.
    ConfigError
        It is not TOML, too large, too deep, or holds a number that is not finite.
    """
    text = _text(path) if text is None else text.replace("\r\n", "\n")
    deep = _TOO_DEEP.search(text)
    if deep is not None:
        line = text.count("\n", 0, deep.start()) + 1
        raise ConfigError([f"{path.name}:{line}: nested deeper than {DEEPEST} levels; flatten it"])
    try:
        tree = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ConfigError([_syntax_problem(path, text, str(error))]) from None
    except (RecursionError, ValueError) as error:
        # Arrays thousands deep exhaust the stack; integers of thousands of digits are refused.
        raise ConfigError([f"{path.name}:1: cannot be read as TOML: {error}"]) from None
    if _depth(tree) > DEEPEST:
        raise ConfigError([f"{path.name}:1: nested deeper than {DEEPEST} levels; flatten it"])
    document = Document(path, tree, _toml_lines.index(text))
    _refuse_not_finite(document, (), tree)
    return document


def _text(path: Path) -> str:
    try:
        size = path.stat().st_size
        if size > LARGEST_FILE:
            found = f"{size} bytes long, more than the {LARGEST_FILE} that a configuration may have"
            raise ConfigError([f"{path.name}:1: {found}; is it the right file?"])
        data = path.read_bytes()
    except OSError as error:
        raise SourceError(path, f"cannot be read: {error.strerror}") from error
    try:
        return data.decode("utf-8-sig").replace("\r\n", "\n")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        found = f"byte {data[error.start]:#04x} is not UTF-8"
        raise ConfigError([f"{path.name}:{line}: {found}; save the file as UTF-8"]) from None


def _syntax_problem(path: Path, text: str, message: str) -> str:
    """Turn ``Cannot overwrite a value (at line 5, column 3)`` into ``file:5:3: …``."""
    what, _, place = message.rpartition(" (at ")
    words = place.rstrip(")").replace(",", "").split()
    if what.startswith(("Cannot overwrite a value", "Cannot declare")):
        what = f"a key or table is given twice ({what}); remove one"
    if len(words) == 4 and words[0] == "line":
        lines = text.splitlines()
        line = lines[int(words[1]) - 1].strip() if int(words[1]) <= len(lines) else ""
        what = next((said for begin, said in _SYNTAX if what.startswith(begin)), what)
        return f"{path.name}:{words[1]}:{words[3]}: {what}; found: {line[:60]}"
    last = text.rstrip("\n").count("\n") + 1  # the only other place is "at end of document"
    return f"{path.name}:{last}: {what or message}"


_SYNTAX = (
    ("Illegal character '\\n'", "a text is not closed; expected a quotation mark before the line ends"),
    (
        "Expected newline or end of document",
        "expected the end of the line after a value; a text "
        "stands in quotation marks, a date reads 2026-01-31, a list stands in brackets",
    ),
    (
        "Invalid value",
        "expected a value: a text in quotation marks, a number, true, false, a date "
        "such as 2026-01-31, or a list in brackets",
    ),
    ("Expected '=' after a key", "expected = after the name of a key"),
    ("Invalid statement", "expected a key, a table in brackets, or a remark after #"),
)
"""What tomllib says, and what a person can make of it."""


def _depth(tree: Any) -> int:
    """Levels of nesting, counted without recursion so that no depth can exhaust the stack."""
    level, layer = 0, [tree]
    while layer:
        level += 1
        layer = [child for node in layer for child in _children(node)]
    return level


def _children(node: Any) -> Iterable[Any]:
    if isinstance(node, dict):
        return node.values()
    return node if isinstance(node, list | tuple) else ()


def nodes(tree: Any) -> Iterator[Any]:
    """Yield a tree and all that is in it: tables, lists and values."""
    yield tree
    for child in _children(tree):
        yield from nodes(child)


def _refuse_not_finite(document: Document, place: _toml_lines.Path, node: Any) -> None:
    if isinstance(node, float) and not math.isfinite(node):
        document.report(place, f"expected a finite number, found {node}")
    pairs = node.items() if isinstance(node, dict) else enumerate(_children(node))
    for key, child in pairs:
        _refuse_not_finite(document, (*place, key), child)
