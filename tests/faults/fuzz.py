"""Coverage-guided fuzzing of the readers and of the configuration; by hand or at night.

``python -m tests.faults.fuzz TARGET SECONDS [FOUND]`` needs the package ``atheris`` (not among the
extras: it is built for few versions of Python). Whatever is not refused by an error of labpipe, or
takes longer than ten seconds, is written to the folder FOUND, one file per place in the code, and
becomes a named case in ``test_found_by_fuzzing.py``. The corpus it starts from lies beside it.
"""

import contextlib
import os
import signal
import sys
import tempfile
import traceback
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

CORPUS = Path(__file__).parent / "corpus"
LONGEST = 10  # s for one input of at most LARGEST bytes
LARGEST = 20_000  # bytes of one input


class Hang(BaseException):
    """One input took longer than it may."""


def _mach1(path: Path) -> None:
    from instruments import mach1

    mach1.read(path)


def _keyence(path: Path) -> None:
    from instruments import keyence

    keyence.read(path, cycle="50 us")


def _anton_paar(path: Path) -> None:
    from instruments import anton_paar

    anton_paar.read(path)


def _phantom(path: Path) -> None:
    import numpy as np

    from instruments import phantom

    film = phantom.read(path)
    sound = np.flatnonzero(film.valid)
    for index in sound[:4]:
        if film[int(index)].shape != film.shape[1:]:
            message = "a frame of another shape"
            raise AssertionError(message)
    if not np.isfinite(film.time).all():
        message = "a time that is no number"
        raise AssertionError(message)
    if film.exposure is not None and (film.exposure < 0).any():
        message = "a negative exposure"
        raise AssertionError(message)


def _image(path: Path) -> None:
    from instruments.images import _headers

    _headers.read_headers(path)


def _configuration(path: Path) -> None:
    from labpipe.workflow import session
    from pipelines.process import SETTINGS

    session.load(path, SETTINGS, may_wait=True)


def _record(path: Path) -> None:
    from calibration.record import load_record

    load_record(path)


TARGETS: dict[str, Callable[[Path], None]] = {
    "mach1": _mach1,
    "keyence": _keyence,
    "anton_paar": _anton_paar,
    "phantom": _phantom,
    "image": _image,
    "configuration": _configuration,
    "record": _record,
}


@contextlib.contextmanager
def time_limit(seconds: int) -> Iterator[None]:
    """Raise :class:`Hang` in the block when it takes longer."""

    def ring(*_: Any) -> None:
        raise Hang

    before = signal.signal(signal.SIGALRM, ring)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def attempt(target: str, path: Path) -> None:
    """Read one file; anything but a result or an error of labpipe is a failure."""
    from labpipe.errors import LabpipeError

    with warnings.catch_warnings(), time_limit(LONGEST), contextlib.suppress(LabpipeError):
        warnings.simplefilter("error")  # those of numpy and pandas are failures too
        warnings.simplefilter("ignore", UserWarning)
        TARGETS[target](path)


def starting_files(target: str) -> list[bytes]:
    """Sound files that the mutations begin with."""
    from tests.faults import seeds

    if target == "phantom":
        with tempfile.TemporaryDirectory() as folder:
            return [
                seeds.film_bytes(Path(folder), bits=bits, packed=packed)
                for bits, packed in ((8, False), (12, False), (12, True), (10, True))
            ]
    if target == "image":
        import cv2
        import numpy as np

        image = np.arange(48, dtype=np.uint8).reshape(6, 8)
        return [cv2.imencode(ending, image)[1].tobytes() for ending in (".png", ".tiff")]
    if target == "record":
        from pipelines.rig.samples import laser_record

        return [laser_record().encode()]
    makers = {
        "mach1": seeds.mach1_text,
        "keyence": seeds.keyence_text,
        "anton_paar": seeds.anton_paar_text,
        "configuration": lambda: seeds.SESSION,
    }
    return [makers[target]()]


def main(target: str, seconds: int, found: Path) -> None:
    """Fuzz one target for a time; print how many inputs were tried and how many failed."""
    import atheris

    with atheris.instrument_imports(include=["labpipe"]):
        from labpipe.errors import LabpipeError

    found.mkdir(parents=True, exist_ok=True)
    shared = Path("/dev/shm")  # noqa: S108 - in memory where there is such a place
    folder = Path(tempfile.mkdtemp(dir=shared if shared.is_dir() else None))
    path = folder / "session.toml" if target == "configuration" else folder / "input"
    start = folder / "start"
    start.mkdir()
    with atheris.instrument_imports(include=["instruments", "calibration", "labpipe"]):
        for number, data in enumerate(starting_files(target)):
            (start / f"seed{number}").write_bytes(data)
            path.write_bytes(data)
            # importing everything takes its time where it is instrumented
            with contextlib.suppress(LabpipeError):
                TARGETS[target](path)
    counts = {"tried": 0, "failed": 0}

    def one(data: bytes) -> None:
        counts["tried"] += 1
        path.write_bytes(data)
        try:
            attempt(target, path)
        except (Exception, Hang) as error:
            counts["failed"] += 1
            last = traceback.extract_tb(error.__traceback__)[-1]
            name = f"{target}-{type(error).__name__}-{Path(last.filename).stem}-{last.lineno}"
            if not (found / name).exists():
                (found / name).write_bytes(data)
                print(name, repr(error)[:200], file=sys.stderr, flush=True)  # noqa: T201
        if counts["tried"] % 1000 == 0:
            print(target, counts, file=sys.stderr, flush=True)  # noqa: T201

    corpus = CORPUS / target
    grown = folder / "grown"
    grown.mkdir()
    given = [str(grown), str(start), *([str(corpus)] if corpus.is_dir() else [])]
    options = [f"-max_total_time={seconds}", f"-max_len={LARGEST}", "-rss_limit_mb=3000", "-verbosity=0", "-seed=1"]
    atheris.Setup([sys.argv[0], *options, *given], one)
    atheris.Fuzz()


if __name__ == "__main__":
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    main(sys.argv[1], int(sys.argv[2]), Path(sys.argv[3] if len(sys.argv) > 3 else "found"))
