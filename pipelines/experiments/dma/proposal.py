"""Proposals of ``init``: one experiment for each rheometer export or table of moduli."""

from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path

import instruments
from labpipe.errors import LabpipeError
from pipelines.experiments._kind import Found, Proposed
from pipelines.experiments.dma.settings import MODES
from pipelines.experiments.shared import proposals
from pipelines.experiments.shared.proposals import GAP

_NEEDED = {"storage_modulus", "temperature", "frequency"}


def proposed(found: Found, names: Sequence[str]) -> Iterator[Proposed]:
    """Propose an experiment for every file that holds moduli over temperature and frequency."""
    for stem, files in proposals.grouped(names, proposals.whole_stem):
        if _columns(found.path(files[0])) >= _NEEDED:
            yield Proposed(stem, tuple(files), partial(_text, found, files))


def _columns(path: Path) -> set[str]:
    """Return what a file holds; nothing of the layout of a table window, or a damaged export."""
    try:
        return set(map(str, getattr(instruments.read(path), "data_vars", ())))
    except LabpipeError:
        return set()


def _text(found: Found, files: Sequence[str], name: str) -> str:
    return f"""[experiments.{name}]
kind = "dma"
rheometer = {proposals.listed(files)}
{mode_line(name)}
nu = "{GAP}"  # Poisson's ratio, e.g. "0.35 ± 0.02"
# T_ref = "20 degC"  # of the master curve; by default the middle temperature\
{_published(found, files[0])}"""


def mode_line(name: str) -> str:
    """Return the line of the mode, from a file's name where it tells."""
    known = next((m for m in MODES if m in name.lower()), None)
    if known is None:
        return f'mode = "{GAP}"  # {", ".join(MODES[:-1])} or {MODES[-1]}; the file does not say it'
    return f'mode = "{known}"  # proposed from the file name'


def _published(found: Found, sweep: str) -> str:
    """Propose the comparison with a table of shift factors, if there is exactly one of the material.

    The names tell the material; a table that names none is taken only beside a sweep that names
    none.
    """
    word = proposals.material_word(sweep)
    alike = [n for n in found.of("plain_table") if proposals.material_word(n) == word]
    tables = [n for n in alike if "log10_aT" in _columns(found.path(n))]
    if len(tables) != 1:
        return ""
    shifts = proposals.quoted(tables[0])
    return f'''
published = {{ shifts = "{shifts}", source = "" }}  # to compare with'''
