"""All checks of one Mach-1 file, and how they weigh against each other."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import xarray as xr

from labpipe.judging import Check, not_made
from pipelines.experiments.shared import mach1_traces
from pipelines.experiments.shared.judgements import because
from pipelines.experiments.shared.mach1_checks import _motion, _titles as titles
from pipelines.experiments.shared.mach1_checks._cell import (
    capacity_of_cell,
    response_of_cell,
    saturation,
    sign_of_stiffness,
)
from pipelines.experiments.shared.mach1_checks._parts import parts, trace
from pipelines.experiments.shared.mach1_checks._response import falls
from pipelines.experiments.shared.ramps_and_holds import RELAXATION
from pipelines.experiments.shared.record_checks import Trace, shared_rows

_RIGHT = 1.0  # of that logarithm: no unit is so near to another


def of_file(name: str, readings: xr.Dataset) -> list[Check]:
    """Check one file by itself; where its columns are exchanged nothing else is asked."""
    blocks = parts(readings)
    if not blocks:
        return [not_made(titles.SWAPPED, "columns of position and force")]
    order = _motion.order_of_columns(name, blocks)
    if order.level is not None:
        return [order]
    return [
        order,
        *_motion.commands_kept(name, blocks),
        _motion.clock_of_blocks(name, blocks),
        _motion.direction_of_motion(name, blocks),
        *sign_of_stiffness(name, blocks),
        response_of_cell(name, blocks),
        saturation(name, blocks),
        capacity_of_cell(name, blocks),
        *mach1_traces.checks_of([trace(name, part) for part in blocks]),
        *[falls(name, part) for part in blocks if part.function == RELAXATION],
    ]


def of_files(readings: Mapping[str, xr.Dataset]) -> Check:
    """Look for readings of the force that two files of an experiment share."""
    traces = []
    for name, found in ((name, parts(one)) for name, one in readings.items()):
        time, force = (np.concatenate([getattr(part, of) for part in found] or [[]]) for of in ("time", "force"))
        header = "\n".join(line for part in found for line in part.header["info_lines"])
        traces.append(Trace(name, time, force, header))
    return shared_rows(traces)


def is_swapped(checks: Sequence[Check]) -> bool:
    """Whether the columns of position and force are exchanged."""
    return any(check.name == titles.SWAPPED and check.level is not None for check in checks)


def knows_depth(checks: Sequence[Check]) -> bool:
    """Whether the column of the position tells how deep a punch goes."""
    wrong = (titles.SWAPPED, titles.DIRECTION, titles.TRAVEL)
    return not any(check.name in wrong and check.level is not None for check in checks)


def placed(checks: Sequence[Check], *files: str | None) -> list[Check]:
    """Give failed steps the file and line that their message names, where it is one of `files`."""
    found = []
    for check in checks:
        named = re.search(r"(\S+):(\d+): ", check.message)
        file = next((f for f in files if f and named and Path(f).name == Path(named[1]).name), None)
        found.append(replace(check, file=file, line=int(named[2])) if file and named else check)
    return found


def weighed(checks: Sequence[Check]) -> list[Check]:
    """Weigh the checks of a file against each other.

    A wrong sign is the cause of all that it turns round. A force that is that of the named
    material has the right unit: then the cell can do more than its name says, which is a note.
    """
    sign = next((check for check in checks if check.name == titles.SIGN and check.level is not None), None)
    is_right = any(check.name == titles.RATIO and abs(check.log_ratio) < _RIGHT for check in checks)
    if sign is not None:
        checks = because(checks, sign.cause, titles.FALL, titles.PHASE, line=sign.line)
    unsaid = "the name of the cell does not say its capacity" if is_right else ""
    return because(checks, unsaid, titles.CAPACITY, level="note")
