"""Proposals of ``init``: Mach-1 files with oscillations, and with relaxations alone."""

from collections.abc import Iterator, Sequence
from functools import partial

from pipelines.experiments._kind import Found, Proposed
from pipelines.experiments.shared import proposals


def oscillations(found: Found, names: Sequence[str]) -> Iterator[Proposed]:
    """Propose an experiment for every file with an oscillation."""
    ours = [name for name in names if _holds(found, name, "Sinusoid")]
    head = 'kind = "harmonic"\nmach1 = {first}'
    yield from proposals.of_groups(found, ours, proposals.whole_stem, partial(_tables, head))


def relaxations(found: Found, names: Sequence[str]) -> Iterator[Proposed]:
    """Propose an experiment for files with a relaxation and no oscillation; several depths form one."""
    ours = [n for n in names if _holds(found, n, "Stress Relaxation") and not _holds(found, n, "Sinusoid")]
    head = 'kind = "relaxation"\nmach1 = {all}'
    yield from proposals.of_groups(found, ours, proposals.without_depth, partial(_tables, head))


def _holds(found: Found, name: str, block: str) -> bool:
    return f"<{block}>".encode() in found.path(name).read_bytes()


def _tables(head: str, found: Found, files: Sequence[str], name: str) -> str:
    """Return the tables of an experiment that begins with some lines."""
    first = f'"{proposals.quoted(files[0])}"'
    listed = proposals.listed(files) if len(files) > 1 else f"[{first}]"
    record = next(iter(found.of("record:load_cell")), None)
    word = proposals.material_word(name) or "nbr"
    measured = proposals.dma_of(word, found)
    solid = f'material = "{word}"' if measured is None else f'material_from = "{measured}"'
    cell = "" if record is None else f'\n[experiments.{name}.load_cell]\nrecord = "{record}"'
    return f"""[experiments.{name}]
{head.format(first=first, all=listed)}
# For the simulation, state punch and substrate:
# [experiments.{name}.punch]
# radius = "2 mm"      # of a cylindrical tip
# period = "8 mm"      # distance of neighbouring tips
# depth = "6 mm"       # length of one tip
# tips = 3
# [experiments.{name}.substrate]
# {solid}{cell}"""
