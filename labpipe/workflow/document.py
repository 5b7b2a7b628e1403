"""A TOML file as a tree with the line of every value; size, depth, syntax and numbers checked, keys not yet."""

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
LABORATORY = "laboratory.toml"
"""Name of the laboratory's file, and first key of its places in the document of a session that refers to it."""
DEEPEST = 32
"""Levels of nesting; settings have about five."""
_BARE = re.compile(r"[\w-]+")
"""A key that TOML takes without quotation marks (and letters of any language, for reading)."""
_PART = r"(?:[A-Za-z0-9_-]++|\"[^\"\n]*+\"|'[^'\n]*+')"
_TOO_DEEP = re.compile(rf"(?<![\w-])(?:{_PART}[ \t]*+\.[ \t]*+){{{DEEPEST}}}{_PART}[ \t]*+[=\]]")
"""A dotted key deeper than that: the time that the parser takes grows with the square of it."""
_TOKEN = re.compile(
    r'"""(?:\\.|[^\\])*?"{3,5}|\'\'\'.*?\'{3,5}|"(?:\\.|[^"\\])*"|\'[^\']*\'|#[^\n]*|[ \t]+|\n|[\[\]{}=,.]|'
    r'[^\s\[\]{}=,.#"\']+',
    re.DOTALL,
)

Place = tuple[str | int, ...]
"""Where a value is: keys, and positions in arrays counted from 0."""


@dataclass(slots=True)
class Document:
    """A TOML file as a tree, with the line of every value, and of the mistakes found so far.

    ``origin`` has where values were written that stand at their places from another table, such as defaults.
    """

    path: Path
    tree: dict[str, Any]
    lines: dict[Place, int]
    problems: dict[str, int] = field(default_factory=dict)
    origin: dict[Place, Place] = field(default_factory=dict)

    def written(self, place: Place) -> Place:
        """Return where a value was written: at its own place, or in the table it was taken from."""
        ends = (n for n in range(len(place), 0, -1) if place[:n] in self.origin)
        return next(((*self.origin[place[:n]], *place[n:]) for n in ends), place)

    def line(self, place: Place) -> int:
        """Line of a value as it was written, or of the nearest table around it."""
        place = self.written(place)
        while place not in self.lines:
            place = place[:-1]
        return self.lines[place]

    def report(self, place: Place, message: str) -> None:
        """Note a mistake once."""
        self.problems[self.at(place, message)] = self.line(place)

    def at(self, place: Place, message: str) -> str:
        """Put before a message where it belongs: ``session.toml:14: experiments.a.height: …``."""
        place = self.written(place)
        name, own = (LABORATORY, place[1:]) if place[:1] == (LABORATORY,) else (self.path.name, place)
        shown = f"{counted(dotted(own))}: " if own else ""
        return f"{name}:{self.line(place)}: {shown}{message}"

    def finish(self) -> None:
        """Raise ConfigError with every mistake in the order of its line, if there is any."""
        if self.problems:
            raise ConfigError(sorted(self.problems, key=self.problems.__getitem__))


def dotted(place: Place) -> str:
    """Write a place as ``experiments.acrylic.laser[2]``."""
    names = (f"[{k}]" if isinstance(k, int) else f".{k}" if _BARE.fullmatch(k) else f'."{k}"' for k in place)
    return "".join(names).removeprefix(".")


def counted(dotted: str) -> str:
    """Write a dotted place as people count: ``drops[0].height`` as ``drops no. 1, height``."""
    return re.sub(r"\[(\d+)\](\.?)", lambda n: f" no. {int(n[1]) + 1}{', ' if n[2] else ''}", dotted)


def parse(path: Path, text: str | None = None) -> Document:
    """Read a TOML file without judging its keys; ``text`` is the content that it would have, by default read.

    Raises SourceError: there is no such file, or it cannot be read; ConfigError: it is not TOML, too large, too deep,
    or holds a number that is not finite.
    """

    def refuse(at: int | str, message: str) -> ConfigError:
        return ConfigError([f"{path.name}:{at}: {message}"])

    if text is None:
        try:
            if (size := path.stat().st_size) > LARGEST_FILE:
                most = f"more than the {LARGEST_FILE} that a configuration may have"
                raise refuse(1, f"{size} bytes long, {most}; is it the right file?")
            data = path.read_bytes()
            text = data.decode("utf-8-sig")
        except OSError as error:
            raise SourceError(path, f"cannot be read: {error.strerror}") from error
        except UnicodeDecodeError as error:
            line = data.count(b"\n", 0, error.start) + 1
            raise refuse(line, f"byte {data[error.start]:#04x} is not UTF-8; save the file as UTF-8") from None
    text = text.replace("\r\n", "\n")
    if (deep := _TOO_DEEP.search(text)) is not None:
        line = text.count("\n", 0, deep.start()) + 1
        raise refuse(line, f"nested deeper than {DEEPEST} levels; flatten it")
    try:
        tree = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise refuse(*_syntax_problem(text, str(error))) from None
    except (RecursionError, ValueError) as error:
        # Arrays thousands deep exhaust the stack; integers of thousands of digits are refused.
        raise refuse(1, f"cannot be read as TOML: {error}") from None
    document = Document(path, tree, line_index(text))
    for place, node in placed(tree):
        if len(place) > DEEPEST:
            raise refuse(1, f"nested deeper than {DEEPEST} levels; flatten it")
        if isinstance(node, float) and not math.isfinite(node):
            document.report(place, f"expected a finite number, found {node}")
    return document


