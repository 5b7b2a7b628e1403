"""Explanations of a model that differs: a value that was stated wrongly, or another material."""

from collections.abc import Mapping, Sequence, Set
from math import inf, log
from typing import NamedTuple

import numpy as np

from labpipe.arrays import Floats
from labpipe.judging import (
    DOUBTFUL,
    IMPOSSIBLE,
    SLIPS,
    Cause,
    Check,
    Judgement,
    agreement,
    explain,
    in_words,
    model_verdict,
    suspects,
)
from labpipe.report import quantity
from labpipe.units import Quantity
from pipelines.experiments.shared.comparison_rows import STIFFNESS, Row
from pipelines.experiments.shared.exact_values import usual_uncertainty
from pipelines.experiments.shared.judgements._page import TIED, of_error
from pipelines.experiments.shared.judgements._scene import Scene
from pipelines.experiments.shared.material_choice import is_unstated

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
_BENT = 0.1  # relative, by which effects over such a factor leave a power law
_COUNT, _MOST_COUNTED = "number of ", 20
"""Begin of the name of an input that is counted, and the largest number that is tried for it."""
_SUSPECTS = 2  # inputs that are named where the model differs
_CLOSE = 6.0
"""Difference of chi square within which an input explains as much as the one that explains most."""
_LEAST_OWN = 0.05
"""Least part of a difference's uncertainty that is its own, not shared with other rows: slopes are no better."""
_RELATIVE = 1e-2  # uncertainty assumed of a factor that nobody measured


class Compared(NamedTuple):
    """The comparison of a scene: rows (n), and inputs (m) that could have been stated wrongly.

    ``slopes`` (n, m) are the changes of the differences by each input [SI]; of their ``covariance`` (n, n) ``slack``
    (n,) is the part of the diagonal that allows for uncertain slopes.
    """

    rows: Sequence[Row]
    names: Sequence[str]
    slopes: Floats
    covariance: Floats
    slack: Floats

    @classmethod
    def of(cls, scene: Scene) -> "Compared":
        """Take the rows of a scene whose differences have uncertainties, shared by inputs or their own."""
        rows = [row for row in scene.rows if row.deviation is not None]
        named, known = {name for row in rows for name in row.slopes}, {**scene.inputs, **scene.shared}
        # what nobody states, such as a change of a rheometer's spectrum, could not have been stated wrongly
        names = sorted(name for name in named & set(scene.inputs) if not is_unstated(name))
        every = [*names, *sorted(named & set(known) - set(names))]
        slopes = np.array([[row.slopes.get(name, 0.0) for name in every] for row in rows]).reshape(
            len(rows), len(every)
        )
        parts = slopes * np.array([known[name].u for name in every])
        shared, total = parts @ parts.T, np.array([row.u_difference or 0.0 for row in rows]) ** 2
        own = np.maximum(total - np.diagonal(shared), 0.0)
        least = np.maximum(own, _LEAST_OWN**2 * total)
        return cls(rows, names, slopes[:, : len(names)], shared + np.diag(least), least - own)

    @property
    def differences(self) -> Floats:
        """Measured minus model (n,)."""
        return np.array([row.difference or 0.0 for row in self.rows])


class _Error(NamedTuple):
    """An input, and the error of it that would explain a difference."""

    name: str
    given: Quantity
    size: float

    @property
    def n_u(self) -> float:
        """Size in stated standard uncertainties, or usual ones where none is stated."""
        usual = _RELATIVE * abs(self.given.value) if self.given.si == "1" else usual_uncertainty(self.given)
        return abs(self.size) / (self.given.u or usual or inf)

    @property
    def is_near(self) -> bool:
        """Whether its effect is still known by its slope."""
        return not self.given.value or abs(self.size) <= max(_LINEAR * abs(self.given.value), _FAR * self.given.u)

    @property
    def is_part_of_count(self) -> bool:
        """Whether it is less than half of one of a number of things."""
        return self.name.startswith(_COUNT) and abs(self.size) < 0.5

    @property
    def shown(self) -> str:
        """The error and its direction."""
        by = quantity(abs(self.size), of_error(self.given.si))
        if self.given.si == "1" and self.given.value:
            by = f"{in_words(100 * abs(self.size / self.given.value), 2)} %"
        return f"{by} too {'large' if self.size > 0.0 else 'small'}"


Ranked = list[tuple[float, list[_Error]]]
"""Inputs whose errors look the same, with the share of a difference that they explain, the largest first."""


