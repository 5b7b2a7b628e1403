"""The verbs sample and demo: synthetic sessions, opened or processed."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

from labpipe.errors import InputError
from labpipe.workflow.engines import Died, elsewhere
from labpipe.workflow.graph import imports_of
from labpipe.workflow.results import Event, RunResult
from labpipe.workflow.session import FILE_NAME, Session
from pipelines.rig import DEMO_TITLE
from pipelines.session import STAGES, open_session, process

_KINDS = ("dma", "ball_drop", "harmonic")
_RECORDING = "pipelines.rig.samples"


def sample(name: str, folder: str | Path, *, full_size: bool = False, seed: int | None = None) -> Session:
    """Write a synthetic session, with its true values, into a new folder.

    The virtual rig generates all data; none is measured.

    Parameters
    ----------
    name : str
        ``demo``, ``core``, ``films``, ``indentation``, ``static``, ``dma``, ``plate``, ``thesis``
        or ``thesis-small``; :data:`pipelines.rig.SAMPLES` describes each.
    folder : path-like
        Where to.
    full_size : bool
        Films at the camera's full size instead of a reduced one.
    seed : int, optional
        Of ``thesis`` and ``thesis-small``: all that session.toml and the calibration records state is off the truth
        by chance, within the stated uncertainties. By default the bundled draw.

    Returns
    -------
    Session

    Raises
    ------
    UsageError
        There is no such sample, a sample that no seed draws, or a folder that holds something already.

    Examples
    --------
    >>> sample("core", "my-session")  # doctest: +SKIP
    """
    from pipelines.rig.samples import write_sample

    write_sample(name, Path(folder), full_size=full_size, seed=seed)
    return open_session(folder)


def record_demo(folder: str | Path) -> bool:
    """Write the demonstration into a folder unless its session.toml is there; return whether it was written.

    It is recorded in a process of those that will work on it, forked from one that has loaded the numerical libraries,
    which this one then need not do. InputError says that the process died.
    """
    source = Path(folder) / FILE_NAME
    if source.is_file() and f'title = "{DEMO_TITLE} (synthetic)"' in source.read_text("utf-8", "replace"):
        return False
    stages = (stage for kind in _KINDS for stage in STAGES[kind])
    imports = (*imports_of(stages), _RECORDING, "labpipe.compilation")
    try:
        elsewhere(partial(_recorded, Path(folder)), imports)
    except Died as death:
        raise InputError(f"the demonstration was not recorded: {death}; remove {folder} and try again") from None
    return True


def _recorded(folder: Path) -> None:
    sample("demo", folder)


def demo(
    folder: str | Path = "labpipe-demo", *, jobs: int = 2, progress: Callable[[Event], None] | None = None
) -> RunResult:
    """Write a synthetic session and process it.

    Parameters
    ----------
    folder : path-like
        Where to; a demonstration that is there already is processed as it is.
    jobs : int
        Experiments processed side by side; 0 processes in this process.
    progress : callable, optional
        Called with every event of the run.

    Returns
    -------
    RunResult
        Its ``reports`` are the pages.

    Raises
    ------
    UsageError
        The folder holds something else.

    Examples
    --------
    >>> demo().reports  # doctest: +SKIP
    """
    record_demo(folder)
    return process(folder, jobs=jobs, progress=progress)
