"""What readings tell of a step that failed."""

import re
from dataclasses import replace

from labpipe.errors import IN_MOTION, MARKER
from labpipe.judging import Check
from pipelines.experiments.shared.trace_checks._range import OUT_OF_RANGE
from pipelines.experiments.shared.trace_checks._rest import MOVES

CAUSES = {MARKER: OUT_OF_RANGE, IN_MOTION: MOVES}
"""What is wrong with a recording, by the reason of the error that a step ends in."""


def placed(failed: Check, record: str, recording: str = "") -> Check:
    """Give a step that failed the line that its message names, of its recording or of its calibration record."""
    recording = failed.file or recording
    of_record = rf"{re.escape(record.rpartition('/')[2])}:(\d+): values"
    for file, place in ((record, of_record), (recording, rf"{re.escape(recording)}:(\d+)")):
        if file and failed.is_made and (found := re.search(place, failed.message)) is not None:
            return replace(failed, file=file, line=int(found[1]))
    return failed
