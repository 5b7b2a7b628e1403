"""What would explain a model that differs: a value that was stated wrongly, or another material."""

from collections.abc import Mapping, Sequence, Set
from math import inf, log
from typing import Any, NamedTuple

import numpy as np

from labpipe.judging import DOUBTFUL, IMPOSSIBLE, SLIPS, Judgement, Suspect, agreement, in_words, slips, suspects
from labpipe.report import quantity
from labpipe.units import Quantity
from pipelines.experiments.shared.comparison_rows import Row
from pipelines.experiments.shared.judgements._page import TIED, of_error
from pipelines.experiments.shared.judgements._scene import Scene

_LINEAR, _FAR = 0.3, 20.0
"""Part of an input's value, or times its u, beyond which its effect is no longer known by its slope."""
_UNEXPLAINED = (
    "no input alone explains it: the specimen is probably of another material or in another state than stated, or "
    "the model leaves something out"
)
_DECIMAL = 10.0
_NO_GRADE = 5.0  # between moduli of two grades of one polymer
_MODULUS = "modulus"
"""Input of a material: its u is 0 where it is known by its name alone."""
_TELLS = 0.8  # of a difference, that another modulus must explain to be told as a factor
_MOSTLY = 0.5  # of a difference, that an input must explain where it alone is told
_NO_SLIP, _DIAMETER = ("1", "degC", "K"), 2.0  # units of inputs that have no usual factor, and a radius' one
_SLIPS_OF = {"kg": "mass", "m": "size"}  # what is typed wrongly, by the unit of an input
_SUSPECTS, _EXPLAINS = 2, 0.2  # inputs that are named where the model differs, and the least share that each explains
_CLOSE = 6.0
"""Difference of chi square within which an input explains as much as the one that explains most."""
_KNOWN, _RELATIVE = 1e-3, 1e-2
"""Relative, what counts as the uncertainty of an input without a stated one, and of a factor that nobody measured."""
_HALF = 0.5
"""Of one: a number of things is wrong by that much at least."""


def explanations(
    scene: Scene, judged: Judgement, names: Sequence[str], rows: Sequence[Row], slopes: Any, covariance: Any
) -> list[str]:
    """Say what would explain that measurement and model differ, the likeliest first.

    Typing errors by a usual factor, other materials and other temperatures come first, by how much of the difference
    they leave; then inputs within ten of their standard uncertainties; last the others. A value that a check has
    confirmed is no suspect.

    Parameters
    ----------
    scene : Scene
    judged : Judgement
    names : sequence of str
        Inputs (m) that could have been stated wrongly.
    rows : sequence of Row
        Compared values (n).
    slopes : array (n, m)
        Change of the differences by each input, SI.
    covariance : array (n, n)
        Of the differences.

    Returns
    -------
    list of str
    """
    known = {**scene.inputs, **scene.shared}
    differences = [row.difference or 0.0 for row in rows]
    chi2 = agreement(differences, covariance).chi2
    ranked = suspects(differences, slopes, covariance) if names else []
    refuted = {name for name in names if _is_refuted(name, ranked, names, slopes, known, scene, judged)}
    told: list[str] = []
    if not scene.unstated:
        told = _slipped(scene, names, rows, slopes, covariance, ranked, refuted)
    others = _alternatives(scene, rows, covariance, chi2)
    told = [*told, *others] if told and not others else [*others, *told]
    plausible, far = _suspected(names, known, slopes, ranked, chi2, refuted)
    if not told and not plausible and ranked and ranked[0].share > _MOSTLY and _MODULUS in names:
        by_modulus = [i for i, error in _errors_of(ranked[0], slopes) if not _is_near(known[names[i]], error)]
        if names.index(_MODULUS) in by_modulus:
            alike = " or ".join(names[i] for i in by_modulus if names[i] != _MODULUS)  # looks the same
            told = [f"probably {scene.another_material}{f'; or {alike} is stated wrongly' * bool(alike)}"]
    return [*told, *plausible, *far][:_SUSPECTS] or ([_UNEXPLAINED] if names else [])


