"""All findings of a session in one table, the most serious first."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from labpipe.workflow.session import FILE_NAME
from pipelines.experiments import JUDGEMENT, KINDS
from pipelines.session._processing import process
from pipelines.session._results import open_session
from pipelines.session._session_checks import SESSION_CHECKS, stated_as_exact, unused_files
from pipelines.session._verdicts import WAITING, verdicts_of

if TYPE_CHECKING:
    from labpipe.judging import Finding, Level

_WEIGHT: dict[Level, int] = {"impossible": 3, "doubtful": 2, "note": 1}


class Trouble(NamedTuple):
    """One row of an audit: one thing to change, and all that it spoils.

    ``level``: the worst of what follows from it; ``experiments``: those that it spoils; ``checks``: those that it
    fails; ``message``: of the worst of them; ``cause``: the most likely mistake, empty when nothing singles one
    out; ``file``: to look at or to change, relative to the session; ``line``: of that file, where it is known;
    ``value``: the text of the line, or where session.toml names the file; ``place``: all of these, for people.
    """

    level: Level
    experiments: tuple[str, ...]
    checks: tuple[str, ...]
    message: str
    cause: str
    file: str
    line: int | None
    value: str
    place: str

    @classmethod
    def of(cls, finding: Finding, experiments: tuple[str, ...] = (), checks: tuple[str, ...] = ()) -> Trouble:
        """Return the row of a finding."""
        f = finding
        return cls(f.level, experiments, checks or (f.check,), f.message, f.cause, f.file, f.line, f.value, f.place)

    @property
    def sentence(self) -> str:
        """The observation and its cause."""
        more = len(self.checks) - 1
        others = f" (and {more} more check{'s' * (more > 1)})" if more else ""
        return f"{self.message}{others}{f'; {self.cause}' if self.cause else ''}"

    def document(self) -> dict[str, Any]:
        """Return the row for JSON."""
        return self._asdict()


@dataclass(frozen=True, slots=True)
class Audit:
    """All rows, the costliest first, the number of checks, and experiments by the values that they state as exact."""

    troubles: tuple[Trouble, ...]
    checks: int
    exact: dict[str, list[str]]

    @property
    def is_impossible(self) -> bool:
        """Whether any record contradicts itself, physics, or the session's statements."""
        return any(t.level == "impossible" for t in self.troubles)

    @property
    def caption(self) -> str:
        """Number of checks and of findings."""
        count = {level: sum(t.level == level for t in self.troubles) for level in _WEIGHT}
        found = ", ".join(f"{n} {level}" for level, n in count.items() if n)
        return f"{self.checks} checks of the session: {found or 'nothing found'}"

    @property
    def rows(self) -> list[tuple[str, str, str, str]]:
        """Level, place, experiments and sentence of every row."""
        return [(t.level, t.place, ", ".join(t.experiments), t.sentence) for t in self.troubles]


def audit(folder: Path) -> Audit:
    """Judge every experiment of a session, and the session as a whole.

    Results that the verdicts need are processed first. Findings that one change would mend are one row.
    """
    session, targets = open_session(folder), []
    for e in session.experiments.values():
        stages = [stage.name for stage in KINDS[e.kind].stages]
        targets += [f"{e.name}/{stage}" for stage in ([JUDGEMENT] if JUDGEMENT in stages else stages[-1:])]
    rows = [Trouble.of(finding) for finding in unused_files(session)]
    checks = SESSION_CHECKS
    if targets:
        run = process(folder, targets)
        session = run.session
        # the lines that experiments wait for are among the problems of session.toml
        verdicts = [v for v in verdicts_of(run).experiments if v.state != WAITING]
        checks += sum(v.checks for v in verdicts)
        joined: dict[tuple[str, int | None, str], list[tuple[str, Finding]]] = {}
        for name, f in ((v.experiment, f) for v in verdicts for f in v.findings):
            joined.setdefault((f.file, f.line, f.cause or f.message), []).append((name, f))
        for found in joined.values():
            worst = max((f for _, f in found), key=lambda f: _WEIGHT[f.level])
            names, titles = (tuple(dict.fromkeys(c)) for c in zip(*((n, f.check) for n, f in found), strict=True))
            rows.append(Trouble.of(worst, names, titles))
        judged = {v.experiment for v in verdicts if v.findings}
        for outcome in run.failures:  # in experiments whose kind makes no verdict
            if (name := outcome.task.experiment) not in judged:
                step, line = f"step {outcome.task.stage}", session.experiments[name].lines.get("")
                about = (f"{step}: {outcome.message}", "", FILE_NAME, line, "", f"{FILE_NAME}:{line}")
                rows.append(Trouble("impossible", (name,), (step,), *about))
    rows.sort(key=lambda t: (-_WEIGHT[t.level], -len(t.experiments), -len(t.checks)))
    return Audit(tuple(rows), checks, stated_as_exact(session))
