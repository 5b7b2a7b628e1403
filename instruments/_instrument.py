"""Description of an instrument: one object that recognises and reads its files.

The package that defines one is imported whenever a file is to be recognised, so it imports no numerical library:
readers are named as ``"module:function"`` and loaded when the first file is read.
"""

import contextlib
import importlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypedDict, get_args

from labpipe.errors import UsageError
from labpipe.text import unmarked_codec

HEAD_BYTES = 4096  # enough for every magic number and every text header known
HEAD_LINES = 400  # in which a text says what it holds; a header is a few dozen lines at most

Content = Literal["displacement", "force", "film", "sweep", "displacement_field"]
"""Content of the files of an instrument, which decides the experiments that can begin from them.

``displacement``
    A table over ``time`` [s]: ``out1``, … [m or V], ``status1``, … (0 where valid), with the attributes
    ``sampling_interval`` [s] and ``start`` (ISO 8601), by whose day a calibration record is checked.
``force``
    A table over ``sample`` as :func:`instruments.mach1.read` returns it: blocks of time, position and force.
``film``
    A :class:`labpipe.frames.FrameSource`.
``sweep``
    A table over ``sample``: ``frequency`` [Hz], ``temperature`` [degC], ``storage_modulus``, ``loss_modulus`` [Pa], and
    ``interval``; or ``temperature`` and ``log10_aT``.
``displacement_field``
    A table over ``frame`` and ``point``: ``dx``, ``dy`` [px].
"""
CONTENTS: tuple[Content, ...] = get_args(Content)


class NoOptions(TypedDict, total=False):
    """Options of a reader that has none."""


@dataclass(frozen=True, slots=True)
class Instrument:
    """One instrument.

    Parameters
    ----------
    name, title : str
        By which it is called in Python, JSON and on the command line; its files in a message.
    content : str
        Content of its files: one of :data:`CONTENTS`.
    sniff : callable
        Takes the first :data:`HEAD_BYTES` bytes of a file (none of a folder) and its path, and returns whether this
        instrument wrote it. It imports no numerical library.
    reader : str
        ``"module:function"``; takes the path and the options, returns a Dataset in SI or a film.
    options : TypedDict class
        Names and types of the keyword arguments of the reader.
    unproposed : str
        Why `labpipe init` proposes no experiment from its files, "" where it does.
    """

    name: str
    title: str
    content: Content
    sniff: Callable[[bytes, Path], bool]
    reader: str
    options: type[Any] = NoOptions
    unproposed: str = ""

    def read(self, path: Path, options: Mapping[str, Any]) -> Any:
        """Read one file; UsageError where the reader has no such option."""
        for name in options:
            self._require_option(name)
        module, function = self.reader.split(":")
        return getattr(importlib.import_module(module), function)(path, **options)

    def option(self, name: str, text: str) -> Any:
        """Return the value of an option that was typed as text; UsageError for no option, or no value of it."""
        self._require_option(name)
        kind = self.options.__annotations__[name]
        kinds = [wanted for wanted in get_args(kind) or (kind,) if wanted in _TYPED]
        for wanted in kinds:
            with contextlib.suppress(KeyError, ValueError):
                return _TYPED[wanted][0](text)
        expected = ", ".join(_TYPED[wanted][1] for wanted in kinds)
        how = f"expected {expected}" if expected else "it can be given from Python only"
        raise UsageError(f'the option {name} of {self.name} cannot be "{text}"; {how}')

    def _require_option(self, name: str) -> None:
        known = self.option_names()
        if name not in known:
            raise UsageError(f'{self.name} has no option "{name}"; it has {", ".join(known) or "none"}')

    def option_names(self) -> tuple[str, ...]:
        """Return the names of the options, in the order in which they are declared."""
        return tuple(self.options.__annotations__)


_TYPED: dict[Any, tuple[Callable[[str], Any], str]] = {
    bool: ({"true": True, "false": False}.__getitem__, "true or false"),
    int: (int, "a whole number"),
    float: (float, "a number"),
    str: (str, "a text"),
}


def text_of(head: bytes) -> str:
    """Decode the first bytes of a text file of any codec, well enough to look for words."""
    if head.startswith((b"\xff\xfe", b"\xfe\xff")):
        return head.decode("utf-16", errors="replace")
    if wide := unmarked_codec(head):
        return head.decode(wide, errors="replace")
    whole = head[: head.rfind(b"\n") + 1 or None] if len(head) >= HEAD_BYTES else head
    try:
        return whole.decode("utf-8").removeprefix("\ufeff")
    except UnicodeDecodeError:
        return whole.decode("latin-1").removeprefix("ï»¿")
