"""Proposals of ``init``: Mach-1 files with oscillations, and with relaxations alone."""

from collections.abc import Callable, Iterator, Sequence
from functools import partial

from pipelines.experiments._kind import Found, Proposed
from pipelines.experiments.shared import proposals


def oscillations(found: Found, names: Sequence[str]) -> Iterator[Proposed]:
    """Propose an experiment for every file with an oscillation."""
    yield from _proposed(found, names, "Sinusoid", proposals.whole_stem, 'kind = "harmonic"\nmach1 = {first}')


def relaxations(found: Found, names: Sequence[str]) -> Iterator[Proposed]:
    """Propose an experiment for files with a relaxation and no oscillation; several depths form one."""
    head = 'kind = "relaxation"\nmach1 = {all}'
    yield from _proposed(found, names, "Stress Relaxation", proposals.without_depth, head, without="Sinusoid")


def _proposed(
    found: Found, names: Sequence[str], block: str, stem: Callable[[str], str], head: str, without: str = "\0"
) -> Iterator[Proposed]:
    texts = ((name, found.path(name).read_bytes()) for name in names)
    ours = [name for name, data in texts if f"<{block}>".encode() in data and f"<{without}>".encode() not in data]
    for key, files in proposals.grouped(ours, stem):
        first = f'"{proposals.quoted(files[0])}"'
        listed = proposals.listed(files) if len(files) > 1 else f"[{first}]"
        yield Proposed(key, tuple(files), partial(_tables, found, head.format(first=first, all=listed)))


def _tables(found: Found, head: str, name: str) -> str:
    """Return the tables of an experiment that begins with some lines."""
    record = next(iter(found.of("record:load_cell")), None)
    word = proposals.material_word(name) or "nbr"
    measured = proposals.dma_of(word, found)
    solid = f'material = "{word}"' if measured is None else f'material_from = "{measured}"'
    cell = "" if record is None else f'\n[experiments.{name}.load_cell]\nrecord = "{record}"'
    return f"""[experiments.{name}]
{head}
# For the simulation, state punch and substrate:
# [experiments.{name}.punch]
# radius = "2 mm"      # of a cylindrical tip
# period = "8 mm"      # distance of neighbouring tips
# depth = "6 mm"       # length of one tip
# tips = 3
# [experiments.{name}.substrate]
# {solid}{cell}"""
