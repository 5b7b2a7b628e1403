"""The readers and the configuration as targets of fuzzing: one file in, a result or an error of labpipe out.

The files of the corpus, one for each kind of fault, were found by coverage-guided fuzzing (atheris).
"""

import contextlib
import signal
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
    from instruments.images import _files

    _files.read_headers(path)


def _configuration(path: Path) -> None:
    from labpipe.workflow import session
    from pipelines.session import SETTINGS

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
