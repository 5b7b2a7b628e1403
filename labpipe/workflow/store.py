"""Results by their keys: written once, verified whenever they are read, never half there.

::

    SESSION/labpipe/store/ab/abcd….nc      a result, or .html for a page
    SESSION/labpipe/store/ab/abcd….json    its record; the result exists only with it
    SESSION/labpipe/store/latest/NAME.json the last key of every task of an experiment
    SESSION/labpipe/store/quarantine/      damaged results
    SESSION/labpipe/store/index.json       digests by size, times and inode
    SESSION/labpipe/store/verdicts.json    verdicts, with the digest of all that they come from
    SESSION/labpipe/store/verdicts-of-failures.json    the same of experiments that failed
    SESSION/labpipe/store/catalogue.json   rows of the catalogue, with the digest of all that they come from
    SESSION/labpipe/store/amended.json     pages to which the session as a whole added something
    SESSION/labpipe/run.jsonl              events of all runs of the session; the only place with times
"""

import contextlib
import datetime
import hashlib
import json
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import msgspec

from labpipe import files
from labpipe.errors import SourceError, StoreError
from labpipe.files import HashIndex
from labpipe.workflow.graph import TaskId
from labpipe.workflow.session import Session

if TYPE_CHECKING:
    import xarray as xr

FORMAT = 1
"""Version of the records; one of another version is set aside and its result made again."""

AMENDED = "amended.json"
LOG = "run.jsonl"
_ENDINGS = {"dataset": ".nc", "page": ".html"}
_KEY = re.compile(r"[0-9a-f]{64}")