def undecided_by(inputs: Mapping[str, Quantity], compared: Compared) -> str:
    """Name which values need an uncertainty, where usual ones would explain why a model differs; "" if they do not."""
    names, slopes = compared.names, compared.slopes
    usual = {
        i: usual_uncertainty(given)
        for i, name in enumerate(names)
        if not (given := inputs[name]).u and given.value and not (given.si == "1" and float(given.value).is_integer())
    }

    def differs(some: Sequence[int]) -> bool:
        effects = slopes[:, some] * [usual[i] for i in some]
        found = agreement(compared.differences, compared.covariance + effects @ effects.T)
        return model_verdict(found, could_notice=True) == "differs"

    if not usual or differs(list(usual)):
        return ""
    alone = [i for i in usual if not differs([i])]
    listed = alone or [i for i in usual if np.any(slopes[:, i])]
    shown = ", ".join(f"{names[i]} (± {quantity(usual[i], of_error(inputs[names[i]].si), 1)})" for i in listed)
    joined = "or" if alone and len(alone) > 1 else "and"
    words = f" {joined} ".join(names[i] for i in listed)
    return (
        f"state ± of {words}: counted as exact here; with half a unit of the last digit, {shown}, the model would not "
        "differ"
    )


def explanations(scene: Scene, judged: Judgement, compared: Compared) -> list[str]:
    """Explain why measurement and model differ, the likeliest explanation first.

    Typing errors by a usual factor, other materials and other temperatures come first, by how much of the difference
    they leave; then inputs within ten of their standard uncertainties; last the others. A value that a check has
    confirmed is no suspect.
    """
    names, slopes = compared.names, compared.slopes
    if not names:
        return []
    known = {**scene.inputs, **scene.shared}
    chi2 = agreement(compared.differences, compared.covariance).chi2
    ranked: Ranked = []
    for one in suspects(compared.differences, slopes, compared.covariance):
        row = int(np.argmax(np.abs(slopes[:, one.inputs[0]])))
        effect = one.error * slopes[row, one.inputs[0]]
        alike = [_Error(names[i], known[names[i]], effect / slopes[row, i]) for i in one.inputs if slopes[row, i]]
        ranked.append((one.share, alike))
    sizes = {error.name: error.size for _, alike in ranked for error in alike}
    refuted = {name for name in names if _is_refuted(_Error(name, known[name], sizes.get(name, 0.0)), scene, judged)}
    told = _alternatives(scene, compared, chi2)
    told += [] if scene.unstated else _slipped(scene, compared, ranked, refuted)
    plausible, far = _suspected(ranked, chi2, refuted)
    if not told and not plausible and ranked and ranked[0][0] > _MUCH:
        distant = [error.name for error in ranked[0][1] if not error.is_near]
        if _MODULUS in distant:
            others = " or ".join(name for name in distant if name != _MODULUS)
            told = [f"probably {scene.another_material}{f'; or {others} is stated wrongly' * bool(others)}"]
    return [*told, *plausible, *far][:_SUSPECTS] or [_UNEXPLAINED]


def _alternatives(scene: Scene, compared: Compared, chi2: float) -> list[str]:
    """Name the other material or temperature that explains most of a difference.

    After a temperature that its stated uncertainty excludes, a material that is in no library is named.
    """
    found = [] if scene.alternatives is None else scene.alternatives(compared.rows, compared.covariance)
    known = [each for each in found if np.isfinite(each.differences).all()]
    sizes = [(agreement(each.differences, compared.covariance).chi2, each) for each in known]
    best = sorted((one for one in sizes if one[0] < (1 - _MOST) * chi2), key=lambda one: one[0])
    close = [(size, each) for size, each in best if size < best[0][0] + max(_CLOSE, best[0][0])]
    told = [f"{each.sentence}; {_share(1 - size / chi2)}" for size, each in close]
    return [*told, f"or {scene.another_material}"] if len(close) == 1 and close[0][1].is_far else told


def _share(share: float) -> str:
    return f"that would explain {100 * share:.0f}{TIED}% of it"


def _is_refuted(error: _Error, scene: Scene, judged: Judgement) -> bool:
    """Return whether an error that explains the difference would have failed a check that passed."""
    name, given = error.name, error.given
    if not given.value or not abs(error.size) < abs(given.value):
        held = [c for c in judged.checks if c.is_made and c.setting == name and np.isfinite(c.log_ratio)]
        return bool(held) and not any(c.level for c in held)
    right = log(given.value / (given.value - error.size))
    causes = [c for c in scene.causes if name in (c.setting, c.setting.rpartition(".")[2])]
    passed = [c for c in judged.checks if c.is_made and c.level is None and np.isfinite(c.u_log_ratio)]
    moved = ((abs(cause.effects.get(check.name, 0.0) * right), check) for cause in causes for check in passed)
    return any(by > DOUBTFUL * check.u_log_ratio for by, check in moved)


