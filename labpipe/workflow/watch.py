"""Process experiments while a session is still being recorded, each as soon as it is complete.

Nothing tells a program on a network share that a file was closed, so the folder is looked at again
and again. A file counts as complete when its size and time have stayed the same over several looks
and its own content says so; an experiment, when all its files do, and those of the experiments
that it refers to. What was done is in the store; a watcher that is started again finds it there.
"""

import contextlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from labpipe.errors import InputError, LabpipeError
from labpipe.files import files_below
from labpipe.workflow.session import FILE_NAME, Experiment, Session, load
from labpipe.workflow.tasks import Stages, Task, TaskId, ancestors, spell_out

if TYPE_CHECKING:
    from labpipe.workflow.run_result import RunResult

WAITING, ARRIVING, REFUSED, BROKEN = "waiting", "arriving", "refused", "broken"
PROCESSED, FAILED = "processed", "failed"
LOOKS = 3
"""Looks in a row that must find a file unchanged."""

Stamp = tuple[tuple[str, int, int], ...]
"""Name, size and time of modification of a file, or of every file of a folder."""


@dataclass(frozen=True, slots=True)
class News:
    """What a look at the folder found out about one experiment, or about session.toml.

    ``state`` is ``waiting`` (a file or a value is missing), ``arriving`` (a file is still changing),
    ``refused`` (a file that has come to rest is not complete), ``processed``, ``failed``, or
    ``broken`` (session.toml cannot be used; ``experiment`` is empty).
    """

    experiment: str
    state: str
    text: str
    outcome: "RunResult | None" = None


