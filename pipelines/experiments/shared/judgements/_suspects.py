"""Explanations of a model that differs: a value that was stated wrongly, or another material."""

from collections.abc import Mapping, Sequence, Set
from math import exp, inf, isclose, log
from typing import NamedTuple

import numpy as np
from scipy.special import chdtri

from labpipe.arrays import Floats
from labpipe.judging import (
    DOUBTFUL,
    IMPOSSIBLE,
    LIKELY,
    SLIPS,
    Judgement,
    agreement,
    fitted_errors,
    in_words,
    model_verdict,
)
from labpipe.report import difference_unit, quantity
from labpipe.units import Quantity
from pipelines.experiments.shared.comparison_rows import STIFFNESS, Row
from pipelines.experiments.shared.exact_values import usual_uncertainty
from pipelines.experiments.shared.judgements._page import TIED, chance
from pipelines.experiments.shared.judgements._scene import Scene
from pipelines.experiments.shared.material_choice import is_unstated

_UNEXPLAINED = (
    "no input alone explains it: the specimen is probably of another material or in another state than stated, or "
    "the model leaves something out"
)
_LINEAR, _BENT = 0.3, 0.1
"""Part of an input's value beyond which its effect is not known by its slope, and by which powers fail over a factor"""
_NO_GRADE = 5.0
"""Factor beyond those between moduli of two grades of one polymer, and over which effects keep their power law."""
_MOST = 0.8
"""Share of a difference that another material or one input alone must explain to be named; of several, the rest."""
_MODULUS, _COUNT = "modulus", "number of "
"""Input of a material, whose u is 0 where it is known by its name, and begin of the name of one that is counted."""
_MOST_COUNTED = 20
_NO_SLIP = ("1", "degC", "K")  # units of inputs that have no usual factor
_SLIPS_OF = {"kg": "mass", "m": "size"}  # which factors are usual, by the unit of an input
_CLOSE = float(chdtri(2, LIKELY))
"""Difference of chi square within which two explanations cannot be distinguished."""


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
    def of(cls, scene: Scene, own_part: float = 0.05) -> "Compared":
        """Take the rows of a scene whose differences have uncertainties, shared by inputs or their own.

        At least a part of each is its own, not shared with other rows: slopes are no better.
        """
        rows = [row for row in scene.rows if row.deviation is not None]
        named, known = {name for row in rows for name in row.slopes}, {**scene.inputs, **scene.shared}
        # what nobody states, such as a change of a rheometer's spectrum, could not have been stated wrongly
        names = sorted(name for name in named & set(scene.inputs) if not is_unstated(name))
        every = [*names, *sorted(named & set(known) - set(names))]
        slopes = np.reshape([[r.slopes.get(name, 0.0) for name in every] for r in rows], (len(rows), len(every)))
        parts = slopes * np.array([known[name].u for name in every])
        shared, total = parts @ parts.T, np.array([row.u_difference or 0.0 for row in rows]) ** 2
        own = np.maximum(total - np.diagonal(shared), 0.0)
        least = np.maximum(own, own_part**2 * total)
        return cls(rows, names, slopes[:, : len(names)], shared + np.diag(least), least - own)

    @property
    def differences(self) -> Floats:
        """Measured minus model (n,)."""
        return np.array([row.difference or 0.0 for row in self.rows])

    def in_logarithms(self, inputs: Mapping[str, Quantity]) -> tuple[Floats, Floats, Floats]:
        """Return logarithms of measured over model (k,) of positive rows, powers of the inputs (k, m), and covariance.

        Contacts follow power laws (Hertz: a duration goes with m^0.4 R^-0.2), so that these logarithms are linear in
        those of the inputs over large factors.
        """
        pairs = [(row.measured or 0.0, row.model or 0.0) for row in self.rows]
        kept = [i for i, (measured, model) in enumerate(pairs) if measured * model > 0.0]
        measured, model = np.array(pairs)[kept].reshape(-1, 2).T
        scale = np.sqrt(measured * model)
        # a slope is that of what comes from the inputs: where no model is compared, of the measured value
        moved = np.where([self.rows[i].against == "model" for i in kept], model, measured)
        powers = self.slopes[kept] * np.array([inputs[name].value for name in self.names]) / moved[:, None]
        return np.log(measured / model), powers, self.covariance[np.ix_(kept, kept)] / np.outer(scale, scale)


