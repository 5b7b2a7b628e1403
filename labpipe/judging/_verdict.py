"""One verdict on a record from all its checks, and its form as JSON."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, Literal

from labpipe.judging._causes import Cause, explain, with_causes
from labpipe.judging._checks import Check, Finding, Level

Verdict = Literal["yes", "doubtful", "impossible", "unknown"]

_WEIGHT: dict[Level, int] = {"impossible": 3, "doubtful": 2, "note": 1}


@dataclass(frozen=True, slots=True)
class Judgement:
    """Whether a record can be believed.

    Attributes
    ----------
    believable : "yes", "doubtful", "impossible" or "unknown"
        Unknown when no check could be made, or when nothing was found by a run that did not get through.
    checks : tuple of Check
        All of them, those that could not be made too.
    causes : tuple of str
        What would explain the findings, the likeliest first.
    """

    believable: Verdict
    checks: tuple[Check, ...]
    causes: tuple[str, ...] = ()

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What is wrong, the worst first."""
        found = [
            Finding(c.name, c.level, c.message, c.cause, c.file, c.line, c.setting)
            for c in self.checks
            if c.level is not None
        ]
        return tuple(sorted(found, key=lambda f: -_WEIGHT[f.level]))

    @property
    def n_made(self) -> int:
        """Number of checks that could be made."""
        return sum(c.is_made for c in self.checks)


def judge(checks: Sequence[Check], causes: Sequence[Cause] = ()) -> Judgement:
    """Make one verdict of all checks of a record.

    Parameters
    ----------
    checks : sequence of Check
    causes : sequence of Cause
        Mistakes that would explain several checks at once. The likeliest one is told with every
        finding that it explains, with its file and line.

    Returns
    -------
    Judgement
    """
    ranked = explain(checks, causes)
    explained = with_causes(checks, ranked)
    levels = [c.level for c in checks if c.level is not None]
    believable: Verdict = "yes"
    if "impossible" in levels:
        believable = "impossible"
    elif "doubtful" in levels:
        believable = "doubtful"
    elif not any(c.is_made for c in checks) or any(c.level is not None and not c.is_made for c in checks):
        believable = "unknown"
    worst_first = sorted((c for c in explained if c.level is not None), key=lambda c: -_WEIGHT[c.level or "note"])
    own = [c.cause for c in worst_first if c.cause]
    sentences = dict.fromkeys([*(e.sentence for e in ranked), *own])
    return Judgement(believable, tuple(explained), tuple(sentences))


def to_json(judgement: Judgement) -> str:
    """Return a judgement as JSON text, for the attribute of a stored result."""
    rows = [{name: _plain(getattr(check, name)) for name in _OF_A_CHECK} for check in judgement.checks]
    document = {"believable": judgement.believable, "causes": judgement.causes, "checks": rows}
    return json.dumps(document, ensure_ascii=False, sort_keys=True)


def from_json(text: str) -> Judgement:
    """Read what :func:`to_json` wrote."""
    document = json.loads(text)
    checks = [Check(**{k: _number(k, v) for k, v in row.items()}) for row in document["checks"]]
    return Judgement(document["believable"], tuple(checks), tuple(document["causes"]))


_FLOATS = ("margin", "log_ratio", "u_log_ratio")
_OF_A_CHECK = tuple(each.name for each in fields(Check))


def _plain(value: Any) -> Any:
    return repr(value) if isinstance(value, float) else value


def _number(name: str, value: Any) -> Any:
    return float(value) if name in _FLOATS else value
