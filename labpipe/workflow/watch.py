"""Process experiments while a session is still being recorded, each as soon as it is complete.

A network share does not say when a file is closed, so the folder is looked at again and again. A file is complete when
its size and time have stayed the same over several looks and its own content says so; an experiment, when all its files
are, and those of the experiments that it refers to. A watcher that is started again finds the results in the store.
"""

import contextlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from labpipe.errors import InputError, LabpipeError
from labpipe.files import files_below
from labpipe.workflow.document import Document
from labpipe.workflow.graph import Stages, lineage, spell_out
from labpipe.workflow.session import FILE_NAME, Experiment, Session, load

if TYPE_CHECKING:
    from labpipe.workflow.results import RunResult

WAITING, ARRIVING, REFUSED, BROKEN = "waiting", "arriving", "refused", "broken"
PROCESSED, FAILED = "processed", "failed"
LOOKS = 3
"""Looks in a row that must find a file unchanged."""

Stamp = tuple[tuple[str, int, int], ...]
"""Name, size and time of modification of a file, or of every file of a folder."""


@dataclass(frozen=True, slots=True)
class News:
    """State of one experiment, or of session.toml, at a look at the folder.

    ``state`` is ``waiting`` (a file or a value is missing), ``arriving`` (a file is still changing), ``refused`` (a
    file at rest is not complete), ``processed``, ``failed``, or ``broken`` (session.toml cannot be used).
    """

    experiment: str
    state: str
    text: str


@dataclass(slots=True)
class Settling:
    """Which files have come to rest: unchanged over so many looks."""

    looks: int = LOOKS
    seen: dict[Path, tuple[Stamp, int]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Refuse to call a file complete without having looked."""
        if self.looks < 1:
            raise InputError(f"a file needs at least 1 look to be at rest, found looks={self.looks}")

    def look(self, path: Path) -> None:
        """Note the state of a file or folder; called once per look."""
        found = []
        # A file may vanish between being listed and being asked for; then it is not there.
        with contextlib.suppress(OSError):
            for part in files_below(path) if path.is_dir() else [path]:
                status = part.stat()
                found.append((part.name, status.st_size, status.st_mtime_ns))
        stamp = tuple(found) if sum(size for _, size, _ in found) else ()
        before, count = self.seen.get(path, ((), 0))
        self.seen[path] = (stamp, count + 1 if stamp == before and stamp else 1)

    def stamp(self, path: Path) -> Stamp:
        """State at the last look; empty when there was no such file, or nothing in it."""
        return self.seen.get(path, ((), 0))[0]

    def is_at_rest(self, path: Path) -> bool:
        """Whether a file is there, holds something, and was unchanged for long enough."""
        stamp, count = self.seen.get(path, ((), 0))
        return bool(stamp) and count >= self.looks


@dataclass(slots=True)
class Watcher:
    """Looks at a session folder and processes complete experiments.

    ``kinds`` and ``stages`` are those of every kind of experiment. ``check`` is given an experiment and the path of a
    file at rest, and returns None when the file is complete by its own content, or the missing part. ``run`` is given a
    session of complete experiments and processes one by name; ``fill`` is as in :func:`labpipe.workflow.session.load`.
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
    fill: Callable[[Document, Path], object] = lambda document, root: None

    def look(self) -> Iterator[News]:
        """Look once at every file; process complete experiments; yield only news."""
        for news in self._look():
            if self.told.get(news.experiment) != (news.state, news.text):
                self.told[news.experiment] = (news.state, news.text)
                yield news

    @property
    def is_done(self) -> bool:
        """Whether every experiment of the session was processed, or failed."""
        if self.session is None or self.session.waiting:
            return False
        return all(self.told.get(name, ("",))[0] in (PROCESSED, FAILED) for name in self.session.experiments)

    @property
    def states(self) -> dict[str, tuple[str, str]]:
        """Last state and text of every experiment."""
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
            if self.session is None or self.settling.stamp(path) != self.read_at:
                self.session = None
                self.session = load(path, self.kinds, may_wait=True, fill=self.fill)
                self.read_at = self.settling.stamp(path)
            session = self.session
            tasks = spell_out(session, self.stages)
        except LabpipeError as error:
            yield News("", BROKEN, str(error))
            return
        self.told.pop("", None)
        for name, lines in session.waiting.items():
            yield News(name, WAITING, "; ".join(lines))
        needs: dict[str, list[Path]] = {}
        for name in dict.fromkeys(task.experiment for task in tasks):
            own = [task for task in tasks if task.experiment == name]
            behind = [file for task in lineage(tasks, *own) for file in tasks[task].files]
            needs[name] = [session.files / file for file in dict.fromkeys(behind)]
        for file in sorted({file for files in needs.values() for file in files}):
            self.settling.look(file)
        for name, paths in needs.items():
            stamps = (self.read_at, *map(self.settling.stamp, paths))
            if self.finished.get(name) == stamps:
                continue
            if (obstacle := self._obstacle(session, name, paths)) is not None:
                yield obstacle
                continue
            ready = {n: e for n, e in session.experiments.items() if set(needs[n]) <= set(paths)}
            outcome = self.run(replace(session, experiments=ready), name)
            self.finished[name] = stamps
            failures = [o for o in outcome.failures if o.experiment == name]
            text = "; ".join(f"{o.task}: {o.message}" for o in failures) or str(outcome.reports.get(name, "done"))
            yield News(name, FAILED if failures else PROCESSED, text)

    def _obstacle(self, session: Session, name: str, paths: list[Path]) -> News | None:
        """Say why an experiment cannot be processed yet; its files are asked once per state whether they are whole."""
        absent = [p for p in paths if not self.settling.stamp(p)]
        if absent:
            there = len(paths) - len(absent)
            shown = absent[0].relative_to(session.files).as_posix()
            return News(name, WAITING, f"{there} of {len(paths)} files are there; next: {shown}")
        for path in paths:
            if not self.settling.is_at_rest(path):
                return News(name, ARRIVING, f"{path.relative_to(session.files).as_posix()} is still changing")
        for path in paths:
            stamp = self.settling.stamp(path)
            known = self.verdicts.get((name, path))
            if known is None or known[0] != stamp:
                known = (stamp, self.check(session.experiments[name], path))
                self.verdicts[name, path] = known
            if known[1] is not None:
                return News(name, REFUSED, known[1])
        return None
