"""On which line of a TOML file each value stands; the standard parser does not say.

The text has already been accepted by :mod:`tomllib`, so this scanner only has to follow it.
"""

import tomllib

Path = tuple[str | int, ...]
"""Where a value stands: keys, and positions in arrays counted from 0."""

_BARE_END = ",]}\n#"


def index(text: str) -> dict[Path, int]:
    r"""Map the path of every key and array item to its line, counted from 1.

    The empty path is line 1.

    Examples
    --------
    >>> index('a = 1\n[b]\nc = [1,\n 2]')[("b", "c", 1)]
    4
    """
    scanner = _Scanner(text.replace("\r\n", "\n"))
    scanner.document()
    return scanner.lines


class _Scanner:
    """A position in the text, and the lines found so far."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.at = 0
        self.line = 1
        self.lines: dict[Path, int] = {(): 1}
        self._array_sizes: dict[Path, int] = {}

    def document(self) -> None:
        """Scan to the end."""
        prefix: Path = ()
        self._skip(newlines=True)
        while self.at < len(self.text):
            if self.text[self.at] == "[":
                prefix = self._header()
            else:
                self._assignment(prefix)
            self._skip(newlines=True)

    def _header(self) -> Path:
        is_array = self.text.startswith("[[", self.at)
        self._advance(2 if is_array else 1)
        keys = self._dotted_key()
        self._advance(2 if is_array else 1)
        path: Path = ()
        for position, key in enumerate(keys):
            path = (*path, key)
            self.lines.setdefault(path, self.line)
            if is_array and position == len(keys) - 1:
                self._array_sizes[path] = self._array_sizes.get(path, 0) + 1
            if path in self._array_sizes:
                path = (*path, self._array_sizes[path] - 1)
        self.lines[path] = self.line
        return path

    def _assignment(self, prefix: Path) -> None:
        line = self.line
        path = prefix
        for key in self._dotted_key():
            path = (*path, key)
            self.lines.setdefault(path, line)
        self._advance(1)  # the equals sign
        self._value(path)

    def _dotted_key(self) -> list[str]:
        keys = []
        while True:
            self._skip()
            keys.append(self._key())
            self._skip()
            if self.text[self.at : self.at + 1] != ".":
                return keys
            self._advance(1)

    def _key(self) -> str:
        start = self.at
        if self.text[self.at] in "\"'":
            self._string()
            return str(tomllib.loads("k = " + self.text[start : self.at])["k"])
        while self.at < len(self.text) and (self.text[self.at].isalnum() or self.text[self.at] in "_-"):
            self.at += 1
        return self.text[start : self.at]

    def _value(self, path: Path) -> None:
        self._skip()
        first = self.text[self.at]
        if first in "\"'":
            self._string()
        elif first == "[":
            self._array(path)
        elif first == "{":
            self._inline_table(path)
        else:
            while self.at < len(self.text) and self.text[self.at] not in _BARE_END:
                self.at += 1

    def _array(self, path: Path) -> None:
        self._advance(1)
        position = 0
        self._skip(newlines=True)
        while self.text[self.at] != "]":
            self.lines[*path, position] = self.line
            self._value((*path, position))
            position += 1
            self._skip(newlines=True)
            if self.text[self.at] == ",":
                self._advance(1)
                self._skip(newlines=True)
        self._advance(1)

    def _inline_table(self, path: Path) -> None:
        self._advance(1)
        self._skip(newlines=True)
        while self.text[self.at] != "}":
            self._assignment(path)
            self._skip(newlines=True)
            if self.text[self.at] == ",":
                self._advance(1)
                self._skip(newlines=True)
        self._advance(1)

    def _string(self) -> None:
        quote = self.text[self.at]
        mark = quote * 3 if self.text.startswith(quote * 3, self.at) else quote
        self._advance(len(mark))
        while not self.text.startswith(mark, self.at):
            self._advance(2 if quote == '"' and self.text[self.at] == "\\" else 1)
        self._advance(len(mark))
        # Up to two more quotation marks belong to the end of a string in triple marks.
        while len(mark) == 3 and self.text[self.at : self.at + 1] == quote:
            self._advance(1)

    def _skip(self, *, newlines: bool = False) -> None:
        """Pass over blanks and, where they may stand, comments and line ends."""
        while self.at < len(self.text):
            character = self.text[self.at]
            if character == "#" and newlines:
                end = self.text.find("\n", self.at)
                self.at = len(self.text) if end < 0 else end
            elif character in " \t" or (newlines and character == "\n"):
                self._advance(1)
            else:
                return

    def _advance(self, count: int) -> None:
        self.line += self.text.count("\n", self.at, self.at + count)
        self.at += count