class _Error(NamedTuple):
    """An input, the error of it that would explain a difference, the share that it explains, and its setting."""

    name: str
    given: Quantity
    size: float
    share: float
    place: str = ""

    @property
    def n_u(self) -> float:
        """Size in stated standard uncertainties, or usual ones where none is stated."""
        usual = 0.01 * abs(self.given.value) if self.given.si == "1" else usual_uncertainty(self.given)
        return abs(self.size) / (self.given.u or usual or inf)

    @property
    def is_excluded(self) -> bool:
        """Whether its stated uncertainty excludes it."""
        return self.n_u > IMPOSSIBLE

    @property
    def is_near(self) -> bool:
        """Whether its effect is still known by its slope, and a count is wrong by one at least."""
        if self.name.startswith(_COUNT) and abs(self.size) < 0.5:
            return False
        reach = max(_LINEAR * abs(self.given.value), 2 * IMPOSSIBLE * self.given.u)
        return not self.given.value or abs(self.size) <= reach

    def is_refuted(self, scene: Scene, judged: Judgement) -> bool:
        """Return whether it would have failed a check that passed."""
        name, given = self.name, self.given
        if not given.value or not abs(self.size) < abs(given.value):
            held = [c for c in judged.checks if c.is_made and c.setting == name and np.isfinite(c.log_ratio)]
            return bool(held) and not any(c.level for c in held)
        right = log(given.value / (given.value - self.size))
        causes = [c for c in scene.causes if name in (c.setting, c.setting.rpartition(".")[2])]
        passed = [c for c in judged.checks if c.is_made and c.level is None and np.isfinite(c.u_log_ratio)]
        moved = ((abs(cause.effects.get(check.name, 0.0) * right), check) for cause in causes for check in passed)
        return any(by > DOUBTFUL * check.u_log_ratio for by, check in moved)

    def sentence(self, alike: "Sequence[_Error]" = ()) -> str:
        """Say by how much the input would have to be stated wrongly; others that are ``alike`` explain as much."""
        others = f" (or {', '.join(other.name for other in alike)})" * bool(alike)
        by, u = quantity(abs(self.size), difference_unit(self.given.si)), "stated" if self.given.u else "usual"
        if self.given.si == "1" and self.given.value:
            by = f"{in_words(100 * abs(self.size / self.given.value), 2)} %"
        said = f"{self.name}{others} stated {by} too {'large' if self.size > 0.0 else 'small'} would explain "
        said += f"{100 * self.share:.0f} % of it"
        far = f", but that is {in_words(self.n_u, 2)} times its {u} uncertainty"
        return said + far * self.is_excluded + self.place


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
    shown = ", ".join(f"{names[i]} (± {quantity(usual[i], difference_unit(inputs[names[i]].si), 1)})" for i in listed)
    joined = "or" if alone and len(alone) > 1 else "and"
    words = f" {joined} ".join(names[i] for i in listed)
    return (
        f"state ± of {words}: counted as exact here; with half a unit of the last digit, {shown}, the model would not "
        "differ"
    )


def curve_differs(row: Row) -> str:
    """Say which curve differs where all single values agree."""
    condition, off = f" ({row.condition})" * bool(row.condition), f", by {row.texts[2]} on average" * bool(row.texts[2])
    return (
        f"{row.quantity}{condition} differs along its curve{off} ({chance(row.p or 0.0)}), while the single "
        "values agree: a step, a drift or another zero within that recording"
    )