@dataclass(slots=True)
class Settling:
    """Which files have come to rest: unchanged over :data:`LOOKS` looks."""

    looks: int = LOOKS
    seen: dict[Path, tuple[Stamp, int]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Refuse to call a file complete without having looked."""
        if self.looks < 1:
            raise InputError(f"a file needs at least 1 look to be at rest, found looks={self.looks}")

    def look(self, path: Path) -> None:
        """Note the state of a file; called once per look."""
        stamp = stamp_of(path)
        before, count = self.seen.get(path, ((), 0))
        self.seen[path] = (stamp, count + 1 if stamp == before and stamp else 1)

    def stamp(self, path: Path) -> Stamp:
        """State at the last look; empty when there was no such file, or nothing in it."""
        return self.seen.get(path, ((), 0))[0]

    def is_at_rest(self, path: Path) -> bool:
        """Whether a file is there, holds something, and was unchanged for long enough."""
        stamp, count = self.seen.get(path, ((), 0))
        return bool(stamp) and count >= self.looks


def stamp_of(path: Path) -> Stamp:
    """Return the state of a file or folder; empty when it is not there or holds nothing."""
    found = []
    # A file may vanish between being listed and being asked for; then it is not there.
    with contextlib.suppress(OSError):
        for part in files_below(path) if path.is_dir() else [path]:
            status = part.stat()
            found.append((part.name, status.st_size, status.st_mtime_ns))
    return tuple(found) if sum(size for _, size, _ in found) else ()


@dataclass(slots=True)
class Watcher:
    """Looks at a session folder and processes what has become complete.

    ``folder``: the session folder; session.toml may come later; ``kinds``, ``stages``: settings structure and stages of
    every kind of experiment; ``check``: given an experiment and the path of a file at rest: None when the file is
    complete by its own content, or what is missing; ``run``: given a session of complete experiments and the name of
    one: processes it; ``settling``: how long a file must rest.
    """

    folder: Path
    kinds: Mapping[str, type[msgspec.Struct]]
    stages: Stages
    check: Callable[[Experiment, Path], str | None]
    run: Callable[[Session, str], "RunResult"]
    settling: Settling = field(default_factory=Settling)
    told: dict[str, tuple[str, str]] = field(default_factory=dict)
    finished: dict[str, tuple[Stamp, ...]] = field(default_factory=dict)
    verdicts: dict[tuple[str, Path], tuple[Stamp, str | None]] = field(default_factory=dict)
    session: Session | None = None
    read_at: Stamp = ()

    def look(self) -> Iterator[News]:
        """Look once at every file; process what is complete; tell only what is new."""
        for news in self._look():
            if self.told.get(news.experiment) != (news.state, news.text):
                self.told[news.experiment] = (news.state, news.text)
                yield news

    @property
    def is_done(self) -> bool:
        """Whether every experiment of the session was processed, or failed, as it stands."""
        if self.session is None:
            return False
        if self.session.waiting:
            return False
        states = [self.told.get(name, ("", ""))[0] for name in self.session.experiments]
        return all(state in (PROCESSED, FAILED) for state in states)

    @property
    def states(self) -> dict[str, tuple[str, str]]:
        """State and text of every experiment, as last told."""
        return {name: said for name, said in self.told.items() if name}

    def _look(self) -> Iterator[News]:
        path = self.folder / FILE_NAME
        self.settling.look(path)
        if not self.settling.stamp(path):
            yield News("", WAITING, f"there is no {FILE_NAME} in {self.folder} yet")
            return
        if not self.settling.is_at_rest(path):
            return
        try:
            session, needs = self._needs(path)
        except LabpipeError as error:
            yield News("", BROKEN, str(error))
            return
        self.told.pop("", None)
        for name, lines in session.waiting.items():
            yield News(name, WAITING, "; ".join(lines))
        for name in sorted({file for files in needs.values() for file in files}):
            self.settling.look(session.root / name)
        for name in needs:
            news = self._one(session, name, needs)
            if news is not None:
                yield news

    def _needs(self, path: Path) -> tuple[Session, dict[str, tuple[str, ...]]]:
        """Read the session when its file has changed; list the files behind every experiment."""
        stamp = self.settling.stamp(path)
        if self.session is None or stamp != self.read_at:
            self.session = None
            self.session = load(path, self.kinds, may_wait=True)
            self.read_at = stamp
        tasks = spell_out(self.session, self.stages)
        return self.session, {name: files_behind(tasks, name) for name in dict.fromkeys(t.experiment for t in tasks)}

    def _one(self, session: Session, name: str, needs: Mapping[str, tuple[str, ...]]) -> News | None:
        paths = [session.root / file for file in needs[name]]
        stamps = (self.read_at, *map(self.settling.stamp, paths))
        if self.finished.get(name) == stamps:
            return None
        obstacle = self._obstacle(session, name, paths)
        if obstacle is not None:
            return obstacle
        ready = {n: e for n, e in session.experiments.items() if set(needs[n]) <= set(needs[name])}
        outcome = self.run(replace(session, experiments=ready), name)
        self.finished[name] = stamps
        failures = [o for o in outcome.failures if o.experiment == name]
        text = "; ".join(f"{o.task}: {o.message}" for o in failures)
        page = outcome.reports.get(name)
        state = FAILED if failures else PROCESSED
        return News(name, state, text or (str(page) if page else "done"), outcome)

    def _obstacle(self, session: Session, name: str, paths: list[Path]) -> News | None:
        absent = [p for p in paths if not self.settling.stamp(p)]
        if absent:
            there = len(paths) - len(absent)
            text = f"{there} of {len(paths)} files are there; next: {_shown(session, absent[0])}"
            return News(name, WAITING, text)
        moving = [p for p in paths if not self.settling.is_at_rest(p)]
        if moving:
            return News(name, ARRIVING, f"{_shown(session, moving[0])} is still changing")
        for path in paths:
            problem = self._verdict(session.experiments[name], path)
            if problem is not None:
                return News(name, REFUSED, problem)
        return None

    def _verdict(self, experiment: Experiment, path: Path) -> str | None:
        """Ask once per state of a file whether its content is complete."""
        stamp = self.settling.stamp(path)
        known = self.verdicts.get((experiment.name, path))
        if known is None or known[0] != stamp:
            known = (stamp, self.check(experiment, path))
            self.verdicts[experiment.name, path] = known
        return known[1]


def files_behind(tasks: Mapping[TaskId, Task], experiment: str) -> tuple[str, ...]:
    """List the files of an experiment and of those that it refers to, each once."""
    own = [name for name in tasks if name.experiment == experiment]
    behind = [*ancestors(tasks, *own), *own]
    return tuple(dict.fromkeys(file for name in behind for file in tasks[name].files))


def _shown(session: Session, path: Path) -> str:
    return path.relative_to(session.root).as_posix()
