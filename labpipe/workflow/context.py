"""What a page may say about the run behind it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from labpipe.errors import NO_INPUT
from labpipe.workflow._ledger import LedgerRow

_MOST_MODULES = 3


def code_changed(modules: Sequence[str]) -> str:
    """Say which code has changed; of many modules only the first are named.

    Examples
    --------
    >>> code_changed(["labpipe.units"])
    'code changed: labpipe.units'
    """
    more = f" and {len(modules) - _MOST_MODULES} more" if len(modules) > _MOST_MODULES else ""
    return f"code changed: {', '.join(modules[:_MOST_MODULES])}{more}" if modules else ""


@dataclass(frozen=True, slots=True)
class Warned:
    """A warning that a stage before the page raised."""

    stage: str
    recording: str | None
    category: str
    text: str
    count: int


@dataclass(frozen=True, slots=True)
class Failed:
    """A stage before the page that gave no result, and why.

    ``is_of_run`` says that the run was at fault, which tells nothing about what was recorded;
    ``reason`` is that of the error (:attr:`labpipe.errors.LabpipeError.reason`).
    """

    stage: str
    recording: str | None
    text: str
    is_of_run: bool = False
    reason: str = ""

    @property
    def is_consequence(self) -> bool:
        """Whether it failed only because one before it did."""
        return self.reason == NO_INPUT


@dataclass(frozen=True, slots=True)
class Kept:
    """A result of earlier code that was taken as it is, and what has changed in the code since."""

    stage: str
    recording: str | None
    changed: tuple[str, ...]

    @property
    def reason(self) -> str:
        """What has changed, for people."""
        return code_changed(self.changed)


@dataclass(frozen=True, slots=True)
class RawFile:
    """A file of the session behind the page."""

    name: str
    size: int
    sha256: str


@dataclass(frozen=True, slots=True)
class Context:
    """Passed to stages that ask for it; everything in it is equal for equal inputs.

    ``ledger`` holds the counts of the stages of this experiment behind the page; ``provenance``
    is what :func:`labpipe.workflow.provenance.of_task` says of the page.
    """

    experiment: str
    kind: str
    title: str
    operator: str
    notes: str
    synthetic: bool
    ledger: tuple[LedgerRow, ...] = ()
    warnings: tuple[Warned, ...] = ()
    failures: tuple[Failed, ...] = ()
    inputs: tuple[RawFile, ...] = ()
    provenance: Mapping[str, Any] = field(default_factory=dict)
    kept: tuple[Kept, ...] = ()
