"""The demonstration, recorded in a process that has loaded the numerical libraries."""

from pathlib import Path

from labpipe.errors import InputError
from labpipe.workflow.engines import Call, Died, elsewhere
from labpipe.workflow.graph import imports_of
from labpipe.workflow.session import FILE_NAME
from pipelines.session import STAGES

DEMO_TITLE = "Demonstration"
_KINDS = ("dma", "ball_drop", "harmonic")
_RECORDING, _COMPILER = "pipelines.rig.samples", "labpipe.compilation"


def holds_demo(folder: str | Path) -> bool:
    """Return whether a folder holds the demonstration: its session.toml says so in its title."""
    source = Path(folder) / FILE_NAME
    return source.is_file() and f'title = "{DEMO_TITLE} (synthetic)"' in source.read_text("utf-8", "replace")


def record_elsewhere(folder: Path) -> None:
    """Record the demonstration in a process of those that will work on it.

    They are forked from one that has loaded the numerical libraries, which this one then need not do.

    Raises
    ------
    InputError
        The process died.
    """
    stages = (stage for kind in _KINDS for stage in STAGES[kind])
    imports = (*imports_of(stages), _RECORDING, _COMPILER)
    try:
        elsewhere(Call(f"{_RECORDING}:write_sample", ("demo", folder), imports=imports))
    except Died as death:
        raise InputError(f"the demonstration was not recorded: {death}; remove {folder} and try again") from None
