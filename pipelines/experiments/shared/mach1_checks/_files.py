"""Checks of several files of one tester: none is a copy of another, and none was made while another ran."""

from collections.abc import Mapping
from datetime import datetime, timedelta
from itertools import combinations

import numpy as np
import xarray as xr

from labpipe.judging import Check, not_made, stated
from labpipe.report import quantity
from pipelines.experiments.shared.mach1_checks._parts import Part, parts
from pipelines.experiments.shared.record_checks import Trace, shared_rows

_CLOCKED = 0.1  # s, as for the blocks of one file


def of_files(readings: Mapping[str, xr.Dataset]) -> list[Check]:
    """Hold the files of an experiment, by name, against each other."""
    blocks = {name: found for name, one in readings.items() if (found := parts(one))}
    traces = []
    for name, found in blocks.items():
        lasts = np.concatenate([part.time for part in found])
        force = np.concatenate([part.force for part in found])
        header = "\n".join(line for part in found for line in part.header["info_lines"])
        traces.append(Trace(name, lasts, force, header))
    return [shared_rows(traces), _one_at_a_time(blocks)]


def _one_at_a_time(blocks: Mapping[str, list[Part]]) -> Check:
    name = "times of the tests"
    times = {file: span for file, found in blocks.items() if (span := _span(found)) is not None}
    if len(times) < 2:
        return not_made(name, "two files with start times")
    for (one, (_, end)), (other, (begin, _)) in combinations(sorted(times.items(), key=lambda item: item[1]), 2):
        if (end - begin).total_seconds() > _CLOCKED:
            common = quantity((end - begin).total_seconds(), "s")
            text = f"{other} begins {common} before {one} ends, by the clock of the tester"
            cause = "the start times of one file were edited, or its header was copied from another test"
            return stated(name, text, "doubtful", cause=cause, file=other, line=blocks[other][0].line)
    return stated(name, f"{len(times)} tests one after the other", None)


def _span(blocks: list[Part]) -> tuple[datetime, datetime] | None:
    """Return when a test began and ended; None where its file does not say it."""
    starts = [str(part.header.get("start") or "") for part in (blocks[0], blocks[-1])]
    if not all(starts):
        return None
    first, last = map(datetime.fromisoformat, starts)
    return first, last + timedelta(seconds=float(blocks[-1].time[-1] - blocks[-1].time[0]))
