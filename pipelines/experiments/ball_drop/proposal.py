"""Proposals of ``init``: other laser exports are repeats of a drop."""

import itertools
import math
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path

from labpipe.files import printable
from pipelines.experiments._kind import Found, Proposed
from pipelines.experiments.shared import proposals
from pipelines.experiments.shared.record_templates import laser_record

_OTHER = 0.1
"""Of a fall: records whose falls differ by more are of other heights, whatever their names have in common."""


def proposed(found: Found, names: Sequence[str]) -> Iterator[Proposed]:
    """Propose an experiment for every group of repeats: of one name, and of one height by the records."""
    for stem, files in proposals.grouped(names, proposals.without_repeat):
        falls = {file: proposals.fall_shown(found.path(file)) for file in files}
        known = sorted((file for file in files if not math.isnan(falls[file])), key=lambda file: falls[file])
        groups = [known[:1]]
        for before, file in itertools.pairwise(known):
            if falls[file] > falls[before] * (1 + _OTHER):
                groups.append([])
            groups[-1].append(file)
        groups.sort(key=len, reverse=True)
        odd = [file for file in files if file not in known]
        groups[0] += odd
        for number, group in enumerate(groups):
            shown, why = falls[group[0]], "laser readings of a fall"
            about = f"about {shown * 1e3:.2g} mm"
            if len(groups) > 1:
                why += f"; of {len(files)} files with this name, those that show {about}"
            why += "".join(f"; no lengths can be read from {Path(file).name}" for file in odd if not number)
            name = f"{stem} {about}" if number else stem  # the largest group keeps the name
            yield Proposed(name, tuple(sorted(group)), partial(_text, found, sorted(group), shown, printable(why)))


def _text(found: Found, files: Sequence[str], shown: float, why: str, name: str) -> str:
    return f"""[experiments.{name}]
kind = "ball_drop"  # {why}
laser = {proposals.listed(files)}
calibration = "{laser_record(found, files[0])}"  # inclination of the sensor, \
with its uncertainty
{proposals.height_line(files[0], shown)}

[experiments.{name}.sphere]
{proposals.SPHERE}
{proposals.MOVING_MASS}
{proposals.material_line(files[0], found)}"""