def _syntax_problem(text: str, message: str) -> tuple[int | str, str]:
    """Turn ``Cannot overwrite a value (at line 5, column 3)`` into the place and words for a person."""
    problem, _, place = message.rpartition(" (at ")
    words = place.rstrip(")").replace(",", "").split()
    if problem.startswith(("Cannot overwrite a value", "Cannot declare")):
        problem = f"a key or table is given twice ({problem}); remove one"
    if len(words) != 4 or words[0] != "line":  # the only other place is "at end of document"
        return text.rstrip("\n").count("\n") + 1, problem or message
    line = [*text.splitlines(), ""][int(words[1]) - 1].strip()
    problem = next((said for begin, said in _SYNTAX.items() if problem.startswith(begin)), problem)
    return f"{words[1]}:{words[3]}", f"{problem}; found: {line[:60]}"


_SYNTAX = {
    "Illegal character '\\n'": "a text is not closed; expected a quotation mark before the line ends",
    "Expected newline or end of document": "expected the end of the line after a value; a text "
    "stands in quotation marks, a date reads 2026-01-31, a list stands in brackets",
    "Invalid value": "expected a value: a text in quotation marks, a number, true, false, a date "
    "such as 2026-01-31, or a list in brackets",
    "Expected '=' after a key": "expected = after the name of a key",
    "Invalid statement": "expected a key, a table in brackets, or a remark after #",
}
"""Messages of tomllib, and the same for a person."""


def placed(tree: Any, place: Place = ()) -> Iterator[tuple[Place, Any]]:
    """Yield a tree and all that is in it, tables, lists and values, each with its place."""
    yield place, tree
    pairs: Iterable[tuple[str | int, Any]] = tree.items() if isinstance(tree, dict) else ()
    for key, child in enumerate(tree) if isinstance(tree, list | tuple) else pairs:
        yield from placed(child, (*place, key))


def nodes(tree: Any) -> Iterator[Any]:
    """Yield a tree and all that is in it."""
    return (node for _, node in placed(tree))


# --- lines, which the standard parser does not say -----------------------------------------------


def line_index(text: str) -> dict[Place, int]:
    r"""Map the place of every key and array item to its line, counted from 1; the empty place is line 1.

    The text is one that :mod:`tomllib` has accepted.

    Examples
    --------
    >>> line_index('a = 1\n[b]\nc = [1,\n 2]')[("b", "c", 1)]
    4
    """
    lines: dict[Place, int] = {(): 1}
    tables: dict[Place, int] = {}  # number of the last table of each array of tables
    inside: list[tuple[Place, int | None]] = []  # tables and lists around a value, and the position in a list
    here, place = Place(), Place()
    keys: list[str] = []
    state, brackets, line = "key", 0, 1
    for part in _TOKEN.findall(text):
        at = line
        line += part.count("\n")
        if part[0] in "# \t" or (part == "\n" and inside):
            continue
        if part == "\n":
            state, keys, brackets = "key", [], 0
        elif state == "key" and (part == "=" or (part == "]" and not inside)):  # the end of a key, or of a header
            place = inside[-1][0] if inside else () if brackets else here
            for number, key in enumerate(keys, 1):
                place = (*place, key)
                lines.setdefault(place, at)
                if brackets == 2 and number == len(keys):
                    tables[place] = tables.get(place, -1) + 1
                place = (*place, tables[place]) if place in tables else place
            lines[place] = at
            here, state = (place, "done") if brackets else (here, "value")
        elif state == "key" and part == "[":
            brackets += 1
        elif state == "value" and part != "]":
            if inside and inside[-1][1] is not None:
                place = (*inside[-1][0], inside[-1][1])
                lines[place] = at
            if part in "[{":
                inside.append((place, 0 if part == "[" else None))
            state, keys = {"[": "value", "{": "key"}.get(part, "done"), []
        elif part in "]}" and inside:
            place, _ = inside.pop()
            state = "done"
        elif part == "," and state == "done":
            place, position = inside.pop()
            inside.append((place, None if position is None else position + 1))
            state, keys = "key" if position is None else "value", []
        elif state == "key" and part != ".":
            keys.append(part if _BARE.fullmatch(part) else next(iter(tomllib.loads(f"{part} = 0"))))
    return lines
