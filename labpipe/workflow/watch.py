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
from labpipe.files import files_below, relative
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
class Watcher:
    """Looks at a session folder and processes complete experiments.

    ``kinds`` and ``stages`` are those of every kind of experiment. ``check`` is given an experiment and the path of a
    file at rest, and returns None when the file is complete by its own content, or the missing part. ``run`` is given a
    session of complete experiments and processes one by name; ``fill`` is as in :func:`labpipe.workflow.session.load`.
    ``looks`` is how many in a row must find a file unchanged, ``seen`` what they found of each.
    """

    folder: Path
    kinds: Mapping[str, type[msgspec.Struct]]
    stages: Stages
    check: Callable[[Experiment, Path], str | None]
    run: Callable[[Session, str], "RunResult"]
    looks: int = LOOKS
    seen: dict[Path, tuple[Stamp, int]] = field(default_factory=dict)
    told: dict[str, tuple[str, str]] = field(default_factory=dict)
    finished: dict[str, tuple[Stamp, ...]] = field(default_factory=dict)
    verdicts: dict[tuple[str, Path], tuple[Stamp, str | None]] = field(default_factory=dict)
    session: Session | None = None
    read_at: Stamp = ()
    fill: Callable[[Document, Path], object] = lambda document, root: None

    def __post_init__(self) -> None:
        """Refuse to call a file complete without having looked."""
        if self.looks < 1:
            raise InputError(f"a file needs at least 1 look to be at rest, found looks={self.looks}")

    def _news(self, experiment: str, state: str, text: str) -> Iterator[News]:
        """Yield the state of an experiment where it is another one than at the last look."""
        if self.told.get(experiment) != (state, text):
            self.told[experiment] = (state, text)
            yield News(experiment, state, text)

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

    def _see(self, path: Path) -> tuple[Stamp, bool]:
        """Look at a file or folder: its state, empty where nothing is in it, and whether it has come to rest."""
        found = []
        # A file may vanish between being listed and being asked for; then it is not there.
        with contextlib.suppress(OSError):
            for part in files_below(path) if path.is_dir() else [path]:
                status = part.stat()
                found.append((part.name, status.st_size, status.st_mtime_ns))
        stamp = tuple(found) if sum(size for _, size, _ in found) else ()
        before, count = self.seen.get(path, ((), 0))
        self.seen[path] = (stamp, count + 1 if stamp == before and stamp else 1)
        return stamp, bool(stamp) and self.seen[path][1] >= self.looks

    def look(self) -> Iterator[News]:
        """Look once at every file; process complete experiments; yield only news."""
        path = self.folder / FILE_NAME
        stamp, is_at_rest = self._see(path)
        if not stamp:
            yield from self._news("", WAITING, f"there is no {FILE_NAME} in {self.folder} yet")
            return
        if not is_at_rest:
            return
        try:
            if self.session is None or stamp != self.read_at:
                self.session = None
                self.session = load(path, self.kinds, may_wait=True, fill=self.fill)
                self.read_at = stamp
            session = self.session
            tasks = spell_out(session, self.stages)
        except LabpipeError as error:
            yield from self._news("", BROKEN, str(error))
            return
        self.told.pop("", None)
        for name, lines in session.waiting.items():
            yield from self._news(name, WAITING, "; ".join(lines))
        needs: dict[str, list[Path]] = {}
        for name in dict.fromkeys(task.experiment for task in tasks):
            own = [task for task in tasks if task.experiment == name]
            behind = [file for task in lineage(tasks, *own) for file in tasks[task].files]
            needs[name] = [session.files / file for file in dict.fromkeys(behind)]
        seen = {file: self._see(file) for file in sorted({file for files in needs.values() for file in files})}
        for name, paths in needs.items():
            stamps = (self.read_at, *(seen[path][0] for path in paths))
            if self.finished.get(name) == stamps:
                continue
            those = {path: seen[path] for path in paths}
            if (obstacle := self._obstacle(session.experiments[name], session.files, those)) is not None:
                yield from self._news(name, *obstacle)
                continue
            ready = {n: e for n, e in session.experiments.items() if set(needs[n]) <= set(paths)}
            outcome = self.run(replace(session, experiments=ready), name)
            self.finished[name] = stamps
            failures = [o for o in outcome.failures if o.experiment == name]
            text = "; ".join(f"{o.task}: {o.message}" for o in failures) or str(outcome.reports.get(name, "done"))
            yield from self._news(name, FAILED if failures else PROCESSED, text)

    def _obstacle(
        self, experiment: Experiment, root: Path, seen: Mapping[Path, tuple[Stamp, bool]]
    ) -> tuple[str, str] | None:
        """Say why an experiment cannot be processed yet; its files are asked once per state whether they are whole."""
        there = {path: relative(path, root) for path in seen}
        if absent := [name for path, name in there.items() if not seen[path][0]]:
            return WAITING, f"{len(seen) - len(absent)} of {len(seen)} files are there; next: {absent[0]}"
        if moving := [name for path, name in there.items() if not seen[path][1]]:
            return ARRIVING, f"{moving[0]} is still changing"
        for path, (stamp, _) in seen.items():
            known = self.verdicts.get((experiment.name, path))
            if known is None or known[0] != stamp:
                known = self.verdicts[experiment.name, path] = (stamp, self.check(experiment, path))
            if known[1] is not None:
                return REFUSED, known[1]
        return None
