"""Proposals of ``init``: films not taken from under the disc."""

import re
from collections.abc import Iterator, Sequence
from functools import partial

from pipelines.experiments._kind import Found, Proposed
from pipelines.experiments.shared import proposals
from pipelines.experiments.shared.record_templates import head, is_exported

_GUESSED = 'a guess: the name tells no view; a film through the disc is of kind "contact_area"'
_NAMED = re.compile(r"front|holder|drop|fall", re.IGNORECASE)


def proposed(found: Found, names: Sequence[str]) -> Iterator[Proposed]:
    """Propose an experiment for every film; for exported images only where their name says so."""
    for stem, files in proposals.grouped(names, proposals.whole_stem):
        if is_exported(found, files[0]) and not _NAMED.search(files[0]):
            continue
        yield Proposed(stem, tuple(files), partial(_text, found, files[0]))


def _text(found: Found, film: str, name: str) -> str:
    why = {} if _NAMED.search(film) else {"why": _GUESSED}
    return f"""{head(found, film, "dic_validation", name, **why)}
# laser_experiment = "NAME"  # the ball drop whose laser saw the same motion
# tracking = {{ body = [x, y], body_subset = 101 }}  # px in the first image, on the holder"""
