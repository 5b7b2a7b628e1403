"""Random sessions, identified and compared with their truths; a line of JSON for every one.

``python -m tests.pipelines.identified FILE [KIND ...] [--count N]`` goes on where FILE ends. With
``--sessions FOLDER`` recordings and results of the stages are kept, and only what has changed is
computed anew by another run. ``--table`` prints what FILE holds.
"""

import argparse
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import msgspec

from tests.pipelines.identified_points import points
from tests.pipelines.identified_trial import Trial, session_trial
from tests.pipelines.random_sessions import KINDS, drawn, write


def stored(file: Path) -> list[Trial]:
    """Return the trials of a file; a last line that was cut off is none."""
    if not file.exists():
        return []
    whole = file.read_bytes().rpartition(b"\n")[0]
    return [msgspec.json.decode(line, type=Trial) for line in whole.splitlines()]


@contextmanager
def place(sessions: Path | None, kind: str, seed: int) -> Iterator[Path]:
    """Give the folder of a session: a kept one, or one for this time."""
    if sessions is not None:
        yield sessions / f"{kind}_{seed}"
        return
    with tempfile.TemporaryDirectory() as folder:
        yield Path(folder)


def go_on(file: Path, kinds: list[str], count: int, sessions: Path | None) -> None:
    """Append the trials that a file lacks, kinds in turn."""
    done = {(t.kind, t.seed) for t in stored(file)}
    for number in range(count):
        for kind in kinds:
            truth = drawn(kind, number)
            if (kind, truth.seed) in done:
                continue
            with place(sessions, kind, truth.seed) as folder:
                trial = session_trial(truth, folder)
            with file.open("ab") as end:
                end.write(msgspec.json.encode(trial) + b"\n")


def rows(trials: list[Trial]) -> list[str]:
    """Return what the trials say together as text."""
    return [
        f"{p.setting}: {p.error:.2f} | "
        + ", ".join(f"{k} {v:.3g}" for k, v in p.extra.items() if isinstance(v, int | float))
        for p in points(trials)
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("file", type=Path)
    parser.add_argument("kinds", nargs="*", choices=[*KINDS, []], default=[])
    parser.add_argument("--count", type=int, default=100, help="sessions of each kind")
    parser.add_argument("--sessions", type=Path, help="where to keep recordings and results")
    parser.add_argument("--record", action="store_true", help="only write the recordings")
    parser.add_argument("--table", action="store_true", help="only print the table")
    chosen = parser.parse_args()
    kinds = chosen.kinds or list(KINDS)
    if chosen.record:
        for number in range(chosen.count):
            for truth in (drawn(kind, number) for kind in kinds):
                write(truth, chosen.sessions / f"{truth.kind}_{truth.seed}")
        return
    if not chosen.table:
        go_on(chosen.file, kinds, chosen.count, chosen.sessions)
    sys.stdout.write("\n".join([*rows(stored(chosen.file)), ""]))


if __name__ == "__main__":
    main()