def _suspected(ranked: Ranked, chi2: float, refuted: Set[str]) -> tuple[list[str], list[str]]:
    """Say by how much each of the likeliest inputs would have to be stated wrongly, and the share that explains.

    Returned are those within ten of their standard uncertainties, and the others, the nearest first.
    """
    plausible: list[str] = []
    others: list[tuple[float, str]] = []
    each = [
        (share, sorted((e for e in alike if not e.is_part_of_count), key=lambda e: e.n_u)) for share, alike in ranked
    ]
    # of those that explain as much the likelier one takes less of its own uncertainty
    close = [(share, errors) for share, errors in each if (ranked[0][0] - share) * chi2 < _CLOSE]
    close.sort(key=lambda one: one[1][0].n_u if one[1] else inf)
    for share, errors in [*close, *each[len(close) :]]:
        near = [error for error in errors if error.is_near and error.name not in refuted]
        if share < _SOME or not near:
            continue
        first, same = near[0], ", ".join(error.name for error in near[1:])
        said = (
            f"{first.name}{f' (or {same})' * bool(same)} stated {first.shown} would explain {100 * share:.0f} % of it"
        )
        if first.n_u > IMPOSSIBLE:
            of_what = "stated" if first.given.u else "usual"
            others.append((first.n_u, f"{said}, but that is {in_words(first.n_u, 2)} times its {of_what} uncertainty"))
        else:
            plausible.append(said)
    return plausible, [said for _, said in sorted(others)]


def _slipped(scene: Scene, compared: Compared, ranked: Ranked, confirmed: Set[str]) -> list[str]:
    """Name which stated value is probably another by a usual factor: a diameter for a radius, a decimal, a unit.

    Contacts follow power laws (Hertz: a duration goes with m^0.4 R^-0.2): logarithms of positive rows are linear in
    those of the inputs over large factors. Where an input that has no uncertainty, such as a modulus that nobody
    measured, would do the same, none is named but by a factor that no grade of a material makes; nor is a value
    that a check of the record has confirmed.
    """
    known, names = scene.inputs, compared.names
    # a relative number has no unit to be typed wrongly, and a temperature no factor; a count is another count
    counts = {name for name in names if name.startswith(_COUNT)}
    typed = {name for name in names if known[name].value > 0.0 and known[name].si not in _NO_SLIP} | counts
    solid = {_MODULUS, STIFFNESS} if scene.measured_by else set()
    certain = {name for name in names if known[name].u or name in solid} | typed
    free = {e.name for _, alike in ranked if not certain.issuperset(o.name for o in alike) for e in alike}
    checks: list[Check] = []
    powers: dict[str, dict[str, float]] = {name: {} for name in names}
    u_differences = np.sqrt(np.diagonal(compared.covariance))
    for row, own, of_inputs in zip(compared.rows, u_differences, compared.slopes, strict=True):
        measured, model = row.measured or 0.0, row.model or 0.0
        if measured * model <= 0.0 or not row.u_difference:
            continue
        place, u = str(len(checks)), float(own) / (measured * model) ** 0.5
        checks.append(Check(place, "", "doubtful", log_ratio=log(measured / model), u_log_ratio=u))
        # a slope is that of what comes from the inputs: where no model is compared, of the measured value
        moved = model if row.against == "model" else measured
        for name, slope in zip(names, of_inputs, strict=True):
            powers[name][place] = float(slope) * known[name].value / moved
    largest = {name: max(map(abs, of.values()), default=0.0) for name, of in powers.items()}
    causes = []
    for name in sorted(typed - confirmed):
        factors = SLIPS[_SLIPS_OF.get(known[name].si, "value")]
        if name in counts:
            factors = tuple(known[name].value / n for n in range(1, _MOST_COUNTED + 1) if n != known[name].value)
        elif free:  # where another input may have any value, a check names what is out of all proportion
            factors = tuple(k for k in factors if abs(log(k)) <= log(_DECIMAL))
        causes.append(Cause(powers[name], str, factors, only_usual=True, bend=_BENT, setting=name))
    if sum((check.log_ratio / check.u_log_ratio) ** 2 for check in checks) < DOUBTFUL**2:
        return []  # rows that differ together alone are off by no such factor
    found = [one for one in explain(checks, causes) if one.share > _MOST]
    close = [one for one in found if one.score < found[0].score + _CLOSE]
    least = min((abs(log(one.factor)) for one in close), default=0.0)
    close = [one for one in close if abs(log(one.factor)) < 1.5 * least]
    if len(close) != 1:
        return []
    (slip,) = close
    name, factor, of_modulus = slip.cause.setting, slip.factor, largest.get(_MODULUS, inf)
    if name in free and largest[name] * abs(log(factor)) < of_modulus * log(_NO_GRADE):
        return []
    right, given = (
        f"{value:.0f}" if name in counts else quantity(value, known[name].si)
        for value in (known[name].value / factor, known[name].value)
    )
    why = ": its diameter was typed" if "radius" in name and factor == _DIAMETER else ""
    said = [f"{name} is probably {right}, not {given}{why}; {_share(slip.share)}"]
    return [*said, f"or {scene.another_material}"] if _MODULUS in names else said