def _alternatives(scene: Scene, rows: Sequence[Row], covariance: Any, chi2: float) -> list[str]:
    """Name the other material or temperature that explains most of a difference.

    After a temperature that its stated uncertainty excludes, a material that is in no library is named.
    """
    if scene.alternatives is None:
        return []
    found = scene.alternatives(rows, covariance)
    left = [
        agreement(each.differences, covariance).chi2 if np.isfinite(each.differences).all() else inf for each in found
    ]
    sizes = [(size, each) for size, each in zip(left, found, strict=True) if size < (1 - _TELLS) * chi2]
    best = sorted(sizes, key=lambda one: one[0])
    close = [(size, each) for size, each in best if size < best[0][0] + max(_CLOSE, best[0][0])]
    told = [f"{each.sentence}; that would explain {100 * (1 - size / chi2):.0f}{TIED}% of it" for size, each in close]
    return [*told, f"or {scene.another_material}"] if len(close) == 1 and close[0][1].is_far else told


def _is_refuted(
    name: str,
    ranked: Sequence[Suspect],
    names: Sequence[str],
    slopes: Any,
    known: Mapping[str, Quantity],
    scene: Scene,
    judged: Judgement,
) -> bool:
    """Tell whether an error that explains the difference would have failed a check that passed."""
    error = next((e for one in ranked for i, e in _errors_of(one, slopes) if names[i] == name), 0.0)
    value = known[name].value
    if not value or not abs(error) < abs(value):
        return name in _confirmed(judged)
    right = log(value / (value - error))
    causes = [c for c in scene.causes if name in (c.setting, c.setting.rpartition(".")[2])]
    passed = [c for c in judged.checks if c.is_made and c.level is None and np.isfinite(c.u_log_ratio)]
    return any(
        abs(cause.effects.get(check.name, 0.0) * right) > DOUBTFUL * check.u_log_ratio
        for cause in causes
        for check in passed
    )


def _suspected(
    names: Sequence[str],
    known: Mapping[str, Quantity],
    slopes: Any,
    ranked: Sequence[Suspect],
    chi2: float,
    refuted: Set[str],
) -> tuple[list[str], list[str]]:
    """Say of the likeliest inputs by how much each would have to be stated wrongly, and what that explains.

    Returned are those within ten of their standard uncertainties, and the others, the nearest first.
    """
    plausible: list[str] = []
    far: list[tuple[float, str]] = []
    # what explains as much is the likelier, the less of its own uncertainty it takes
    each = [(suspect.share, _likeliest_first(suspect, names, known, slopes)) for suspect in ranked]
    alike = [one for one in each if (ranked[0].share - one[0]) * chi2 < _CLOSE]
    alike.sort(key=lambda one: _far(known[one[1][0][0]], one[1][0][1]) if one[1] else inf)
    for share, errors in [*alike, *each[len(alike) :]]:
        near = [(name, e) for name, e in errors if _is_near(known[name], e) and name not in refuted]
        if share < _EXPLAINS or not near:
            continue
        (first, error), *_ = near
        alike_ones = [name for name, _ in near if name != first]
        like = f" (or {', '.join(alike_ones)})" if alike_ones else ""
        size, given = _far(known[first], error), known[first]
        said = f"{first}{like} stated {_error_in_words(given, error)} would explain {100 * share:.0f} % of it"
        if size > IMPOSSIBLE:
            of_what = "its stated uncertainty" if given.u else "its usual uncertainty"
            far.append((size, f"{said}, but that is {in_words(size, 2)} times {of_what}"))
        else:
            plausible.append(said)
    return plausible, [said for _, said in sorted(far)]


def _error_in_words(given: Quantity, error: float) -> str:
    way = "too large" if error > 0.0 else "too small"
    if given.si == "1" and given.value:
        return f"{in_words(100 * abs(error / given.value), 2)} % {way}"
    return f"{quantity(abs(error), of_error(given.si))} {way}"


def _likeliest_first(
    suspect: Suspect, names: Sequence[str], known: Mapping[str, Quantity], slopes: Any
) -> list[tuple[str, float]]:
    """Return inputs that look the same, each with its error; of what is counted no part is wrong."""
    errors = [(names[i], error) for i, error in _errors_of(suspect, slopes)]
    whole = [(name, error) for name, error in errors if not (_is_count(known[name]) and abs(error) < _HALF)]
    return sorted(whole, key=lambda one: _far(known[one[0]], one[1]))


def _far(given: Quantity, error: float) -> float:
    """Return an error in uncertainties of its input, or in what stands for one that nobody stated."""
    share = _RELATIVE if given.si == "1" else _KNOWN
    return abs(error) / (given.u or share * abs(given.value) or inf)


def _is_count(given: Quantity) -> bool:
    return given.si == "1" and not given.u and given.value > 1.0 and float(given.value).is_integer()