def explanations(scene: Scene, judged: Judgement, compared: Compared, most: int = 2) -> tuple[list[str], bool]:
    """Explain why measurement and model differ, the likeliest explanation first; and return whether that is plausible.

    The one recording that differs where no input explains all, other materials, other temperatures and typing errors
    by a usual factor come first; then inputs within ten of their standard uncertainties, which is plausible as well;
    then values that are wrong by any factor; last the others. A value that a check has confirmed is no suspect.
    """
    names, chi2 = compared.names, agreement(compared.differences, compared.covariance).chi2
    if not names or not chi2:
        return [], False
    fitted = np.array(fitted_errors(compared.differences, compared.slopes, compared.covariance)).T.tolist()
    errors = [
        _Error(name, scene.inputs[name], size, share, scene.place(name))
        for name, (size, share) in zip(names, fitted, strict=True)
    ]
    best = max(errors, key=lambda error: error.share)
    close = [error for error in errors if (best.share - error.share) * chi2 < _CLOSE]
    refuted = {error.name for error in errors if error.is_refuted(scene, judged)}
    near = [e for e in errors if e.share >= 1.0 - _MOST and e.is_near and e.name not in refuted]
    is_one_input = any(error.share >= _MOST and not error.is_excluded for error in near)
    told = _trials(scene, compared, chi2, is_one_input)
    typed, about = _by_a_factor(scene, compared, {error.name for error in close}, refuted)
    told += [] if scene.unstated else typed
    # of those that explain as much the likelier one takes less of its own uncertainty
    near.sort(key=lambda error: (error.is_excluded, error not in close, error.n_u))
    distant = [error.name for error in close if not error.is_near]
    if not told and best.share > 0.5 and _MODULUS in distant and all(e.is_excluded for e in near):
        others = " or ".join(name for name in distant if name != _MODULUS)
        told = [f"probably {scene.another_material}{f'; or {others} is stated wrongly' * bool(others)}"]
    is_plausible = bool(told) or any(not error.is_excluded for error in near)
    told = told if told or near else about
    while near:
        first, *rest = near
        alike = [e for e in rest if abs(e.share - first.share) * chi2 < _CLOSE and e.is_excluded == first.is_excluded]
        told.append(first.sentence(alike))
        near = [error for error in rest if error not in alike]
    return told[:most] or [_UNEXPLAINED], is_plausible


def _trials(scene: Scene, compared: Compared, chi2: float, is_one_input: bool) -> list[str]:
    """Name the one recording without which the model would not differ, and another material or temperature.

    The first where no input explains all and there are three recordings or more. After a temperature that its stated
    uncertainty excludes, a material that is in no library is named.
    """
    conditions, alone = np.array([row.condition for row in compared.rows]), list[str]()
    named = dict.fromkeys(conditions.tolist())
    for name in named if len(named) > 2 and not is_one_input else ():
        kept = conditions != name
        left = agreement(compared.differences[kept], compared.covariance[np.ix_(kept, kept)])
        alone += [name] if model_verdict(left, could_notice=True) != "differs" else []
    said = "only {} differs: that recording is of another test, or its gain or zero is wrong"
    told = [said.format(name) for name in alone] if len(alone) == 1 else []
    found = [] if scene.alternatives is None else scene.alternatives(compared.rows, compared.covariance)
    known = [each for each in found if np.isfinite(each.differences).all()]
    sizes = [(agreement(each.differences, compared.covariance).chi2, each) for each in known]
    best = sorted((one for one in sizes if one[0] < (1 - _MOST) * chi2), key=lambda one: one[0])
    close = [(size, each) for size, each in best if size < best[0][0] + max(_CLOSE, best[0][0])]
    told += [f"{each.sentence}; {_share(1 - size / chi2)}" for size, each in close]
    return [*told, f"or {scene.another_material}"] if len(close) == 1 and close[0][1].is_excluded else told


def _share(share: float) -> str:
    return f"that would explain {100 * share:.0f}{TIED}% of it"


