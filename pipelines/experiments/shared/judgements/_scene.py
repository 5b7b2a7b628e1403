"""The parts of a verdict: the titles of its checks, its checks and comparison, and the experiments it rests on."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

from labpipe.judging import Cause, Check
from labpipe.units import Quantity
from labpipe.workflow.fields import REFERENCE
from pipelines.experiments.shared.comparison_rows import Row
from pipelines.experiments.shared.judgements._page import believed

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
        ("times of the frames", "whole film", "frames differ", "order of the frames"),
    ),
    "light and exposure": Title(
        "No frame is over-exposed, and the exposure is the stated one.",
        ("exposure",),
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
        "Every processing step and every experiment that is referred to gave a valid result.", ("step", "input from")
    ),
}
"""Checks of every kind."""


def entitled(checks: Iterable[Check], titles: Titles) -> list[Check]:
    """Give checks the title under which they are listed, of a kind or of all; others have a title of their own."""
    pairs = ((name, title) for title, of in {**COMMON, **titles}.items() for name in of.names)
    longest = sorted(pairs, key=lambda pair: -len(pair[0]))
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


_OF_NAME = "the specimen is of another material or grade than stated, whose modulus is known by its name alone"
_OF_ANOTHER = "the specimen is of another material than that of {}"


class Basis(NamedTuple):
    """Verdicts on the experiments that one rests on: its material's DMA, its plate, its laser.

    There is one of ``checks`` for each of them. ``is_sound``: none of them is impossible; a result computed from an
    impossible one is no expectation, so that no model is compared with it. ``reason`` names those that are not
    believable, "" for none.
    """

    checks: Sequence[Check] = ()
    is_sound: bool = True
    reason: str = ""

    @classmethod
    def of(cls, results: Iterable[Any]) -> "Basis":
        """Take the judgements of the experiments, or lists of them, where they are."""
        checks: dict[str, Check] = {}
        reasons, is_sound = [], True
        every = (one for found in results for one in (found if isinstance(found, list) else [found]))
        for result in (one for one in every if one is not None):
            word, name = believed(result).believable, str(result.attrs["experiment"])
            text, cause = f"{name} is believable", ""
            if word in ("doubtful", "impossible"):
                text, cause = f"it rests on {name}, which is {word}", f"see {name} first"
                reasons.append(text)
            is_sound &= word != "impossible"
            checks[name] = Check(f"input from {name}", text, "note" if cause else None, cause=cause)
        return cls(tuple(checks.values()), is_sound, "; ".join(dict.fromkeys(reasons)))


class Scene(NamedTuple):
    """Checks, causes and comparison of an experiment.

    ``rows`` are those of the comparison, empty where there is no model. ``inputs`` are values and uncertainties of
    the inputs in their slopes; ``shared`` are those that nobody states and could have stated wrongly, such as the
    scatter of another measurement. The checks of ``basis`` are added to the others. ``unstated`` is an explanation of a
    model that differs by something that nobody states; it comes first. ``measured_by`` is the experiment or file that
    knows the modulus of the material, "" where that is known by its name alone. ``alternatives`` simulates, for rows
    and their covariance, other materials and temperatures
    (:mod:`pipelines.experiments.shared.alternatives`). ``stated`` are all quantities that the settings hold, with their
    places.
    """

    checks: Sequence[Check]
    causes: Sequence[Cause] = ()
    rows: Sequence[Row] = ()
    inputs: Mapping[str, Quantity] = {}
    shared: Mapping[str, Quantity] = {}
    basis: Basis = Basis()
    unstated: str = ""
    measured_by: str = ""
    alternatives: Callable[[Sequence[Row], Any], Sequence[Any]] | None = None
    stated: Sequence[tuple[str, Quantity]] = ()

    def place(self, name: str) -> str:
        """Return the setting that states an input, " (sphere.mass)"; empty where it is not known."""
        same = [place for place, value in self.stated if value == self.inputs[name]]
        named = [place for place in same if place.rpartition(".")[2] in name] or same
        return f" ({named[0]})" if len(named) == 1 else ""

    @property
    def another_material(self) -> str:
        """Sentence where another modulus would explain a model that differs."""
        return _OF_ANOTHER.format(self.measured_by) if self.measured_by else _OF_NAME


def measured_by(material: Any) -> str:
    """Return the experiment or file that knows a material as settings choose it; empty for one known by its name."""
    chosen = getattr(material, "material_from", None) or getattr(material, "material_file", None)
    return (chosen or "").removeprefix(REFERENCE)
