"""Whether the measurements of two materials were exchanged, by what rests on each."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations
from math import exp, log
from statistics import median
from typing import TYPE_CHECKING, Any

from labpipe.workflow.fields import REFERENCE, every_setting

if TYPE_CHECKING:
    from labpipe.judging import Finding
    from labpipe.workflow.session import Session

_OTHER = log(1.3)  # of a modulus, from which on it is another one
_INVERSE = 0.5  # of its logarithm, by which one factor may miss the inverse of the other


def exchanged(session: Session, stiffness: Mapping[str, float | None]) -> Iterator[tuple[str, Finding]]:
    """Find two materials of which one is as many times too stiff for its experiments as the other is too soft.

    ``stiffness`` says by experiment how many times the modulus of its material would explain it, where one does.
    """
    from labpipe.judging import Finding, in_words

    found: dict[str, dict[str, float]] = {}
    for name, factor in stiffness.items():
        source = _source(session.experiments[name].settings)
        if factor and source in session.experiments:
            found.setdefault(source, {})[name] = log(factor)
    means = {source: median(own.values()) for source, own in found.items()}
    for first, second in combinations(means, 2):
        a, b = means[first], means[second]
        if a * b > 0.0 or min(abs(a), abs(b)) < _OTHER or abs(a + b) > _INVERSE * max(abs(a), abs(b)):
            continue
        text = "; ".join(
            f"{_listed(list(found[of]))} would need {in_words(exp(size), 2)} times the modulus of {of}"
            for of, size in ((first, a), (second, b))
        )
        cause = f"the exports of {first} and {second} were probably exchanged (rheometer in session.toml, or the files)"
        for owner in (first, second):
            yield owner, Finding("exchanged materials", "doubtful", text, cause, setting="rheometer")


def _source(settings: Any) -> str:
    """Return the experiment that measured the material of settings or of a table in them; empty for none."""
    found = (getattr(table, "material_from", None) for place, table, _ in every_setting(settings) if "[" not in place)
    return next(filter(None, found), "").removeprefix(REFERENCE)


def _listed(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f"{names[0]} and {len(names) - 1} more"
