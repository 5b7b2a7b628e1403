"""All findings of a session in one table, the most serious first."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from labpipe.workflow.session import FILE_NAME, Session
from pipelines.experiments import JUDGEMENT, KINDS
from pipelines.session._processing import process
from pipelines.session._session_checks import SESSION_CHECKS, named_at
from pipelines.session._stated_alike import stated_as_exact
from pipelines.session._unused import unused_files
from pipelines.session._verdicts import Verdict, verdicts_of
from pipelines.session._waiting import WAITING

if TYPE_CHECKING:
    from labpipe.judging import Finding, Level
    from labpipe.workflow.run_result import RunResult

_WEIGHT: dict[Level, int] = {"impossible": 3, "doubtful": 2, "note": 1}


@dataclass(frozen=True, slots=True)
class Trouble:
    """One row of an audit: one thing to change, and all that it spoils.

    ``level``: the worst of what follows from it; ``experiments``: those that it spoils; ``checks``: those that it
    fails; ``message``: what was seen, of the worst of them; ``cause``: the most likely mistake; empty when nothing
    singles one out; ``file``: to look at or to change, relative to the session; ``line``: of that file, where it is
    known; ``named_at``: line of session.toml that names the file, where that is another file; ``value``: the text of
    the line.
    """

    level: Level
    experiments: tuple[str, ...]
    checks: tuple[str, ...]
    message: str
    cause: str
    file: str
    line: int | None
    named_at: int | None = None
    value: str = ""

    @property
    def place(self) -> str:
        """The line to change, for people."""
        where = self.file if self.line is None else f"{self.file}:{self.line}"
        where = where if self.named_at is None else f"{where} ({FILE_NAME}:{self.named_at})"
        return f"{where}: {self.value}" if self.value and self.named_at is None else where

    @property
    def sentence(self) -> str:
        """What was seen, and why."""
        more = len(self.checks) - 1
        others = f" (and {more} more check{'s' * (more > 1)})" if more else ""
        return f"{self.message}{others}{f'; {self.cause}' if self.cause else ''}"

    def document(self) -> dict[str, Any]:
        """Return the row for JSON."""
        return asdict(self)


@dataclass(frozen=True, slots=True)
class Audit:
    """All rows, what costs most first, how many checks were made, and experiments by the values they state as exact."""

    troubles: tuple[Trouble, ...]
    checks: int
    exact: dict[str, list[str]]

    @property
    def is_impossible(self) -> bool:
        """Whether any record contradicts itself, physics, or what the session states."""
        return any(t.level == "impossible" for t in self.troubles)

    @property
    def caption(self) -> str:
        """What was done, and what was found."""
        count = {level: sum(t.level == level for t in self.troubles) for level in _WEIGHT}
        found = ", ".join(f"{n} {level}" for level, n in count.items() if n)
        return f"{self.checks} checks of the session: {found or 'nothing found'}"


def audit(folder: Path) -> Audit:
    """Judge every experiment of a session, and the session as a whole.

    What the verdicts need and is not there yet is processed first.
    """
    from pipelines.session._opening import open_session

    session, targets = open_session(folder), []
    for e in session.experiments.values():
        stages = [stage.name for stage in KINDS[e.kind].stages]
        targets += [f"{e.name}/{stage}" for stage in ([JUDGEMENT] if JUDGEMENT in stages else stages[-1:])]
    run = process(folder, targets) if targets else None
    # the lines that others wait for stand with the problems of session.toml
    verdicts = () if run is None else [v for v in verdicts_of(run).experiments if v.state != WAITING]
    session = session if run is None else run.session
    unused = (Trouble(f.level, (), (f.check,), f.message, f.cause, f.file, None) for f in unused_files(session))
    rows = [*_of_verdicts(session, verdicts), *_failures(run, verdicts), *unused]
    return Audit(
        tuple(sorted(rows, key=_cost)), sum(v.checks for v in verdicts) + SESSION_CHECKS + 1, stated_as_exact(session)
    )


def _cost(trouble: Trouble) -> tuple[int, int, int]:
    return -_WEIGHT[trouble.level], -len(trouble.experiments), -len(trouble.checks)


def _of_verdicts(session: Session, verdicts: Iterable[Verdict]) -> Iterator[Trouble]:
    """Join the findings that one change would mend."""
    joined: dict[tuple[str, int | None, str], list[tuple[str, Finding]]] = {}
    for verdict in verdicts:
        for finding in verdict.findings:
            key = (finding.file, finding.line, finding.cause or finding.message)
            joined.setdefault(key, []).append((verdict.experiment, finding))
    lines = named_at(session)
    for (file, line, _), found in joined.items():
        worst = min((f for _, f in found), key=lambda f: -_WEIGHT[f.level])
        experiments = tuple(dict.fromkeys(name for name, _ in found))
        checks = tuple(dict.fromkeys(f.check for _, f in found))
        named = lines.get(file) if line is None else None
        yield Trouble(worst.level, experiments, checks, worst.message, worst.cause, file, line, named, worst.value)


def _failures(run: RunResult | None, verdicts: Iterable[Verdict]) -> Iterator[Trouble]:
    """Tell the steps that failed in experiments whose kind makes no verdict."""
    told = {v.experiment for v in verdicts if v.findings}
    for outcome in () if run is None else run.failures:
        name = outcome.task.experiment
        if name not in told:
            line = run.session.experiments[name].lines.get("") if run is not None else None
            step = f"step {outcome.task.stage}"
            yield Trouble("impossible", (name,), (step,), f"{step}: {outcome.message}", "", FILE_NAME, line)
