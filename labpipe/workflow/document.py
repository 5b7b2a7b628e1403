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
_TOO_DEEP = re.compile(rf"(?<![\w\"'-])(?:[\w\"'-]++[ \t]*+\.[ \t]*+){{{DEEPEST}}}")
"""A dotted key deeper than that: the time that the parser takes grows with the square of it."""
_TOKEN = re.compile(
    r'"""(?:\\.|[^\\])*?"{3,5}|\'\'\'.*?\'{3,5}|"(?:\\.|[^"\\])*"|\'[^\']*\'|#[^\n]*|[ \t]+|[\n\[\]{}=,]|'
    r'[^\s\[\]{}=,#"\']+(?: \d\d:[^\s\[\]{}=,#"\']+)?',  # the latter is the time of a day
    re.DOTALL,
)

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
        return next(self.lines[place[:n]] for n in range(len(place), -1, -1) if place[:n] in self.lines)

    def report(self, place: Place, message: str) -> None:
        """Note a mistake once."""
        self.problems[self.at(place, message)] = self.line(place)

    def at(self, place: Place, message: str) -> str:
        """Put before a message where it belongs: ``session.toml:14: experiments.a.height: …``."""
        name, own = (LABORATORY, place[1:]) if place[:1] == (LABORATORY,) else (self.path.name, place)
        return ": ".join((f"{name}:{self.line(place)}", *([counted(dotted(own))] if own else ()), message))

    def finish(self) -> None:
        """Raise ConfigError with every mistake in the order of its line, if there is any."""
        if self.problems:
            raise ConfigError(sorted(self.problems, key=self.problems.__getitem__))


def dotted(place: Place) -> str:
    """Write a place as ``experiments.acrylic.laser[2]``."""
    names = (f"[{k}]" if isinstance(k, int) else f".{k}" if re.fullmatch(r"[\w-]+", k) else f'."{k}"' for k in place)
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

    too_deep = f"nested deeper than {DEEPEST} levels; flatten it"
    try:
        if text is None:
            if (size := path.stat().st_size) > LARGEST_FILE:
                most = f"more than the {LARGEST_FILE} that a configuration may have"
                raise refuse(1, f"{size} bytes long, {most}; is it the right file?")
            text = path.read_bytes().decode("utf-8-sig")
        text = text.replace("\r\n", "\n")
        if (deep := _TOO_DEEP.search(text)) is not None:
            raise refuse(text.count("\n", 0, deep.start()) + 1, too_deep)
        tree = tomllib.loads(text)
    except OSError as error:
        raise SourceError(path, f"cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        line = error.object.count(b"\n", 0, error.start) + 1
        byte = error.object[error.start]
        raise refuse(line, f"byte {byte:#04x} is not UTF-8; save the file as UTF-8") from None
    except tomllib.TOMLDecodeError as error:
        # such as ``Cannot overwrite a value (at line 5, column 3)``; the only other place is "end of document"
        problem, _, found = str(error).removesuffix(")").rpartition(" (at ")
        said = next((said for begin, said in _SYNTAX.items() if problem.startswith(begin)), "{}").format(problem)
        if (at := re.fullmatch(r"line (\d+), column (\d+)", found)) is None:
            raise refuse(str(text).rstrip("\n").count("\n") + 1, said) from None
        said += f"; found: {[*str(text).splitlines(), ''][int(at[1]) - 1].strip()[:60]}"
        raise refuse(f"{at[1]}:{at[2]}", said) from None
    except (RecursionError, ValueError) as error:
        # Arrays thousands deep exhaust the stack; integers of thousands of digits are refused.
        raise refuse(1, f"cannot be read as TOML: {error}") from None
    nodes = list(placed(tree))
    if max(len(place) for place, _ in nodes) > DEEPEST:
        raise refuse(1, too_deep)
    document = Document(path, tree, line_index(text))
    for place, node in nodes:
        if isinstance(node, float) and not math.isfinite(node):
            document.report(place, f"expected a finite number, found {node}")
    return document


_ADVICE = "a text stands in quotation marks, a date reads 2026-01-31, a list stands in brackets"
_SYNTAX = {
    "Cannot": "a key or table is given twice ({}); remove one",
    "Illegal character '\\n'": "a text is not closed; expected a quotation mark before the line ends",
    "Expected newline or end of document": f"expected the end of the line after a value; {_ADVICE}",
    "Invalid value": f"expected a value; {_ADVICE}",
}
"""Beginnings of messages of tomllib, and the same for a person."""


def placed(tree: Any, place: Place = ()) -> Iterator[tuple[Place, Any]]:
    """Yield a tree and all that is in it, tables, lists and values, each with its place."""
    yield place, tree
    pairs: Iterable[tuple[str | int, Any]] = tree.items() if isinstance(tree, dict) else ()
    for key, child in enumerate(tree) if isinstance(tree, list | tuple) else pairs:
        yield from placed(child, (*place, key))


def texts_in(tree: Any) -> Iterator[str]:
    """Yield the texts in a tree."""
    return (node for _, node in placed(tree) if isinstance(node, str))


def line_index(text: str) -> dict[Place, int]:
    r"""Map the place of every key and array item to its line, counted from 1, which the standard parser does not say.

    The empty place is line 1. The text is one that :mod:`tomllib` has accepted.

    Examples
    --------
    >>> line_index('a = 1\n[b]\nc = [1,\n 2]')[("b", "c", 1)]
    4
    """
    lines: dict[Place, int] = {(): 1}
    last: dict[Place, int] = {}  # number of the last table of each array of tables

    def tokens() -> Iterator[tuple[str, int]]:
        line = 1
        for part in _TOKEN.findall(text):
            if part[0] not in "# \t":
                yield part, line
            line += part.count("\n")

    rest = tokens()

    def key(place: Place, line: int, begin: str, end: str) -> Place:
        """Read a key, note the tables on its way, and return its place."""
        written = begin
        while (part := next(rest)[0]) != end:
            written += part
        node = tomllib.loads(f"{written} = 0")
        while node:
            ((name, node),) = node.items()
            lines.setdefault(place := (*place, name), line)
            if node and place in last:
                place = (*place, last[place])
        return place

    def value(place: Place, begin: tuple[str, int]) -> None:
        """Read a value, and note the lines of all that is in it."""
        lines[place], number = begin[1], 0
        for part, line in rest if begin[0] in "[{" else ():
            if part in "]}":
                break
            number += part == ","
            if part in "\n,":
                continue
            if begin[0] == "[":
                value((*place, number), (part, line))
            else:
                value(key(place, line, part, "="), next(rest))

    here = Place()
    for part, line in rest:
        if part == "[":
            begin = next(rest)[0]
            here = key((), line, begin.removeprefix("["), "]")
            if begin == "[":
                next(rest)
                last[here] = last.get(here, -1) + 1
            here = (*here, last[here]) if here in last else here
            lines[here] = line
        elif part != "\n":
            value(key(here, line, part, "="), next(rest))
    return lines
