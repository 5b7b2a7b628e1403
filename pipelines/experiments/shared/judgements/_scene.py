"""The scene of an experiment: its checks, causes and comparison, and the verdicts on those that it rests on."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

from labpipe.judging import Cause, Check
from labpipe.units import Quantity
from pipelines.experiments.shared.comparison_rows import Row
from pipelines.experiments.shared.judgements._page import believed

_OF_NAME = "the specimen is of another material or grade than stated, whose modulus is known by its name alone"
_OF_ANOTHER = "the specimen is of another material than that of {}"


class Basis(NamedTuple):
    """Verdicts on the experiments that one rests on: its material's DMA, its plate, its laser.

    There is one of ``checks`` for each of them. ``is_sound``: none of them is impossible; a result computed from an
    impossible one is no expectation, so that no model is compared with it.
    """

    checks: Sequence[Check] = ()
    is_sound: bool = True

    @property
    def reason(self) -> str:
        """Those that are not believable, "" for none."""
        return "; ".join(check.message for check in self.checks if check.level)

    @classmethod
    def of(cls, results: Iterable[Any]) -> "Basis":
        """Take the judgements of the experiments, or lists of them, where they are."""
        every = (one for found in results for one in (found if isinstance(found, list) else [found]))
        words = {str(one.attrs["experiment"]): believed(one).believable for one in every if one is not None}
        checks = []
        for name, word in words.items():
            is_bad = word in ("doubtful", "impossible")
            text = f"it rests on {name}, which is {word}" if is_bad else f"{name} is believable"
            checks.append(Check(f"input from {name}", text, "note" if is_bad else None, cause=f"see {name} first"))
        return cls(checks, "impossible" not in words.values())


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
