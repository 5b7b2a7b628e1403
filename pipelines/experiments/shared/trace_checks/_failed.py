"""What readings tell of a step that failed."""

import re
from collections.abc import Sequence
from dataclasses import replace

from labpipe.judging import Check
from pipelines.experiments.shared.trace_checks._range import OUT_OF_RANGE
from pipelines.experiments.shared.trace_checks._rest import IN_MOTION

_MARKER = re.compile(r"found '(?:-*|\+*|\*+|[+-]?9{4,}[.\d]*|[A-Za-z]+)'")


def explained(failed: Check, of_traces: Sequence[Check], record: str) -> Check:
    """Give a step that failed its place, and the cause that the readings themselves show."""
    failed = placed(failed, record)
    if not failed.is_made or failed.file == record:
        return failed
    worst = [c for c in of_traces if c.file == failed.file and c.level in ("impossible", "doubtful")]
    worst.sort(key=lambda check: check.level != "impossible")
    if worst:
        return replace(failed, cause=worst[0].cause)
    if _MARKER.search(failed.message):
        return replace(failed, cause=OUT_OF_RANGE)
    return replace(failed, cause=IN_MOTION) if "begins in motion" in failed.message else failed


def placed(failed: Check, record: str, recording: str = "") -> Check:
    """Give a step that failed the line that its message names, of its recording or of its calibration record."""
    recording = failed.file or recording
    of_record = rf"{re.escape(record.rpartition('/')[2])}:(\d+): values"
    for file, place in ((record, of_record), (recording, rf"{re.escape(recording)}:(\d+)")):
        if file and failed.is_made and (found := re.search(place, failed.message)) is not None:
            return replace(failed, file=file, line=int(found[1]))
    return failed
