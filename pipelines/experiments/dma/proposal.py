"""Proposals of ``init``: one experiment for each rheometer export or table of moduli.

Files of one isotherm each, whose names differ in a temperature only (``pi2k_-30C.osc``), make one.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path

import xarray as xr

import instruments
from labpipe.errors import LabpipeError
from labpipe.files import printable
from labpipe.materials import loading_of
from pipelines.experiments._kind import Found, Proposed
from pipelines.experiments.dma.settings import MODES
from pipelines.experiments.shared import proposals
from pipelines.experiments.shared.proposals import GAP

_NEEDED = {"storage_modulus", "frequency"}
_AT = re.compile(r"[_\- ]*(?<![A-Za-z0-9])(?:T=?)?([m+-]?\d+(?:[.p]\d+)?)[_ ]?(°?C|degC|d|K|deg)(?![A-Za-z0-9])")
_ONE = 3.0  # K: readings of a file within it are one isotherm


def proposed(found: Found, names: Sequence[str]) -> Iterator[Proposed]:
    """Propose an experiment for every file that holds moduli over temperature and frequency."""
    tables = {name: table for name in names if (table := _table(found.path(name))) is not None}

    def stem(name: str) -> str:
        whole = proposals.whole_stem(name)
        return (_AT.sub("", whole) or whole) if _is_isotherm(tables[name]) else whole

    held = [name for name, table in tables.items() if set(map(str, table.data_vars)) >= _NEEDED]
    for key, files in proposals.grouped(held, stem):
        lacks = ["temperature" not in tables[name] for name in files]
        told = dict(loading_of(tables[name]) for name in files)
        yield Proposed(key, tuple(files), partial(_text, found, files, any(lacks), told))


def _is_isotherm(table: xr.Dataset) -> bool:
    """Tell a file of one temperature, stated or not."""
    return "temperature" not in table or float(table["temperature"].max() - table["temperature"].min()) <= _ONE


def _table(path: Path) -> xr.Dataset | None:
    """Return what a file holds; None of the layout of a table window, or a damaged export."""
    try:
        found = instruments.read(path)
    except LabpipeError:
        return None
    return found if isinstance(found, xr.Dataset) else None


def _text(found: Found, files: Sequence[str], lacks_temperature: bool, told: Mapping[str, str], name: str) -> str:
    return f"""[experiments.{name}]
kind = "dma"
rheometer = {proposals.listed(files)}
{mode_line(name, told)}
nu = "{GAP}"  # Poisson's ratio, with ±, e.g. "0.35 ± 0.02"{_temperature(files) if lacks_temperature else ""}
# T_ref = "20 degC"  # of the master curve; by default the middle temperature\
{_published(found, files)}"""


def _temperature(files: Sequence[str]) -> str:
    """Return the line of the temperatures that the files do not hold, from their names where they tell."""
    found = [_AT.search(proposals.whole_stem(name)) for name in files]
    values = [
        GAP if match is None or match[2] == "K" else match[1].replace("m", "-").replace("p", ".") for match in found
    ]
    source = "the file does not say it" if GAP in values else "proposed from the file name"
    if len(files) == 1:
        return f'\ntemperature = "{values[0]} degC"  # of the sweep; {source}'
    quoted = ", ".join(f'"{value} degC"' for value in values)
    return f"\ntemperatures = [{quoted}]  # of each file, in their order; {source}"


def mode_line(name: str, told: Mapping[str, str]) -> str:
    """Return the line of the mode, from the experiment's name where it tells, else from the headings of its columns.

    ``told`` has the heading by loading that it tells (`loading_of`), more than one where files contradict each other.
    """
    known = next((m for m in MODES if m in name.lower()), None)
    if known is not None:
        return f'mode = "{known}"  # proposed from the file name'
    if len(told) == 1 and "" not in told:
        ((loading, heading),) = told.items()
        mode, other = _MODES_OF[loading]
        return f'mode = "{mode}"  # or {other}, which converts alike: the file has a column "{printable(heading)}"'
    return f'mode = "{GAP}"  # {", ".join(MODES[:-1])} or {MODES[-1]}; the file does not say it'


_MODES_OF = {"shear": ("shear", "torsion"), "extensional": ("tension", "bending")}


def _words(name: str) -> set[str]:
    return set(re.findall(r"[a-z]{4,}", Path(name).stem.casefold()))


def _published(found: Found, files: Sequence[str]) -> str:
    """Propose the comparison with a table of shift factors, if there is exactly one of the material.

    The names tell the material; a table that names none is taken only beside a sweep that names
    none, and of several sweeps beside that which shares a word with it.
    """
    word = proposals.material_word(files[0])
    alike = [n for n in found.of("plain_table") if proposals.material_word(n) == word]
    tables = [n for n in alike if (t := _table(found.path(n))) is not None and "log10_aT" in t]
    if len(tables) != 1:
        return ""
    others = {*found.of("sweep")} - {*files, *tables}
    if word is None and others and not _words(tables[0]) & _words(files[0]):
        return ""
    shifts = proposals.quoted(tables[0])
    return f'''
published = {{ shifts = "{shifts}", source = "" }}  # to compare with'''
