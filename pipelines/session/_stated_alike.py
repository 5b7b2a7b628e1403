"""What experiments of a session state of one thing: a body that falls in several, the plate under them.

Two values of one thing are a mistake in one of them; where several experiments agree, in the other.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from math import hypot, inf, log
from typing import TYPE_CHECKING, Any

from labpipe.units import Quantity
from labpipe.workflow.fields import every_setting
from labpipe.workflow.session import Experiment, Session
from pipelines.experiments.shared.exact_values import exact_values

if TYPE_CHECKING:
    from labpipe.judging import Finding, Level

_APART = 4.0  # standard uncertainties between two masses or radii of one body
_ALIKE = 2.0  # standard uncertainties within which two values are one
TWO_VALUES = "one body, two values"
_LEAST = 1e-4  # relative uncertainty of a value that is stated without one
_SLIP = 0.01  # how near to a power of ten, or to two, a ratio must be to be that


@dataclass(frozen=True, slots=True)
class _Body:
    """A body whose radius and mass an experiment states, such as the sphere; one for drops of several materials."""

    experiment: Experiment
    setting: str
    materials: frozenset[str]
    radius: Quantity
    mass: Quantity


def finding(check: str, level: Level, text: str, cause: str = "", file: str = "", setting: str = "") -> Finding:
    from labpipe.judging import Finding

    return Finding(check, level, text, cause, file, None, setting)


def bodies(session: Session) -> Iterator[tuple[str, Finding]]:
    """Hold the masses and radii of one body against each other."""
    found = [body for e in session.experiments.values() for body in _found_bodies(e)]
    said: set[tuple[str, str]] = set()
    for first, later in combinations(found, 2):
        if first.materials.isdisjoint(later.materials) or first.experiment is later.experiment:
            continue
        mass, radius = _distance(first.mass, later.mass), _distance(first.radius, later.radius)
        if radius <= _ALIKE and mass > _APART:
            odd, other, name = _odd(found, first, later, "mass")
        elif mass <= _ALIKE < radius and _mistyped(first.radius, later.radius):
            odd, other, name = _odd(found, first, later, "radius")
        else:
            continue
        if (odd.experiment.name, name) not in said:
            said.add((odd.experiment.name, name))
            yield odd.experiment.name, _two_values(odd, other, name)


def _found_bodies(experiment: Experiment) -> Iterator[_Body]:
    for place, table, _ in every_setting(experiment.settings):
        radius, mass = getattr(table, "radius", None), getattr(table, "mass", None)
        if isinstance(radius, Quantity) and isinstance(mass, Quantity):
            # a body without a material of its own falls on, or with, each of the others of its experiment
            sources = frozenset(_sources(table)) or frozenset(_sources(experiment.settings))
            yield _Body(experiment, place, sources, radius, mass)


def _sources(settings: Any) -> Iterator[str]:
    """Yield what a table, and all in it, says of materials: names, files and experiments; the most exact of each."""
    for _, table, _ in every_setting(settings):
        given = [getattr(table, name, None) for name in ("material_from", "material_file", "material")]
        yield from [source for source in given if isinstance(source, str)][:1]


def _distance(a: Quantity, b: Quantity) -> float:
    """Return how far two stated values are apart, in standard uncertainties."""
    u = hypot(a.u or _LEAST * a.value, b.u or _LEAST * b.value)
    return abs(a.value - b.value) / u if u else inf


def _odd(bodies: Sequence[_Body], first: _Body, later: _Body, name: str) -> tuple[_Body, _Body, str]:
    """Return which of two bodies stands alone among all of its materials, the other, the name."""

    def votes(body: _Body) -> int:
        value = getattr(body, name)
        alike = [
            _distance(getattr(b, name), value) <= _ALIKE for b in bodies if not b.materials.isdisjoint(body.materials)
        ]
        return 2 * sum(alike) - len(alike)  # one that is of several materials is contradicted by more bodies

    return (first, later, name) if votes(first) < votes(later) else (later, first, name)


def _two_values(odd: _Body, other: _Body, name: str) -> Finding:
    value, expected = getattr(odd, name), getattr(other, name)
    same = "radius" if name == "mass" else "mass"
    text = (
        f"{name} is {written(value)} here and {written(expected)} in {other.experiment.name}, "
        f"for bodies of one {same} and material"
    )
    factor = _slip(value.value / expected.value)
    cause = f"the {name} of this sphere is mistyped, or another one was used: then say so"
    if name == "radius" and factor == 2.0:
        cause = f"the radius is probably {written(expected)}: its diameter was typed"
    elif factor:
        cause = f"the {name} is probably {written(expected)}, a factor {factor:g}: its unit or decimal point is wrong"
    elif _mistyped(value, expected):
        cause = f"the {name} is probably {written(expected)}: two digits were exchanged"
    return finding(TWO_VALUES, "doubtful", text, cause, setting=f"{odd.setting}.{name}")


def written(value: Quantity, number: float | None = None) -> str:
    from labpipe.report import quantity

    return quantity(value.value if number is None else number, value.si, 4)


def _slip(ratio: float) -> float:
    """Return the usual factor that a ratio is, or its inverse; 0 for none of them."""
    from labpipe.judging import SLIPS

    factors = (f for f in SLIPS["value"] if f > 1 and ratio > 0 and abs(abs(log(ratio)) - log(f)) < _SLIP)
    return next(factors, 0.0)


def _mistyped(a: Quantity, b: Quantity) -> bool:
    """Whether one value is the other by a usual factor, or with two digits exchanged; other sizes are not so."""
    one, other = written(a), written(b)
    differ = [i for i, (x, y) in enumerate(zip(one, other, strict=False)) if x != y]
    return bool(_slip(b.value / a.value)) or (len(differ) == 2 and sorted(one) == sorted(other))


def plates(session: Session) -> Iterator[tuple[str, Finding]]:
    """Hold what is stated of the plate under one experiment against what most of the others state."""
    stated = [(e, plate) for e in session.experiments.values() if (plate := getattr(e.settings, "plate", None))]
    for name in ("mass", "frequency", "damping_ratio"):
        values = [(e, value) for e, plate in stated if isinstance(value := getattr(plate, name, None), Quantity)]
        for experiment, value in values:
            others = [other for e, other in values if e is not experiment]
            usual = next((o for o in others if 2 * sum(_distance(o, x) <= _ALIKE for x in others) > len(others)), None)
            # experiments may stand on two plates; no two differ by a slip of typing
            if len(others) < 2 or usual is None or _distance(value, usual) <= _APART or not _mistyped(value, usual):
                continue
            word = name.replace("_", " ")
            text = f"the plate's {word} is {written(value)} here and {written(usual)} in the other experiments"
            cause = f"the {word} is probably {written(usual)}: its unit or decimal point is wrong, or two digits were "
            cause += "exchanged; or the plate is another one"
            yield experiment.name, finding("one plate, two values", "doubtful", text, cause, setting=f"plate.{name}")


def stated_as_exact(session: Session) -> dict[str, list[str]]:
    """Return the experiments that state the same values without an uncertainty, by the names of these values."""
    found: dict[str, list[str]] = {}
    for e in session.experiments.values():
        if names := exact_values(e.settings):
            found.setdefault(", ".join(names), []).append(e.name)
    return found