class Caught(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A warning that a stage raised: its category, its text, and how often."""

    category: str
    text: str
    count: int


class Record(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Record of a result."""

    format: int
    key: str
    output: str
    digest: str
    size: int
    ingredients: dict[str, Any]
    warnings: tuple[Caught, ...]
    work: dict[str, float | int]


class Last(NamedTuple):
    """The last result of a task; ``taken_for`` is the key that it was to have, if another."""

    key: str
    taken_for: str | None = None


def key_of(ingredients: Mapping[str, Any]) -> str:
    """SHA-256 of the canonical JSON text of the ingredients."""
    return hashlib.sha256(files.canonical(ingredients).encode("utf-8", "surrogatepass")).hexdigest()


_MOST_KEPT = 1 << 26
"""Bytes."""
_kept: "dict[str, tuple[xr.Dataset, int]]" = {}
"""Datasets, with their sizes, that this process last wrote or read, by the digest of their files.

Most results have several readers. A digest is that of the content, so nothing here can be out of date.
"""


def _keep(digest: str, dataset: "xr.Dataset") -> bool:
    """Keep a Dataset that no one else will change, and forget the oldest; return whether there is room."""
    if (size := dataset.nbytes) > _MOST_KEPT:
        return False
    _kept.pop(digest, None)
    _kept[digest] = dataset, size
    while sum(size for _, size in list(_kept.values())) > _MOST_KEPT:
        _kept.pop(next(iter(_kept), ""), None)
    return True


class Store:
    """The results of one session, in ``SESSION/labpipe``; nothing is made before the first result is written."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.root = folder / "store"
        self.index = HashIndex(self.root / "index.json")

    # --- looking ---

    def record(self, key: str) -> Record | None:
        """Return the record of a result, or None when there is none that can be believed."""
        try:
            record = msgspec.convert(files.unseal(self._path(key, ".json").read_bytes()), Record)
        except (OSError, msgspec.ValidationError):
            return None
        is_ours = record.format == FORMAT and record.key == key == key_of(record.ingredients)
        return record if is_ours else None

    def state(self, key: str) -> str:
        """Return whether a result is ``stored``, ``absent`` or ``damaged``, without numpy."""
        # Asked first: another process may write the record while it is looked for.
        is_there = self._path(key, ".json").exists()
        if (record := self.record(key)) is None:
            return "damaged" if is_there else "absent"
        with contextlib.suppress(SourceError):
            if self.index.digest(self.path(record)) == record.digest:
                return "stored"
        return "damaged"

    def path(self, record: Record) -> Path:
        """Where a result is."""
        return self._path(record.key, _ENDINGS[record.output])

    def read(self, key: str) -> "xr.Dataset | str":
        """Return a result after comparing its whole content with its record.

        Raises StoreError: it is not there, or damaged; a damaged one has been moved to the quarantine, so that the next
        run makes it again.
        """
        is_there = self._path(key, ".json").exists()
        record = self.record(key)
        if record is None:
            if is_there:
                self.quarantine(key)
            raise StoreError(f"there is no whole result {key[:12]} in {self.root}; run again to make it")
        path = self.path(record)
        try:
            if files.digest(path) == record.digest:
                if record.output == "page":
                    return path.read_text("utf-8")
                known = _kept.get(record.digest)
                found = files.read_dataset(path) if known is None else known[0]
                return found.copy(deep=True) if _keep(record.digest, found) else found
        except (SourceError, StoreError):
            pass  # missing, or damaged in a way that the digest was forged for: the same answer
        self.quarantine(key)
        raise StoreError(
            f"the stored result {key[:12]} was damaged and has been moved to "
            f"{self.root / 'quarantine'}; run again to make it again"
        )

    def amended(self) -> dict[str, dict[str, Any]]:
        """Return additions to pages by experiment, with the page's key and its digest since."""
        try:
            return files.unseal((self.root / AMENDED).read_bytes()) or {}
        except OSError:
            return {}

    # --- writing ---

    def write(
        self,
        ingredients: Mapping[str, Any],
        result: "xr.Dataset | str",
        *,
        warnings: tuple[Caught, ...] = (),
        work: Mapping[str, float | int] | None = None,
    ) -> Record:
        """Store a result under the key of its ingredients; it exists once its record does."""
        key = key_of(ingredients)
        output = "page" if isinstance(result, str) else "dataset"
        path = self._path(key, _ENDINGS[output])
        if isinstance(result, str):
            files.write_text(path, result)
            digest = files.digest(path)
        else:
            read_back = files.write_dataset(path, result)
            digest = files.digest(path)
            _keep(digest, read_back)
        record = Record(
            format=FORMAT,
            key=key,
            output=output,
            digest=digest,
            size=path.stat().st_size,
            ingredients=dict(ingredients),
            warnings=warnings,
            work=dict(work or {}),
        )
        files.write_bytes(self._path(key, ".json"), files.seal(msgspec.to_builtins(record)))
        return record

    def quarantine(self, key: str) -> None:
        """Set a damaged result and its record aside; nothing is deleted."""
        target = self.root / "quarantine"
        for ending in (".json", *_ENDINGS.values()):
            path = self._path(key, ending)
            if not path.exists():
                continue
            target.mkdir(parents=True, exist_ok=True)
            count = sum(1 for _ in target.glob(f"{key}*{ending}"))
            # Two processes may both find the damage; the second finds nothing left to move.
            with contextlib.suppress(FileNotFoundError):
                path.replace(target / f"{key}-{count}{ending}")

    # --- the last key of every task, for the reasons of a plan ---

    def latest(self, experiment: str) -> dict[TaskId, Last]:
        """Return the last result of every task of an experiment."""
        try:
            found = files.unseal((self.root / "latest" / f"{experiment}.json").read_bytes())
            return {TaskId(experiment, stage, recording): Last(*key) for stage, recording, *key in found}
        except (OSError, TypeError, ValueError):  # absent, damaged, or another record of ours
            return {}

    def note_latest(self, experiment: str, found: Mapping[TaskId, Last]) -> None:
        """Remember the last results of tasks of an experiment; only the holder of its lock calls it."""
        known = self.latest(experiment)
        if known != (now := {**known, **found}):
            entries = ([*task[1:], *filter(None, last)] for task, last in now.items())
            ordered = sorted(entries, key=lambda entry: (entry[0], entry[1] or ""))
            files.write_bytes(self.root / "latest" / f"{experiment}.json", files.seal(ordered))

    # --- locks and checks ---

    @contextlib.contextmanager
    def experiment(self, name: str) -> Iterator[None]:
        """Let one process at a time compute an experiment."""
        with files.lock(self.root / "locks" / f"{name}.lock"):
            yield

    def check(self) -> list[str]:
        """Read every result again and name the damaged ones; nothing is moved."""
        problems = []
        for path in sorted(self.root.glob("??/*.json")):
            record = self.record(path.stem) if _KEY.fullmatch(path.stem) else None
            if record is None:
                problems.append(f"{path.name}: the record is damaged or foreign")
                continue
            try:
                if files.digest(self.path(record)) != record.digest:
                    problems.append(f"{self.path(record).name}: the content does not fit its record")
            except SourceError as error:
                problems.append(str(error))
        return problems

    def _path(self, key: str, ending: str) -> Path:
        return self.root / key[:2] / f"{key}{ending}"


# --- the log of all runs -------------------------------------------------------------------------


def log(session: Session, event: str, **details: Any) -> None:
    """Append an event to the log of a session, with the time."""
    now = datetime.datetime.now(datetime.UTC).isoformat(timespec="milliseconds")
    line = json.dumps({"time": now, "event": event, **details}, ensure_ascii=False)
    files.append_line(session.folder / LOG, line)


def events(session: Session, containing: str = "") -> list[dict[str, Any]]:
    """Return the events of all runs whose lines contain a text; most are about results that were there already."""
    return events_after(session, 0, containing)[1]


def events_after(session: Session, position: int, containing: str) -> tuple[int, list[dict[str, Any]]]:
    """Return the end of the log, and the events written since a position [bytes] in it whose lines contain a text.

    Lines that a kill left incomplete are passed over.
    """
    try:
        with (session.folder / LOG).open("rb") as stream:
            stream.seek(position)
            *lines, _ = stream.read().split(b"\n")  # another process may be writing the last one
    except OSError:
        return position, []
    found = []
    for line in lines:
        if containing.encode() in line:
            with contextlib.suppress(ValueError):
                found.append(json.loads(line))
    return position + sum(len(line) + 1 for line in lines), [event for event in found if isinstance(event, dict)]


def last_seconds(session: Session) -> dict[TaskId, float]:
    """Return how long every step took when it was last computed, on the clock."""
    found = {}
    for event in events(session, '"state": "done"'):
        with contextlib.suppress(ValueError, KeyError, TypeError):
            task = TaskId(event["experiment"], event["stage"], event["recording"])
            found[task] = float(event["seconds"])
    return found
