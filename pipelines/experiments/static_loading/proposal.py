"""Proposals of ``init``: slowly sampled laser exports are static loadings."""

from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

import instruments
from pipelines.experiments._kind import Found, Proposed
from pipelines.experiments.shared import proposals
from pipelines.experiments.shared.proposals import GAP
from pipelines.experiments.shared.record_templates import laser_record
from pipelines.experiments.static_loading.load_steps import clear_steps


def proposed(found: Found, names: Sequence[str]) -> Iterator[Proposed]:
    """Propose an experiment for slow readings."""
    for stem, files in proposals.grouped(names, proposals.without_repeat):
        if proposals.is_slow(found.path(files[0])):
            yield Proposed(stem, tuple(files), partial(_text, found, files))


def _loads_shown(path: Path) -> int:
    """Count the loads that a record shows: the first, and one for every clear step; 0 where it shows none."""
    read: Any = instruments.read(path)
    if "out1" not in read:
        return 0
    moved = xr.Dataset({"displacement": read["out1"], "valid": np.isfinite(read["out1"])}).assign_coords(time=read.time)
    ups, downs = (clear_steps(moved, sign)[0].size for sign in (1, -1))
    return max(ups, downs) + 1 if max(ups, downs) else 0


def _text(found: Found, files: Sequence[str], name: str) -> str:
    shown = _loads_shown(found.path(files[0]))
    why = f"; the record shows {shown} loads" if shown else ""
    further = f'''

[[experiments.{name}.loads]]  # one such table for each further load
mass = "{GAP} kg"  # all that rests on the disc then, with ±'''
    return f"""[experiments.{name}]
kind = "static_loading"  # proposed because the readings are slow{why}
laser = "{proposals.quoted(files[0])}"
calibration = "{laser_record(found, files[0])}"  # inclination of the sensor, \
with its uncertainty

[experiments.{name}.sphere]
{proposals.SPHERE}
{proposals.material_line(files[0], found)}

[[experiments.{name}.loads]]  # on from the beginning
mass = "{GAP} kg"  # all that rests on the disc, holder included, with ±, e.g. "0.500 ± 0.001 kg"\
{further * max(shown - 1, 1)}
# time = "2.55 min"  # when it was put on; without it the record is searched"""
