"""The verdict on a record from all its checks, and its form as JSON."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from math import isfinite
from typing import Literal

from labpipe.judging._cause import Cause, explain, with_causes
from labpipe.judging._check import WEIGHT, Check, CheckSummary, Finding

Verdict = Literal["yes", "doubtful", "impossible", "unknown"]


@dataclass(frozen=True, slots=True)
class Judgement:
    """Verdict on a record.

    ``believable`` is unknown when no check could be made, or when nothing was found by a run that did not get through;
    ``checks`` are those of every recording and stated value; ``causes`` are possible ones of the findings, the
    likeliest first; ``laws`` are sentences by the title of a check, in the order of the page.
    """

    believable: Verdict
    checks: tuple[Check, ...]
    causes: tuple[str, ...] = ()
    laws: Mapping[str, str] = field(default_factory=dict)

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Failed checks, the gravest first; a failed step comes after a doubtful property of the record itself."""
        alike: dict[tuple[object, ...], list[Check]] = {}
        for c in sorted((c for c in self.checks if c.level is not None), key=_order):
            alike.setdefault((c.name, c.level, c.cause, c.file, c.line, c.setting), []).append(c)
        made = []
        for same in alike.values():  # one finding of checks that fail for one cause in one place
            worst = max(same, key=lambda c: abs(c.margin) if isfinite(c.margin) else 0.0)
            message = f"{worst.message}{f' (and in {len(same) - 1} more)' if len(same) > 1 else ''}"
            where = worst.cause, worst.file, worst.line, worst.setting
            made.append(Finding(worst.title or worst.name, worst.level or "note", message, *where))
        return tuple(made)

    @property
    def rows(self) -> tuple[CheckSummary, ...]:
        """One row for each check, over all recordings, in the order of the laws."""
        by_title: dict[str, list[Check]] = {title: [] for title in self.laws}
        for one in self.checks:
            by_title.setdefault(one.title or one.name, []).append(one)
        return tuple(CheckSummary(t, self.laws.get(t, ""), tuple(found)) for t, found in by_title.items() if found)

    @property
    def n_made(self) -> int:
        """Number of checks that could be made; one of several recordings counts once."""
        return sum(row.is_made for row in self.rows)

    @property
    def n_passed(self) -> int:
        """Number of checks without a finding other than notes."""
        return sum(row.is_made and WEIGHT[row.worst.level] < WEIGHT["doubtful"] for row in self.rows)


def judge(checks: Sequence[Check], causes: Sequence[Cause] = (), laws: Mapping[str, str] | None = None) -> Judgement:
    """Derive the verdict on a record from all its checks; `laws` as in :class:`Judgement`.

    `causes` are mistakes that would explain several checks at once: each finding has the likeliest one, with its place.
    """
    ranked = explain(checks, causes)
    explained = [replace(check, cause=check.cause or check.otherwise) for check in with_causes(checks, ranked)]
    specific = []  # a failed step has the cause of the gravest finding about its recording, where there is one
    for check in explained:
        known: list[Check] = []
        if check.is_generic and check.level is not None and check.line is None:
            known = [c for c in explained if not c.is_generic and c.cause and WEIGHT[c.level] > WEIGHT["note"]]
            known = [c for c in known if not (check.file and c.recording) or c.recording == check.file]
        if not known:
            specific.append(check)
            continue
        worst = min(known, key=_order)
        specific.append(replace(check, cause=worst.cause, file=worst.file, line=worst.line, setting=worst.setting))
    levels = {c.level for c in checks}
    believable: Verdict = "yes"
    if grave := levels & {"impossible", "doubtful"}:
        believable = "impossible" if "impossible" in grave else "doubtful"
    elif not any(c.is_made for c in checks) or any(c.level and not c.is_made for c in checks):
        believable = "unknown"
    judged = Judgement(believable, tuple(specific), laws=laws or {})
    sentences = [e.sentence for e in ranked] + [f.cause for f in judged.findings if f.cause]
    return replace(judged, causes=tuple(dict.fromkeys(sentences)))


def _order(check: Check) -> tuple[bool, bool, int]:
    return check.level == "note", check.is_generic, -WEIGHT[check.level]


def to_json(judgement: Judgement) -> str:
    """Return a judgement as JSON text, for the attribute of a stored result."""
    return json.dumps(asdict(judgement), ensure_ascii=False)


def from_json(text: str) -> Judgement:
    """Read the text of :func:`to_json`."""
    document = json.loads(text)
    checks = tuple(Check(**row) for row in document["checks"])
    return Judgement(document["believable"], checks, tuple(document["causes"]), document["laws"])
