"""Proposals of ``init``: Mach-1 relaxation files; several depths form one experiment."""

from collections.abc import Iterator, Sequence
from functools import partial

from pipelines.experiments._kind import Found, Proposed
from pipelines.experiments.shared import proposals
from pipelines.experiments.shared.punch_proposal import blocks, tables


def proposed(found: Found, names: Sequence[str]) -> Iterator[Proposed]:
    """Propose an experiment for files with a relaxation and no oscillation after it."""
    relaxing = [n for n in names if blocks(found.path(n)) == {"Stress Relaxation"}]
    for stem, files in proposals.grouped(relaxing, proposals.without_depth):
        listed = proposals.listed(files) if len(files) > 1 else f'["{proposals.quoted(files[0])}"]'
        head = f'kind = "relaxation"\nmach1 = {listed}'
        yield Proposed(stem, tuple(files), partial(tables, found, head))
