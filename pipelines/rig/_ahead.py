"""The demonstration is recorded, and what it needs compiled, by processes that have all of it loaded."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from labpipe.errors import InputError
from labpipe.workflow.engines import Call, Died, alongside, elsewhere
from labpipe.workflow.graph import imports_of
from labpipe.workflow.session import FILE_NAME
from pipelines.session import STAGES

DEMO_TITLE = "Demonstration (synthetic)"
_KINDS = ("dma", "ball_drop", "harmonic")
_RECORDING, _COMPILER = "pipelines.rig.samples", "labpipe.compiler"


def holds_demo(folder: str | Path) -> bool:
    """Tell whether a folder holds the demonstration: its session.toml says so in its title."""
    source = Path(folder) / FILE_NAME
    return source.is_file() and f'title = "{DEMO_TITLE}"' in source.read_text("utf-8", "replace")


@contextmanager
def ahead(folder: str | Path) -> Iterator[None]:
    """Let another process compile the steps of a drop while the demonstration is recorded and processed in the block.

    At the first time of an installation that takes longer than all else; later there is nothing to do, nor where the
    demonstration is recorded already.
    """
    if holds_demo(folder):
        yield
        return
    with alongside(_call("labpipe.contact:compile_drop")):
        yield


def record_elsewhere(folder: Path) -> None:
    """Record the demonstration in a process of those that will work on it.

    They are forked from one that has loaded the numerical libraries, which this one then need not do.

    Raises
    ------
    InputError
        The process died.
    """
    try:
        elsewhere(_call(f"{_RECORDING}:write_sample", "demo", folder))
    except Died as death:
        raise InputError(f"the demonstration was not recorded: {death}; remove {folder} and try again") from None


def _call(function: str, *arguments: object) -> Call:
    imports = imports_of(stage for kind in _KINDS for stage in STAGES[kind])
    return Call(function, arguments, imports=(*imports, _RECORDING, _COMPILER))
