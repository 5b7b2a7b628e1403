"""Titles of checks: which compared quantities are one check, and the sentence that explains it."""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import NamedTuple

from labpipe.judging import Check

STEPS = "references and processing steps"
"""Title of the check of all that an experiment is based on."""
REPEATS = "repeats"
"""Title of the check of recordings against each other."""


class Title(NamedTuple):
    """A check of a kind: its sentence, and beginnings of the names of the quantities that belong to it."""

    law: str
    names: tuple[str, ...]


Titles = Mapping[str, Title]

OF_FILM: Titles = {
    "frames": Title(
        "A film holds every frame once, whole, unaltered and in order.",
        (
            "detail of the frames", "times of the frames", "whole film", "frames differ", "order of the frames",
            "sound frames", "frame rate stated",
        ),
    ),
    "light and exposure": Title(
        "The light is steady, and no frame is over- or under-exposed.",
        ("light of the frames", "exposure"),
    ),
}  # fmt: skip
"""Checks of the frames of a film."""

COMMON: Titles = {
    "calibration": Title(
        "The calibration record belongs to the instrument and was valid on the day of the recording.",
        ("day of the recording", "line of sight", "uncertainty of the scale", "date of the cell"),
    ),
    "stated values": Title(
        "Stated values are physically possible, and their uncertainties are small compared with them.",
        ("uncertainty of", "mass of the falling body"),
    ),
    STEPS: Title(
        "Every processing step and every experiment that is referred to gave a valid result.", ("step", "basis")
    ),
}
"""Checks of every kind."""


def entitled(checks: Iterable[Check], titles: Titles) -> list[Check]:
    """Give checks the title under which they are listed.

    Parameters
    ----------
    checks : iterable of Check
    titles : mapping of str to Title
        Of the kind; those of :data:`COMMON` are added.

    Returns
    -------
    list of Check
        A quantity that no title names is a check of its own.
    """
    longest = sorted(((name, title) for title, of in {**COMMON, **titles}.items() for name in of.names), key=_length)
    found = []
    for check in checks:
        title = next((title for name, title in longest if check.name.startswith(name)), check.title)
        # repeats are compared with each other: no recording passes by itself
        recording = "" if title == REPEATS else check.recording or check.file
        found.append(replace(check, title=title, recording=recording))
    return found


def laws(titles: Titles) -> dict[str, str]:
    """Return the sentence of each check of a kind, in the order of its page."""
    return {title: of.law for title, of in {**titles, **COMMON}.items()}


def _length(pair: tuple[str, str]) -> int:
    return -len(pair[0])
