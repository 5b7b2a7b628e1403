"""Explanations of a model that differs: a value that was stated wrongly, or another material."""

from collections.abc import Mapping, Sequence, Set
from math import inf, log
from typing import Any

import numpy as np

from labpipe.judging import DOUBTFUL, IMPOSSIBLE, SLIPS, Judgement, agreement, in_words, slips, suspects
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
_MOST, _MUCH, _SOME = 0.8, 0.5, 0.2
"""Shares of a difference that another material, an input alone, and one of several inputs must explain to be named."""
_NO_SLIP, _DIAMETER = ("1", "degC", "K"), 2.0  # units of inputs that have no usual factor, and a radius' one
_SLIPS_OF = {"kg": "mass", "m": "size"}  # which factors are usual, by the unit of an input
_SUSPECTS = 2  # inputs that are named where the model differs
_CLOSE = 6.0
"""Difference of chi square within which an input explains as much as the one that explains most."""
_KNOWN, _RELATIVE = 1e-3, 1e-2
"""Relative uncertainty assumed of an input without a stated one, and of a factor that nobody measured."""

Errors = list[tuple[str, float]]
"""Inputs whose errors look the same, each with the error by which it would explain as much."""


def explanations(
    scene: Scene, judged: Judgement, names: Sequence[str], rows: Sequence[Row], slopes: Any, covariance: Any
) -> list[str]:
    """Explain why measurement and model differ, the likeliest explanation first.

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
    if not names:
        return []
    known = {**scene.inputs, **scene.shared}
    differences = [row.difference or 0.0 for row in rows]
    chi2 = agreement(differences, covariance).chi2
    ranked: list[tuple[float, Errors]] = []
    for one in suspects(differences, slopes, covariance):
        row = int(np.argmax(np.abs(slopes[:, one.inputs[0]])))
        effect = one.error * slopes[row, one.inputs[0]]
        ranked.append((one.share, [(names[i], effect / slopes[row, i]) for i in one.inputs if slopes[row, i]]))
    errors = {name: error for _, alike in ranked for name, error in alike}
    refuted = {name for name in names if _is_refuted(name, errors.get(name, 0.0), known[name], scene, judged)}
    told = [] if scene.unstated else _slipped(scene, names, rows, slopes, covariance, ranked, refuted)
    others = _alternatives(scene, rows, covariance, chi2)
    told = [*told, *others] if told and not others else [*others, *told]
    plausible, far = _suspected(known, ranked, chi2, refuted)
    if not told and not plausible and ranked and ranked[0][0] > _MUCH:
        distant = [name for name, error in ranked[0][1] if not _is_near(known[name], error)]
        if _MODULUS in distant:
            alike = " or ".join(name for name in distant if name != _MODULUS)
            told = [f"probably {scene.another_material}{f'; or {alike} is stated wrongly' * bool(alike)}"]
    return [*told, *plausible, *far][:_SUSPECTS] or [_UNEXPLAINED]


def _alternatives(scene: Scene, rows: Sequence[Row], covariance: Any, chi2: float) -> list[str]:
    """Name the other material or temperature that explains most of a difference.

    After a temperature that its stated uncertainty excludes, a material that is in no library is named.
    """
    found = [] if scene.alternatives is None else scene.alternatives(rows, covariance)
    known = [each for each in found if np.isfinite(each.differences).all()]
    sizes = [(agreement(each.differences, covariance).chi2, each) for each in known]
    best = sorted((one for one in sizes if one[0] < (1 - _MOST) * chi2), key=lambda one: one[0])
    close = [(size, each) for size, each in best if size < best[0][0] + max(_CLOSE, best[0][0])]
    told = [f"{each.sentence}; that would explain {100 * (1 - size / chi2):.0f}{TIED}% of it" for size, each in close]
    return [*told, f"or {scene.another_material}"] if len(close) == 1 and close[0][1].is_far else told


def _is_refuted(name: str, error: float, given: Quantity, scene: Scene, judged: Judgement) -> bool:
    """Return whether an error that explains the difference would have failed a check that passed."""
    if not given.value or not abs(error) < abs(given.value):
        held = [c for c in judged.checks if c.is_made and c.setting == name and np.isfinite(c.log_ratio)]
        return bool(held) and not any(c.level for c in held)
    right = log(given.value / (given.value - error))
    causes = [c for c in scene.causes if name in (c.setting, c.setting.rpartition(".")[2])]
    passed = [c for c in judged.checks if c.is_made and c.level is None and np.isfinite(c.u_log_ratio)]
    return any(
        abs(cause.effects.get(check.name, 0.0) * right) > DOUBTFUL * check.u_log_ratio
        for cause in causes
        for check in passed
    )


def _suspected(
    known: Mapping[str, Quantity], ranked: Sequence[tuple[float, Errors]], chi2: float, refuted: Set[str]
) -> tuple[list[str], list[str]]:
    """Say by how much each of the likeliest inputs would have to be stated wrongly, and the share that explains.

    Returned are those within ten of their standard uncertainties, and the others, the nearest first.
    """

    def far(one: tuple[str, float]) -> float:
        given = known[one[0]]
        share = _RELATIVE if given.si == "1" else _KNOWN
        return abs(one[1]) / (given.u or share * abs(given.value) or inf)

    def is_part_of_count(name: str, error: float) -> bool:
        given = known[name]
        is_count = given.si == "1" and not given.u and given.value > 1.0 and float(given.value).is_integer()
        return is_count and abs(error) < 0.5

    plausible: list[str] = []
    others: list[tuple[float, str]] = []
    each = [(share, sorted((one for one in errors if not is_part_of_count(*one)), key=far)) for share, errors in ranked]
    # of those that explain as much the likelier one takes less of its own uncertainty
    alike = [one for one in each if (ranked[0][0] - one[0]) * chi2 < _CLOSE]
    alike.sort(key=lambda one: far(one[1][0]) if one[1] else inf)
    for share, errors in [*alike, *each[len(alike) :]]:
        near = [(name, e) for name, e in errors if _is_near(known[name], e) and name not in refuted]
        if share < _SOME or not near:
            continue
        (first, error), *_ = near
        same = ", ".join(name for name, _ in near if name != first)
        given, size = known[first], far(near[0])
        way = "too large" if error > 0.0 else "too small"
        by = quantity(abs(error), of_error(given.si))
        if given.si == "1" and given.value:
            by = f"{in_words(100 * abs(error / given.value), 2)} %"
        said = f"{first}{f' (or {same})' * bool(same)} stated {by} {way} would explain {100 * share:.0f} % of it"
        if size > IMPOSSIBLE:
            of_what = "its stated uncertainty" if given.u else "its usual uncertainty"
            others.append((size, f"{said}, but that is {in_words(size, 2)} times {of_what}"))
        else:
            plausible.append(said)
    return plausible, [said for _, said in sorted(others)]


def _is_near(given: Quantity, error: float) -> bool:
    """Return whether the effect of an error is still known by its slope."""
    return not given.value or abs(error) <= max(_LINEAR * abs(given.value), _FAR * given.u)


def _slipped(
    scene: Scene,
    names: Sequence[str],
    rows: Sequence[Row],
    slopes: Any,
    covariance: Any,
    ranked: Sequence[tuple[float, Errors]],
    confirmed: Set[str],
) -> list[str]:
    """Name which stated value is probably another by a usual factor: a diameter for a radius, a decimal, a unit.

    Logarithms of positive rows are linear in those of the inputs over large factors. Where an input that has no
    uncertainty, such as a modulus that nobody measured, would do the same, no slip is named but by a factor that no
    grade of a material makes; nor is a value that a check of the record has confirmed.
    """
    known = scene.inputs
    # a relative number has no unit to be typed wrongly, and a temperature no factor
    typed = {name for name in names if known[name].value > 0.0 and known[name].si not in _NO_SLIP}
    certain = {name for name in names if known[name].u or (scene.measured_by and name == _MODULUS)} | typed
    free = {name for _, errors in ranked if any(n not in certain for n, _ in errors) for name, _ in errors}
    candidates = [i for i, name in enumerate(names) if name in typed and name not in confirmed]
    positive = [j for j, r in enumerate(rows) if (r.measured or 0.0) * (r.model or 0.0) > 0.0 and r.u_difference]
    if not candidates or not positive:
        return []
    measured, model = (np.array([getattr(rows[j], of) for j in positive]) for of in ("measured", "model"))
    # a slope is that of what comes from the inputs: where no model is compared, of the measured value
    moved = np.where([rows[j].against == "model" for j in positive], model, measured)
    powers = slopes[positive] * np.array([known[name].value for name in names]) / moved[:, None]
    mean = np.sqrt(measured * model)
    spread = covariance[np.ix_(positive, positive)] / np.outer(mean, mean)
    of_modulus = float(np.abs(powers[:, names.index(_MODULUS)]).max()) if _MODULUS in names else inf
    said = []
    # where another input may have any value, a check of its own names what is out of all proportion
    factors = [
        [k for k in SLIPS[_SLIPS_OF.get(known[names[i]].si, "value")] if not free or abs(log(k)) <= log(_DECIMAL)]
        for i in candidates
    ]
    for slip in slips(measured, model, powers[:, candidates], spread, factors):
        name = names[candidates[slip.input]]
        effect = float(np.abs(powers[:, candidates[slip.input]]).max()) * abs(log(slip.factor))
        if name in free and effect < of_modulus * log(_NO_GRADE):
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