def _by_a_factor(scene: Scene, compared: Compared, close: Set[str], refuted: Set[str]) -> tuple[list[str], list[str]]:
    """Name the stated value that is probably another by a usual factor, a diameter for a radius or a unit; or by any.

    Where an input that has no uncertainty, such as a modulus that nobody measured, would do the same, none is named but
    by a factor that no grade of a material makes; nor is a value that a check of the record has confirmed.
    """
    inputs, names = scene.inputs, compared.names
    ratio, powers, covariance = compared.in_logarithms(inputs)
    if not ratio.size:
        return [], []
    fitted = dict(zip(names, np.array(fitted_errors(ratio, powers, covariance)).T.tolist(), strict=True))
    (name, (size, share)), *others = sorted(fitted.items(), key=lambda one: -one[1][1])
    given, chi2 = inputs[name], agreement(ratio, covariance).chi2
    is_alone = share >= _MOST and all((share - other) * chi2 > _CLOSE for _, (_, other) in others)
    about = list[str]()
    if is_alone and name not in refuted and given.si not in _NO_SLIP and abs(size) <= log(_NO_GRADE):
        right = quantity(given.value / exp(size), given.si, 2)
        said = f"{name} is probably about {right}, not {quantity(given.value, given.si)}; {_share(share)}"
        about = [said + scene.place(name)]
    if np.sum(ratio**2 / np.diagonal(covariance)) < DOUBTFUL**2:
        return [], about  # rows that differ together alone are off by no such factor
    # a relative number has no unit to be typed wrongly, and a temperature no factor; a count is another count
    counts = {name for name in names if name.startswith(_COUNT)}
    typed = {name for name in names if inputs[name].value > 0.0 and inputs[name].si not in _NO_SLIP} | counts
    solid = {_MODULUS, STIFFNESS} if scene.measured_by else set()
    free = {name for name in names if not inputs[name].u} - typed - solid
    found: list[tuple[float, float, float, str]] = []  # score, size of its logarithm, share, name
    for name in sorted(typed - refuted):
        factors = SLIPS[_SLIPS_OF.get(inputs[name].si, "value")]
        if name in counts:
            factors = tuple(inputs[name].value / n for n in range(1, _MOST_COUNTED + 1) if n != inputs[name].value)
        elif free:  # where another input may have any value, a check names what is out of all proportion
            factors = tuple(k for k in factors if abs(log(k)) <= log(10.0))
        place = min(map(log, factors), key=lambda place: abs(place - fitted[name][0]))
        if abs(place - fitted[name][0]) > 2.0 * _BENT * abs(place):
            continue
        shift = place * powers[:, names.index(name)]
        # effects leave their power law over such a factor, those of small powers by as much as others
        bent = covariance + np.diag((_BENT * shift) ** 2 + (_BENT**2 * np.abs(shift).max()) ** 2)
        before, left = (agreement(rest, bent).chi2 for rest in (ratio, ratio - shift))
        if left < (1.0 - _MOST) * before:
            found.append((left + float(np.linalg.slogdet(bent)[1]), place, 1.0 - left / before, name))
    likely = [one for one in found if one[0] < min(found)[0] + _CLOSE]
    least = min((abs(size) for _, size, *_ in likely), default=0.0)
    likely = [one for one in likely if abs(one[1]) < 1.5 * least]
    if len(likely) != 1:
        return [], about
    ((_, size, share, name),) = likely
    largest = dict(zip(names, np.abs(powers).max(axis=0), strict=True))
    if free & close and largest[name] * abs(size) < largest.get(_MODULUS, inf) * log(_NO_GRADE):
        return [], about
    right, own = (
        f"{value:.0f}" if name in counts else quantity(value, inputs[name].si)
        for value in (inputs[name].value / exp(size), inputs[name].value)
    )
    why = ": its diameter was typed" if "radius" in name and isclose(size, log(2.0)) else ""
    said = f"{name} is probably {right}, not {own}{why}; {_share(share)}{scene.place(name)}"
    return [said, *([f"or {scene.another_material}"] if _MODULUS in names else [])], about
