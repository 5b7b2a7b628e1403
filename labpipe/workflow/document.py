"""A TOML file as a tree with lines: size, depth, syntax and numbers checked, keys not yet."""

import math
import re
import tomllib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from labpipe.errors import ConfigError, SourceError

LARGEST_FILE = 1_000_000
"""Bytes; no configuration written by a person is longer."""
_BARE = re.compile(r"[\w-]+")
"""A key that TOML takes without quotation marks (and letters of any language, for reading)."""
LABORATORY = "laboratory.toml"
"""Name of the laboratory's file, and first key of its places in the document of a session that refers to it."""
DEEPEST = 32
"""Levels of nesting; settings have about five."""
_PART = r"(?:[A-Za-z0-9_-]++|\"[^\"\n]*+\"|'[^'\n]*+')"
_TOO_DEEP = re.compile(rf"(?<![\w-])(?:{_PART}[ \t]*+\.[ \t]*+){{{DEEPEST}}}{_PART}[ \t]*+[=\]]")
"""A dotted key deeper than that: the time that the parser takes grows with the square of it."""

Place = tuple[str | int, ...]
"""Where a value is: keys, and positions in arrays counted from 0."""


@dataclass(slots=True)
class Document:
    """A TOML file as a tree, with the line of every value, and of the mistakes found so far."""

    path: Path
    tree: dict[str, Any]
    lines: dict[Place, int]
    problems: dict[str, int] = field(default_factory=dict)

    def line(self, place: Place) -> int:
        """Line of a value, or of the nearest table around it."""
        while place not in self.lines:
            place = place[:-1]
        return self.lines[place]

    def report(self, place: Place, message: str) -> None:
        """Note a mistake once."""
        self.problems[self.at(place, message)] = self.line(place)

    def at(self, place: Place, message: str) -> str:
        """Put before a message where it belongs: ``session.toml:14: experiments.a.height: …``."""
        name, own = (LABORATORY, place[1:]) if place[:1] == (LABORATORY,) else (self.path.name, place)
        shown = f"{dotted(own)}: " if own else ""
        return f"{name}:{self.line(place)}: {shown}{message}"

    def finish(self) -> None:
        """Raise ConfigError with every mistake in the order of its line, if there is any."""
        if self.problems:
            raise ConfigError(sorted(self.problems, key=self.problems.__getitem__))


def dotted(place: Place) -> str:
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
        Content that it would have; by default it is read.

    Raises
    ------
    SourceError
        There is no such file, or it cannot be read.
    ConfigError
        It is not TOML, too large, too deep, or holds a number that is not finite.
    """
    if text is None:
        try:
            size = path.stat().st_size
            if size > LARGEST_FILE:
                found = f"{size} bytes long, more than the {LARGEST_FILE} that a configuration may have"
                raise ConfigError([f"{path.name}:1: {found}; is it the right file?"])
            data = path.read_bytes()
            text = data.decode("utf-8-sig")
        except OSError as error:
            raise SourceError(path, f"cannot be read: {error.strerror}") from error
        except UnicodeDecodeError as error:
            line = data.count(b"\n", 0, error.start) + 1
            found = f"byte {data[error.start]:#04x} is not UTF-8"
            raise ConfigError([f"{path.name}:{line}: {found}; save the file as UTF-8"]) from None
    text = text.replace("\r\n", "\n")
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
    infinite: list[tuple[Place, float]] = []
    waiting: list[tuple[Place, Any]] = [((), tree)]
    while waiting:  # without recursion, so that no depth can exhaust the stack
        place, node = waiting.pop()
        if len(place) > DEEPEST:
            raise ConfigError([f"{path.name}:1: nested deeper than {DEEPEST} levels; flatten it"])
        if isinstance(node, float) and not math.isfinite(node):
            infinite.append((place, node))
        waiting += [((*place, key), child) for key, child in children(node)]
    document = Document(path, tree, line_index(text))
    for place, number in infinite:
        document.report(place, f"expected a finite number, found {number}")
    return document


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


def children(node: Any) -> Iterable[tuple[str | int, Any]]:
    """Return the values of a table with their keys, or of a list with their positions."""
    if isinstance(node, dict):
        return node.items()
    return enumerate(node) if isinstance(node, list | tuple) else ()


def nodes(tree: Any) -> Iterator[Any]:
    """Yield a tree and all that is in it: tables, lists and values."""
    yield tree
    for _, child in children(tree):
        yield from nodes(child)


# --- lines, which the standard parser does not say -----------------------------------------------

_TOKEN = re.compile(
    r'"""(?:\\.|[^\\])*?"{3,5}|\'\'\'.*?\'{3,5}|"(?:\\.|[^"\\])*"|\'[^\']*\'|#[^\n]*|[ \t]+|\n|[\[\]{}=,.]|'
    r'[^\s\[\]{}=,.#"\']+',
    re.DOTALL,
)
_LINE = '"\\u0000"='
"""Key of the line of a table, in the text that has lines for values."""


def line_index(text: str) -> dict[Place, int]:
    r"""Map the place of every key and array item to its line, counted from 1; the empty place is line 1.

    The text, which :mod:`tomllib` has accepted, is parsed once more with the line of each value in its place; a table
    has its line under a key of its own, an array as its first item.

    Examples
    --------
    >>> line_index('a = 1\n[b]\nc = [1,\n 2]')[("b", "c", 1)]
    4
    """
    written: list[str] = []
    inside: list[str] = []  # brackets around a value
    state, line = "key", 1
    for part in (*_TOKEN.findall(text.replace("\r\n", "\n")), "\n"):
        at, line = line, line + part.count("\n")
        if part[0] in "# \t":
            continue
        if part == "\n":
            written.append(f"\n{_LINE}{at}\n" if state == "header" else "\n")
            state = "value" if inside else "key"
        elif state == "header" or (part == "=" and state == "key"):
            written.append(part)
            state = "value" if part == "=" else state
        elif part in "]}":
            written.append(part)
            inside.pop()
            state = "done"
        elif part == ",":
            written.append(part)
            state = "value" if inside[-1] == "[" else "key"
        elif part in "[{" and state == "value":
            written.append(f"[{at}," if part == "[" else f"{{{_LINE}{at}")
            inside.append(part)
            state = "value" if part == "[" else "first key"
        elif state == "value":
            written.append(str(at))
            state = "done"
        elif state != "done":  # where a value is done, the rest of it follows
            written.append(f",{part}" if state == "first key" else part)
            state = "header" if part == "[" else "key"
    lines: dict[Place, int] = {}

    def note(place: Place, node: Any) -> int:
        found = node
        if isinstance(node, dict):
            own = node.pop("\0", None)
            inner = [note((*place, key), child) for key, child in node.items()]
            found = own or min(inner, default=1)
        elif isinstance(node, list):
            items = node[1:] if isinstance(node[0], int) else node
            inner = [note((*place, number), item) for number, item in enumerate(items)]
            found = node[0] if isinstance(node[0], int) else inner[0]
        lines[place] = found
        return found

    note((), tomllib.loads("".join(written)))
    return lines | {(): 1}
