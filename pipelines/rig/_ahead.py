"""What processing the demonstration needs, loaded and compiled beside its recording."""

from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path

from labpipe.workflow.engines import Call, alongside, get_ready
from labpipe.workflow.runner import imports_of
from pipelines.rig.samples import holds_demo
from pipelines.session import STAGES

_KINDS = ("dma", "ball_drop", "harmonic")


@contextmanager
def ahead(folder: str | Path) -> Iterator[None]:
    """Prepare other processes while the demonstration is recorded and processed in the block.

    They load what its steps need, and at the first time of an installation one compiles the steps
    of a drop, which takes longer than all else. Nothing is prepared where it is recorded already.

    Parameters
    ----------
    folder : path-like
        Where the demonstration is to be.
    """
    if holds_demo(Path(folder)):
        yield
        return
    get_ready(imports_of(stage for kind in _KINDS for stage in STAGES[kind]))
    from labpipe.contact import needs_compiling  # this takes a second to load, what the rig needs too

    compiling = alongside(Call("labpipe.contact:compile_drop", ())) if needs_compiling() else nullcontext()
    with compiling:
        yield
