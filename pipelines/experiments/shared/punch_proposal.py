"""Proposals of ``init``: Mach-1 files with oscillations, and with relaxations alone."""

from collections.abc import Callable

from pipelines.experiments._kind import Found
from pipelines.experiments.shared import proposals


def _with(block: str, without: str = "\0") -> Callable[[Found, list[str]], list[str]]:
    """Return a function that selects files with a block and without another."""

    def selected(found: Found, names: list[str]) -> list[str]:
        texts = ((name, found.path(name).read_bytes()) for name in names)
        return [n for n, text in texts if f"<{block}>".encode() in text and f"<{without}>".encode() not in text]

    return selected


@proposals.of_groups(proposals.whole_stem, _with("Sinusoid"))
def oscillations(found: Found, files: list[str], name: str) -> str:
    """Propose an experiment for every file with an oscillation."""
    return _tables(f'kind = "harmonic"\nmach1 = "{proposals.quoted(files[0])}"', found, name)


@proposals.of_groups(proposals.without_depth, _with("Stress Relaxation", without="Sinusoid"))
def relaxations(found: Found, files: list[str], name: str) -> str:
    """Propose an experiment for files with a relaxation and no oscillation; several depths form one."""
    listed = proposals.listed(files) if len(files) > 1 else f'["{proposals.quoted(files[0])}"]'
    return _tables(f'kind = "relaxation"\nmach1 = {listed}', found, name)


def _tables(head: str, found: Found, name: str) -> str:
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
