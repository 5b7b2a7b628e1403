"""The errors that labpipe raises, and the exit code of the command line for each.

Every message gives the place, the finding, the expectation and the remedy.
"""

import warnings
from collections.abc import Sequence
from os import PathLike
from typing import Self

EXCHANGED, IN_MOTION, MARKER, TWO_CLOCKS = "width and height", "in motion", "marker", "two clocks"
UNKNOWN_FORMAT, NO_FILM, NO_MATERIAL, MATERIAL_FILE = "unknown format", "no film", "no material", "material file"
UNREADABLE, UNSAID, NO_INPUT, MISSING = "unreadable", "left unsaid", "no input", "missing"
"""Reasons, in this order; a marker stands in place of a reading, two clocks are flights of two accelerations; an
unreadable file contradicts its format in another way, and one that left a value unsaid cannot be read without it."""


class LabpipeError(Exception):
    """Root of all errors that labpipe raises on purpose, with the exit code of the command line.

    ``is_of_run`` says that the run was stopped by something else than its input: such an error says nothing about a
    record, and the same run may succeed another time. ``reason`` is one of the constants of this module, or the name of
    a wrong argument, where a caller acts on why it was raised; else empty.
    """

    exit_code = 1
    is_of_run = False
    reason = ""

    def because(self, reason: str) -> Self:
        """Return this error, with the reason that a caller acts on; "" leaves that of its kind."""
        self.reason = reason or self.reason
        return self


class UsageError(LabpipeError):
    """The command line was called with options that do not fit together."""

    exit_code = 2


class SourceError(LabpipeError):
    """A file cannot be read in the format that it claims.

    Parameters
    ----------
    path, message
        The file; the finding and the expectation.
    line, column, offset : int, optional
        Position in a text file, both counted from 1, or in a binary file [bytes], counted from 0.
    hint : str, optional
        Remedy for the user.
    """

    exit_code = 3
    reason = UNREADABLE

    def __init__(
        self,
        path: str | PathLike[str],
        message: str,
        *,
        line: int | None = None,
        column: int | None = None,
        offset: int | None = None,
        hint: str | None = None,
    ) -> None:
        self.path, self.message, self.hint = str(path), message, hint
        self.line, self.column, self.offset = line, column, offset
        super().__init__(path, message)  # so that the error survives a process boundary, with its fields

    def __str__(self) -> str:
        """Format as ``file:line:column: message`` with the hint on a line of its own."""
        where = ":".join(str(part) for part in (self.path, self.line, self.column) if part is not None)
        where += f" at byte {self.offset}" if self.offset is not None else ""
        return f"{where}: {self.message}" + (f"\n  {self.hint}" if self.hint else "")


class ConfigError(LabpipeError):
    """One or more mistakes in ``session.toml`` (or a calibration record), each as ``file:line: key: mistake``."""

    exit_code = 3

    def __init__(self, problems: Sequence[str]) -> None:
        self.problems = tuple(problems)
        super().__init__("\n".join(self.problems))

    def __reduce__(self) -> tuple[object, ...]:
        """Rebuild from the list of problems."""
        return ConfigError, (self.problems,)


class InstallationError(LabpipeError):
    """The program is not whole: another distribution has replaced a package, or files were changed under it."""

    exit_code = 3
    is_of_run = True


class CalibrationError(LabpipeError):
    """A calibration record is missing, expired, for another view, or out of its range."""

    exit_code = 3


class InputError(LabpipeError, ValueError):
    """A value handed to a function is outside its domain."""

    exit_code = 3


class StageError(LabpipeError):
    """One step of one experiment could not be made, or gave an unusable result."""

    is_of_run = True


class StoreError(LabpipeError):
    """A stored result is damaged or does not belong to its key."""

    exit_code = 4
    is_of_run = True


class StorageError(LabpipeError):
    """A result could not be written: no space or no permission."""

    exit_code = 5
    is_of_run = True


class SourceWarning(UserWarning):
    """Remark on a file that is read all the same; ``message`` is that without the name of the file."""

    def __init__(self, path: str | PathLike[str], message: str, line: int | None = None) -> None:
        self.message = message if line is None else f"line {line}: {message}"
        super().__init__(f"{path}{'' if line is None else f':{line}'}: {message}")


def warn_of(
    path: str | PathLike[str], message: str, *, line: int | None = None, category: type[SourceWarning] = SourceWarning
) -> None:
    """Warn the reader of a file."""
    warnings.warn(category(path, message, line), stacklevel=5)
