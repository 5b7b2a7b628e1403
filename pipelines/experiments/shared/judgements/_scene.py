"""What a verdict is made of: the checks of an experiment, its comparison, and the experiments that it rests on."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from labpipe.judging import Cause, Check, stated
from labpipe.units import Quantity
from labpipe.workflow.fields import REFERENCE
from pipelines.experiments.shared.comparison_rows import Row
from pipelines.experiments.shared.judgements._stored import believed

_OF_NAME = "the specimen is of another material or grade than stated, whose modulus is known by its name alone"
_OF_ANOTHER = "the specimen is of another material than that of {}"
_VISIBLE = 0.5  # of the uncertainty of a difference


class Basis(NamedTuple):
    """What is known of the experiments that one rests on: its material's DMA, its plate, its laser.

    There is one of ``checks`` for each of them. ``is_sound``: none on which all rests is impossible; what is computed
    from an impossible one is no expectation, so that nothing is held against it. ``reason`` says what is not
    believable, "" where all is. ``wrong`` are beginnings of the names of inputs that come from an impossible one on
    which little rests.
    """

    checks: Sequence[Check] = ()
    is_sound: bool = True
    reason: str = ""
    wrong: tuple[str, ...] = ()

    @classmethod
    def of(cls, settings: Any, results: Mapping[str, Any], **slight: str) -> "Basis":
        """Take the judgements of the experiments that settings name, where they are.

        ``settings``: of the experiment; ``results``: by the field that names the experiment, as ``rests_on`` of its
        kind lists them; ``**slight``: fields on which a row may rest by little only, each with the beginning of the
        names of the inputs that come from there.
        """
        checks: dict[str, Check] = {}
        reasons, wrong, is_sound = [], [], True
        for field, found in results.items():
            every = found if isinstance(found, list) else [found]
            for reference, result in zip(_ends(settings, field), every, strict=False):
                if reference is None or result is None:
                    continue
                word, name = believed(result).believable, reference.removeprefix(REFERENCE)
                text, cause = f"{name} is believable", ""
                if word in ("doubtful", "impossible"):
                    text = f"it rests on {name}, which is {word}"
                    cause = f"see {name} first"
                    reasons.append(text)
                if word == "impossible" and field in slight:
                    wrong.append(slight[field])
                elif word == "impossible":
                    is_sound = False
                check = stated(f"basis, {name}", text, "note" if cause else None, cause=cause)
                checks[check.name] = check
        return cls(tuple(checks.values()), is_sound, "; ".join(dict.fromkeys(reasons)), tuple(wrong))

    def carries(self, row: Row, inputs: Mapping[str, Quantity]) -> bool:
        """Tell whether a row would change visibly if what comes from an impossible experiment were off by its size."""
        theirs = [name for name in inputs if name.startswith(self.wrong)] if self.wrong else []
        effect = sum(abs(row.slopes.get(name, 0.0) * inputs[name].value) for name in theirs)
        return bool(self.wrong) and (not theirs or effect > _VISIBLE * (row.u_difference or 0.0))


def _ends(settings: Any, dotted: str) -> list[str | None]:
    """Return the experiment that a field names, or one for each item of a list on the way; None for none."""
    if isinstance(settings, list | tuple):
        return [end for item in settings for end in _ends(item, dotted)]
    name, _, rest = dotted.partition(".")
    value = getattr(settings, name, None)
    return _ends(value, rest) if rest else [value]


class Scene(NamedTuple):
    """What the checks of an experiment lead to.

    ``rows`` are those of the comparison, empty where there is no model. ``inputs`` are values and uncertainties of
    what the rows name in their slopes; ``shared`` is what they name there too because they have it in common, but
    nobody states and could have stated wrongly, such as the scatter of another measurement. The checks of ``basis``
    are added to the others. ``unstated`` is what nobody stated and would explain a model that differs; it is told
    first. ``measured_by`` is the experiment or file that knows the modulus of the material, "" where that is known by
    its name alone. ``alternatives`` simulates, for rows and their covariance, other materials and temperatures
    (:mod:`pipelines.experiments.shared.alternatives`).
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

    @property
    def another_material(self) -> str:
        """What is said where another modulus would explain a model that differs."""
        return _OF_ANOTHER.format(self.measured_by) if self.measured_by else _OF_NAME


def measured_by(material: Any) -> str:
    """Return the experiment or file that knows a material as settings choose it; empty for one known by its name."""
    chosen = getattr(material, "material_from", None) or getattr(material, "material_file", None)
    return (chosen or "").removeprefix(REFERENCE)