def _is_near(given: Quantity, error: float) -> bool:
    """Tell whether the effect of an error is still known by its slope."""
    return not given.value or abs(error) <= max(_LINEAR * abs(given.value), _FAR * given.u)


def _errors_of(suspect: Suspect, slopes: Any) -> list[tuple[int, float]]:
    """Return the inputs whose errors look the same, each with the error by which it would explain as much."""
    first = suspect.inputs[0]
    row = int(np.argmax(np.abs(slopes[:, first])))
    return [(i, suspect.error * slopes[row, first] / slopes[row, i]) for i in suspect.inputs if slopes[row, i]]


class _PowerLaws(NamedTuple):
    """Rows above 0, whose logarithms go straight with those of the inputs over large factors."""

    measured: Any
    model: Any
    powers: Any
    spread: Any

    @classmethod
    def of(
        cls, names: Sequence[str], known: Mapping[str, Quantity], rows: Sequence[Row], slopes: Any, covariance: Any
    ) -> "_PowerLaws":
        ratios = [(row.measured or 0.0) * (row.model or 0.0) for row in rows]
        straight = [j for j, product in enumerate(ratios) if product > 0.0 and rows[j].u_difference]
        mean = np.sqrt([ratios[j] for j in straight])
        values = np.array([known[name].value for name in names])
        measured, model = (np.array([getattr(rows[j], of) for j in straight]) for of in ("measured", "model"))
        # a slope is that of what comes from the inputs: beside something else than a model the measured value does
        moved = np.where([rows[j].against == "model" for j in straight], model, measured)
        return cls(
            measured,
            model,
            slopes[straight] * values / moved[:, None],
            covariance[np.ix_(straight, straight)] / np.outer(mean, mean),
        )


def _slipped(
    scene: Scene,
    names: Sequence[str],
    rows: Sequence[Row],
    slopes: Any,
    covariance: Any,
    ranked: Sequence[Suspect],
    confirmed: Set[str],
) -> list[str]:
    """Say which stated value is probably another by a usual factor: a diameter for a radius, a decimal, a unit.

    Where an input that has no uncertainty, such as a modulus that nobody measured, would do the same,
    none is but by a factor that no grade of a material makes; nor is a value that a check of the
    record has confirmed.
    """
    known = scene.inputs
    # what is relative has no unit to be typed wrongly, and a temperature no factor
    typed = [known[name].value > 0.0 and known[name].si not in _NO_SLIP for name in names]
    certain = {
        j for j, name in enumerate(names) if typed[j] or known[name].u or (scene.measured_by and name == _MODULUS)
    }
    free = {i for suspect in ranked if not certain.issuperset(suspect.inputs) for i in suspect.inputs}
    stated_ones = [i for i, name in enumerate(names) if typed[i] and name not in confirmed]
    laws = _PowerLaws.of(names, known, rows, slopes, covariance)
    if not stated_ones or not laws.measured.size:
        return []
    powers = laws.powers[:, stated_ones]
    of_modulus = laws.powers[:, names.index(_MODULUS)] if _MODULUS in names else np.full(1, inf)
    of_grades = float(np.abs(of_modulus).max()) * log(_NO_GRADE)
    said = []
    # beside what may have any value, what is out of all proportion is told by a check of its own
    factors = [
        [k for k in SLIPS[_SLIPS_OF.get(known[names[i]].si, "value")] if not free or abs(log(k)) <= log(_DECIMAL)]
        for i in stated_ones
    ]
    for slip in slips(laws.measured, laws.model, powers, laws.spread, factors):
        name = names[stated_ones[slip.input]]
        effect = float(np.abs(powers[:, slip.input]).max()) * abs(log(slip.factor))
        if stated_ones[slip.input] in free and effect < of_grades:
            return []
        given = known[name]
        why = ": its diameter was typed" if "radius" in name and slip.factor == _DIAMETER else ""
        said.append(
            f"{name} is probably {quantity(given.value / slip.factor, given.si)}, not {quantity(given.value, given.si)}"
            f"{why}; that would explain {100 * slip.share:.0f}{TIED}% of it"
        )
    if len(said) != 1:
        return []
    return [*said, f"or {scene.another_material}"] if _MODULUS in names else said


def _confirmed(judged: Judgement) -> Set[str]:
    """Return the settings that a check has held against the record and found right."""
    made = [c for c in judged.checks if c.is_made and c.setting and np.isfinite(c.log_ratio)]
    return {c.setting for c in made} - {c.setting for c in made if c.level}
