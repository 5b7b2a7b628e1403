"""Proposals of ``init``: films not taken from under the disc."""

import re

from pipelines.experiments._kind import Found
from pipelines.experiments.shared import proposals
from pipelines.experiments.shared.record_templates import head, is_exported

_GUESSED = 'a guess: the name tells no view; a film through the disc is of kind "contact_area"'
_NAMED = re.compile(r"front|holder|drop|fall", re.IGNORECASE)


@proposals.of_groups(
    proposals.whole_stem, lambda found, names: [n for n in names if _NAMED.search(n) or not is_exported(found, n)]
)
def proposed(found: Found, files: list[str], name: str) -> str:
    """Propose an experiment for every film; for exported images only where their name says so."""
    why = {} if _NAMED.search(files[0]) else {"why": _GUESSED}
    return f"""{head(found, files[0], "dic_validation", name, **why)}
# laser_experiment = "NAME"  # the ball drop whose laser saw the same motion
# tracking = {{ body = [x, y], body_subset = 101 }}  # px in the first image, on the holder"""
