"""Proposals of ``init``: one experiment for each rheometer export or table of moduli.

Files of one isotherm each, whose names differ in a temperature only (``pi2k_-30C.osc``), make one.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from functools import partial

import xarray as xr

import instruments
from labpipe.errors import LabpipeError
from labpipe.files import printable
from labpipe.materials import loading_of
from pipelines.experiments._kind import Found, Proposed
from pipelines.experiments.dma.settings import MODES, Sweeps
from pipelines.experiments.shared import proposals
from pipelines.experiments.shared.proposals import GAP

_NEEDED = {"storage_modulus", "frequency"}
_AT = re.compile(r"[_\- ]*(?<![A-Za-z0-9])(?:T=?)?([m+-]?\d+(?:[.p]\d+)?)[_ ]?(°?C|degC|d|K|deg)(?![A-Za-z0-9])")


def proposed(found: Found, names: Sequence[str]) -> Iterator[Proposed]:
    """Propose an experiment for every file that holds moduli over temperature and frequency."""
    tables: dict[str, xr.Dataset] = {}
    for name in names:
        with suppress(LabpipeError):  # of the layout of a table window, or a damaged export
            table = instruments.read(found.path(name))
            if isinstance(table, xr.Dataset) and set(map(str, table.data_vars)) >= _NEEDED:
                tables[name] = table

    def stem(name: str) -> str:
        whole, T = proposals.whole_stem(name), tables[name].get("temperature")
        is_isotherm = T is None or float(T.max() - T.min()) <= 2 * Sweeps().tolerance
        return (_AT.sub("", whole) or whole) if is_isotherm else whole

    yield from proposals.of_groups(stem)(partial(_text, tables))(found, tables)


def _text(tables: Mapping[str, xr.Dataset], _: Found, files: Sequence[str], name: str) -> str:
    """Return the table of an experiment; temperatures that the files do not hold are those of their names."""
    temperature, loadings = "", dict(loading_of(tables[file]) for file in files)
    if any("temperature" not in tables[file] for file in files):
        seen = [_AT.search(proposals.whole_stem(file)) for file in files]
        values = [GAP if m is None or m[2] == "K" else m[1].replace("m", "-").replace("p", ".") for m in seen]
        source = "the file does not say it" if GAP in values else "proposed from the file name"
        quoted = ", ".join(f'"{value} degC"' for value in values)
        temperature = f"\ntemperatures = [{quoted}]  # of each file, in their order; {source}"
        if len(files) == 1:
            temperature = f"\ntemperature = {quoted}  # of the sweep; {source}"
    mode, why = GAP, f"{', '.join(MODES[:-1])} or {MODES[-1]}; the file does not say it"
    if (known := next((m for m in MODES if m in name.lower()), None)) is not None:
        mode, why = known, "proposed from the file name"
    elif len(loadings) == 1 and "" not in loadings:  # more than one where headings of files contradict each other
        ((loading, heading),) = loadings.items()
        mode, other = ("shear", "torsion") if loading == "shear" else ("tension", "bending")
        why = f'or {other}, which converts alike: the file has a column "{printable(heading)}"'
    return f"""[experiments.{name}]
kind = "dma"
rheometer = {proposals.listed(files)}
mode = "{mode}"  # {why}
nu = "{GAP}"  # Poisson's ratio, with ±, e.g. "0.35 ± 0.02"{temperature}
# T_ref = "20 degC"  # of the master curve; by default the middle temperature
# specimen = {{ length = "20 ± 0.1 mm", width = "3 ± 0.01 mm", thickness = "3 ± 0.01 mm" }}  # or diameter"""
