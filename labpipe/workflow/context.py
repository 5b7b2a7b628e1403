"""The part of a run that a page receives, and the counts of work done and skipped behind it.

A stage leaves counts in the attribute ``work`` of its result, as JSON text. A count is a part of the total with its
name, ``history_samples`` of ``history_samples_total``, or all of it but the last word, ``frames_read`` of
``frames_total``.
"""

import json
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import msgspec

from labpipe.errors import NO_INPUT, InputError
from labpipe.workflow.graph import TaskId

DONE, FAILED, SKIPPED = "done", "failed", "skipped"


class LedgerRow(NamedTuple):
    """One count of one stage, summed over its recordings; ``skipped`` is the rest of its total, where that is known."""

    experiment: str
    stage: str
    name: str
    done: float
    skipped: float | None


def counts(work: Any) -> dict[str, float | int]:
    """Read the attribute ``work`` of a result, given as JSON text or as a dictionary.

    The clock's seconds, the one count that depends on the machine, are left out. Raises InputError where it is
    anything but names with numbers.

    Examples
    --------
    >>> counts('{"frames_read": 10, "frames_total": 100, "seconds": 0.1}')
    {'frames_read': 10, 'frames_total': 100}
    """
    try:
        text = work if isinstance(work, str) else json.dumps(work or {}, allow_nan=False, default=int)  # of NumPy
        found = msgspec.json.decode(text, type=dict[str, int | float])
    except (msgspec.DecodeError, ValueError, TypeError):
        raise InputError(f'the attribute "work" must hold counts such as {{"frames_read": 10}}: {work!r}') from None
    return {name: value for name, value in found.items() if name != "seconds"}


def summarise(work: Iterable[tuple[str, str, Mapping[str, float | int]]]) -> tuple[LedgerRow, ...]:
    """Sum the counts of results, each with its experiment and stage, into rows in the order in which they appear.

    Examples
    --------
    >>> summarise([("a", "dic", {"frames_read": 10, "frames_total": 100})])
    (LedgerRow(experiment='a', stage='dic', name='frames_read', done=10, skipped=90),)
    """
    sums: Counter[tuple[str, str, str]] = Counter()
    for experiment, stage, found in work:
        sums.update({(experiment, stage, name): value for name, value in found.items()})
    rows = []
    for (experiment, stage, name), done in sums.items():
        totals = (sums.get((experiment, stage, f"{one}_total")) for one in (name, name.rpartition("_")[0]))
        total = next((one for one in totals if one is not None), None)
        if not name.endswith("_total"):
            rows.append(LedgerRow(experiment, stage, name, done, None if total is None else total - done))
    return tuple(rows)


def settings_in_words(changed: Mapping[str, tuple[str, str]]) -> str:
    """Write settings with two values each, ``sphere.mass 505 g → 506 g``."""
    return "; ".join(f"{name} {old} → {new}" for name, (old, new) in changed.items())


@dataclass(frozen=True, slots=True)
class Warned:
    """A warning that a stage before the page raised, and how often."""

    stage: str
    recording: str | None
    category: str
    text: str
    count: int


@dataclass(frozen=True, slots=True)
class Outcome:
    """The end of one task: ``done``, ``cached``, ``kept``, ``failed`` or ``skipped``; written into the log.

    ``key`` finds the result in the store. Where there is none ``message`` says why; ``exit_code``, ``error`` (the
    class), ``reason`` and ``is_of_run`` are those of the error, ``details`` its place. ``seconds`` passed on the clock.
    """

    experiment: str
    stage: str
    recording: str | None
    state: str
    key: str | None = None
    message: str = ""
    exit_code: int = 0
    error: str = ""
    details: str = ""
    seconds: float = 0.0
    is_of_run: bool = False
    reason: str = ""

    @property
    def task(self) -> TaskId:
        """The task that ended."""
        return TaskId(self.experiment, self.stage, self.recording)

    @property
    def is_consequence(self) -> bool:
        """Whether it has no result only because one before it has none."""
        return self.reason == NO_INPUT


@dataclass(frozen=True, slots=True)
class Context:
    """Passed to stages that ask for it; everything in it is equal for equal inputs.

    ``ledger`` holds the counts of the stages behind it, ``failures`` those without a result, called as it calls them,
    ``kept`` those whose results of earlier code were taken as they are, with the change since in words, ``provenance``
    its origin by :func:`labpipe.workflow.provenance.of_task`; ``base``, ``changed`` and ``overrides`` are those of its
    :class:`labpipe.workflow.session.Experiment`.
    """

    experiment: str
    kind: str
    title: str
    operator: str
    notes: str
    synthetic: bool
    ledger: tuple[LedgerRow, ...] = ()
    warnings: tuple[Warned, ...] = ()
    failures: tuple[Outcome, ...] = ()
    provenance: Mapping[str, Any] = field(default_factory=dict)
    kept: Mapping[str, str] = field(default_factory=dict)
    base: str = ""
    changed: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    overrides: Mapping[str, tuple[str, str]] = field(default_factory=dict)
