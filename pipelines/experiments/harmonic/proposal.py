"""Proposals of ``init``: Mach-1 files with oscillations."""

from collections.abc import Iterator, Sequence
from functools import partial

from pipelines.experiments._kind import Found, Proposed
from pipelines.experiments.shared import proposals
from pipelines.experiments.shared.punch_proposal import blocks, tables


def proposed(found: Found, names: Sequence[str]) -> Iterator[Proposed]:
    """Propose an experiment for every file with an oscillation."""
    for stem, files in proposals.grouped(names, proposals.whole_stem):
        if "Sinusoid" in blocks(found.path(files[0])):
            head = f'kind = "harmonic"\nmach1 = "{proposals.quoted(files[0])}"'
            yield Proposed(stem, tuple(files), partial(tables, found, head))
