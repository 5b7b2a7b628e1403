"""The verdict on one experiment: its checks, and its comparison with the model, as one result.

A kind gathers its checks and causes (``checks.py`` of its room) and hands them over with the rows
of its comparison; here they become the stage ``judgement`` and the first section of its page.
"""

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from math import exp, floor, inf, log, log10
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from calibration.record import NO_DAY
from labpipe.judging import (
    LIKELY,
    SLIPS,
    Agreement,
    Cause,
    Check,
    Judgement,
    Level,
    Suspect,
    agreement,
    best_factor,
    detectable,
    from_json,
    judge,
    model_verdict,
    not_made,
    slips,
    stated,
    suspects,
    to_json,
    unfinished,
)
from labpipe.report import (
    Block,
    Column,
    Details,
    Notice,
    Paragraph,
    Table,
    quantity,
    shown_source,
    value_with_uncertainty,
)
from labpipe.units import Quantity
from labpipe.variables import variable
from labpipe.workflow.context import Context
from labpipe.workflow.fields import REFERENCE
from pipelines.experiments.shared.comparison_rows import Row
from pipelines.experiments.shared.material_choice import is_of_spectrum

VERDICT = "verdict"
"""Anchor of the sentence on a page that tells its verdict."""
_LARGE, _VAGUE = 0.2, 0.05
"""Of a stated value, beyond which its uncertainty is doubtful, and beyond which it hides a slip of typing."""
MATTERS = 0.2
"""Relative error of an input that a comparison must be able to show before it can agree."""
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
_OF_NAME = "the specimen is of another material or grade than stated, whose modulus is known by its name alone"
_OF_ANOTHER = "the specimen is of another material than that of {}"
_TIED = "\N{NO-BREAK SPACE}"  # a number stays with its unit
_LEAST_OWN = 0.05
"""Least part of a difference's uncertainty that is its own, not shared with other rows."""
_NO_SLIP, _DIAMETER = ("1", "degC", "K"), 2.0  # units of inputs that have no usual factor, and a radius' one
_COMMON, _TOGETHER, _FEWEST_COMMON = 1.5, 0.15, 3
"""Factor from which on all measured values together are said to be off, how far each of them may be from it, as a
share of its logarithm, and how many there must be."""
_SUSPECTS, _EXPLAINS = 2, 0.2  # inputs that are named where the model differs, and the least share that each explains

_CLOSE = 6.0
"""Difference of chi square within which an input explains as much as the one that explains most."""
_KNOWN, _RELATIVE = 1e-3, 1e-2
"""Relative, what counts as the uncertainty of an input without a stated one, and of a factor that nobody measured."""
_HALF = 0.5
"""Of one: a number of things is wrong by that much at least."""

_VISIBLE = 0.5  # of the uncertainty of a difference
_LEAST_P = 1e-4  # smaller probabilities say no more

_BESIDE = {
    "agrees": "The {} agrees all the same.",
    "differs": "The {} differs, which may follow from it.",
    "undecided": "Whether the {} agrees is undecided.",
    "none": "No model was compared.",
}
"""What is said of the model beside a record that cannot be believed as it is."""


class Basis(NamedTuple):
    """What is known of the experiments that one rests on: its material's DMA, its plate, its laser.

    Attributes
    ----------
    checks : sequence of Check
        One for each of them.
    is_sound : bool
        Whether none on which all rests is impossible. What is computed from an impossible one is no
        expectation, so that nothing is held against it.
    reason : str
        Of what is not believable; empty where all is.
    wrong : tuple of str
        Beginnings of the names of inputs that come from an impossible one on which little rests.
    """

    checks: Sequence[Check] = ()
    is_sound: bool = True
    reason: str = ""
    wrong: tuple[str, ...] = ()

    @classmethod
    def of(cls, settings: Any, results: Mapping[str, Any], **slight: str) -> "Basis":
        """Take the judgements of the experiments that settings name, where they are.

        Parameters
        ----------
        settings : Struct
            Of the experiment.
        results : mapping of str to Dataset, list of Dataset, or None
            By the field that names the experiment, as ``rests_on`` of its kind lists them.
        **slight
            Fields on which a row may rest by little only, each with the beginning of the names of
            the inputs that come from there.
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
                law = "an expectation is as good as the measurement that it was computed from"
                check = stated(f"basis, {name}", law, text, "note" if cause else None, cause=cause)
                checks[check.name] = check
        return cls(tuple(checks.values()), is_sound, "; ".join(dict.fromkeys(reasons)), tuple(wrong))

    def sound(self, *computed: Any) -> tuple[Any, ...]:
        """Return what was computed from these experiments, or None for each where it is no expectation."""
        return computed if self.is_sound else (None,) * len(computed)

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

    Attributes
    ----------
    checks : sequence of Check
    causes : sequence of Cause
    rows : sequence of Row
        Of the comparison; empty where there is no model.
    inputs : mapping of str to Quantity
        Values and uncertainties of what the rows name in their slopes.
    shared : mapping of str to Quantity
        What rows name there too because they have it in common, but nobody states and could have
        stated wrongly, such as the scatter of another measurement.
    basis : Basis
        Its checks are added to the others.
    unstated : str
        What nobody stated and would explain a model that differs; it is told first.
    measured_by : str
        Experiment or file that knows the modulus of the material; empty where that is known by its name alone.
    """

    checks: Sequence[Check]
    causes: Sequence[Cause] = ()
    rows: Sequence[Row] = ()
    inputs: Mapping[str, Quantity] = {}
    shared: Mapping[str, Quantity] = {}
    basis: Basis = Basis()
    unstated: str = ""
    measured_by: str = ""

    @property
    def another_material(self) -> str:
        """What is said where another modulus would explain a model that differs."""
        return _OF_ANOTHER.format(self.measured_by) if self.measured_by else _OF_NAME


def measured_by(material: Any) -> str:
    """Return the experiment or file that knows a material as settings choose it; empty for one known by its name."""
    chosen = getattr(material, "material_from", None) or getattr(material, "material_file", None)
    return (chosen or "").removeprefix(REFERENCE)


def uncertainties_stated(given: Iterable[tuple[str, Quantity]]) -> Iterator[Check]:
    """Hold stated uncertainties, each with its setting, against the values to which they belong."""
    law = "an uncertainty is far smaller than what it belongs to"
    for setting, value in given:
        text = f"{setting} is stated as {quantity(value.value, value.si)} with u = {quantity(value.u, value.si)}"
        level: Level | None = None
        cause, share = "", value.u / abs(value.value) if value.value else 0.0
        if share > _LARGE:
            level, cause = "doubtful", "the uncertainty was typed in another unit or with a lost decimal"
        elif share > _VAGUE:
            level = "note"
            cause = f"{setting} is known too vaguely to judge by: a difference of {4 * share:.0%} would pass"
        yield stated(f"uncertainty of {setting}", law, text, level, cause=cause, setting=setting)


def day_known(calibrated: xr.Dataset | None, record: str) -> Check:
    """Hold the day of a recording against what a clock can say; by it a calibration record is chosen."""
    name, law = "day of the recording", "a recording was made after its instrument, and before it was read"
    if calibrated is None or not str(calibrated.attrs.get("calibration", "")).startswith("{"):
        return not_made(name, law, "a calibration record")
    said = str(json.loads(calibrated.attrs["calibration"])["validity_check"])
    if not said.startswith(NO_DAY):
        return stated(name, law, f"{record}: {said}", None)
    text = f"whether {record} was valid is not known: the clock of the instrument says {said.removeprefix(NO_DAY)}"
    return stated(name, law, text, "note", cause="the clock of the instrument was never set, or lost its battery")


def failed_steps(context: Context, causes: Mapping[str, str]) -> list[Check]:
    """Turn steps that gave no result into checks that failed, or that could not be made.

    Where the run was at fault, as by a program that changed under it, a full disk, or a mistake of
    the program itself, nothing is said of the record but that the verdict lacks a step.

    Parameters
    ----------
    context : Context
        Of the run.
    causes : mapping of str to str
        Stage to what most likely is wrong with a record on which it fails.
    """
    found: dict[str, Check] = {}
    for failure in context.failures:
        if "gave no result" in failure.text or failure.stage in found:
            continue
        where = f"{failure.recording}: " if failure.recording else ""
        if failure.is_of_run:
            found[failure.stage] = unfinished(
                f"step {failure.stage}",
                "what is judged must have been computed",
                f"{where}{failure.text}",
                "the program did not get through this step, which tells nothing about the record: run it again, and "
                "report it if it happens again",
            )
            continue
        found[failure.stage] = stated(
            f"step {failure.stage}",
            "what an experiment records must be in the record",
            f"{where}{failure.text}",
            "impossible",
            cause=causes.get(failure.stage, ""),
            file=failure.recording or "",
        )
    return list(found.values())


def judgement(scene: Scene) -> xr.Dataset:
    """Make one verdict of a scene: whether the record is believable and the model agrees.

    Returns
    -------
    Dataset
        ``chi_square``, ``degrees_of_freedom``, ``p``, ``n_checks`` [1]; over ``input`` the
        smallest error that the comparison would have shown, ``detectable`` (relative, NaN
        where the input is 0 or a temperature). Attributes ``judgement``, ``model`` and ``believable`` hold the
        words and, as JSON, all checks; ``suspects`` what would explain a model that differs.
    """
    judged = judge([*scene.checks, *scene.basis.checks], scene.causes)
    compared_rows = [row for row in scene.rows if row.deviation is not None]
    rows = [row for row in compared_rows if not scene.basis.carries(row, scene.inputs)]
    is_held = scene.basis.is_sound and (bool(rows) or not scene.basis.wrong)
    named = {name for row in rows for name in row.slopes}
    known = {**scene.inputs, **scene.shared}
    # a change of a rheometer's spectrum is no value that could have been stated wrongly
    names = sorted(name for name in named & set(scene.inputs) if not is_of_spectrum(name))
    found, smallest, told, stiffness = None, np.full(len(names), np.inf), [], None
    if rows:
        every = [*names, *sorted(named & set(known) - set(names))]
        slopes = np.array([[row.slopes.get(name, 0.0) for name in every] for row in rows])
        covariance = _covariance(rows, slopes, [known[name].u for name in every])
        found = agreement([row.difference or 0.0 for row in rows], covariance)
        smallest = detectable(slopes[:, : len(names)], covariance) if names else smallest
        own = slopes[:, : len(names)]
        ranked = suspects([row.difference or 0.0 for row in rows], own, covariance) if names else []
        stiffness = _stiffness(names, scene.inputs, rows, own, covariance)
        if not scene.unstated:
            told = _slipped(scene, names, rows, own, covariance, ranked, _confirmed(judged))
        told = _common(names, rows, own) + told
        others = _suspected(names, known, own, ranked, found.chi2)
        if not told and ranked and ranked[0].share > _MOSTLY and _MODULUS in names:
            far = [i for i, error in _errors_of(ranked[0], own) if not _is_near(known[names[i]], error)]
            alike = " or ".join(names[i] for i in far if names[i] != _MODULUS)  # looks the same
            told = [f"probably {scene.another_material}{f'; or {alike} is stated wrongly' * bool(alike)}"]
            told = told if names.index(_MODULUS) in far else []
        told = [*told, *others][:_SUSPECTS] or ([_UNEXPLAINED] if names else [])
    # an error of an input that is 0 has no size to be compared with, nor has that of a temperature in °C
    values = np.array([0.0 if scene.inputs[name].si == "degC" else scene.inputs[name].value for name in names])
    relative = np.divide(smallest, np.abs(values), out=np.full(len(names), np.nan), where=values != 0.0)
    could_notice = bool((relative < MATTERS).any()) if names else True
    units = [scene.inputs[name].si for name in names]
    made = _dataset(judged, found, dict(zip(names, units, strict=True)), smallest, relative, could_notice)
    # what an impossible experiment on which little rests does to that little, nobody knows
    if not is_held or (scene.basis.wrong and made.attrs["model"] == "differs"):
        made.attrs["model"], is_held = "undecided", False
    told = [first for first in (scene.unstated,) if first] + told
    told = [f"{scene.basis.reason}: see there first", *told] if scene.basis.reason else told
    wanted = made.attrs["model"] == "differs" or not is_held
    return made.assign_attrs(suspects=json.dumps(told if wanted else []), stiffness=json.dumps(stiffness))


def _suspected(
    names: Sequence[str], known: Mapping[str, Quantity], slopes: Any, ranked: Sequence[Suspect], chi2: float
) -> list[str]:
    """Say of the likeliest inputs by how much each would have to be stated wrongly, and what that explains."""
    said: list[str] = []
    # what explains as much is the likelier, the less of its own uncertainty it takes
    each = [(suspect.share, _likeliest_first(suspect, names, known, slopes)) for suspect in ranked]
    alike = [one for one in each if (ranked[0].share - one[0]) * chi2 < _CLOSE]
    alike.sort(key=lambda one: _far(known[one[1][0][0]], one[1][0][1]) if one[1] else inf)
    for share, errors in [*alike, *each[len(alike) :]]:
        if share < _EXPLAINS or len(said) == _SUSPECTS:
            break
        near = [(name, error) for name, error in errors if _is_near(known[name], error)]
        if not near:
            continue
        (first, error), *_ = near
        others, given = [name for name, _ in errors if name != first], known[first]
        way = "too large" if error > 0.0 else "too small"
        size = quantity(abs(error), _of_error(given.si))
        if given.si == "1" and given.value:
            size = f"{100 * abs(error / given.value):.2g} %"
        like = f" (or {', '.join(others)})" if others else ""
        said.append(f"{first}{like} stated {size} {way} would explain {100 * share:.0f} % of it")
    return said


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


def _of_error(unit: str) -> str:
    """Return the unit of an error of what is stated in a unit: a difference of temperatures is one in kelvin."""
    return "K" if unit == "degC" else unit


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
        return cls(
            np.array([rows[j].measured for j in straight]),
            np.array([rows[j].model for j in straight]),
            slopes[straight] * values / mean[:, None],
            covariance[np.ix_(straight, straight)] / np.outer(mean, mean),
        )


def _stiffness(
    names: Sequence[str], known: Mapping[str, Quantity], rows: Sequence[Row], slopes: Any, covariance: Any
) -> float | None:
    """Return how many times the stated modulus would explain the rows; None where no modulus does, or tells."""
    laws = _PowerLaws.of(names, known, rows, slopes, covariance)
    if _MODULUS not in names or not laws.measured.size:
        return None
    found = best_factor(laws.measured, laws.model, -laws.powers[:, names.index(_MODULUS)], laws.spread)
    return found.factor if found is not None and found.share > _TELLS else None


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
    certain = {j for j, name in enumerate(names) if known[name].u or (scene.measured_by and name == _MODULUS)}
    free = {i for suspect in ranked if not certain.issuperset(suspect.inputs) for i in suspect.inputs}
    # what is relative has no unit to be typed wrongly, and a temperature no factor
    stated_ones = [
        i
        for i, name in enumerate(names)
        if known[name].u and known[name].value > 0.0 and known[name].si not in _NO_SLIP
        if name not in confirmed
    ]
    laws = _PowerLaws.of(names, known, rows, slopes, covariance)
    if not stated_ones or not laws.measured.size:
        return []
    powers = laws.powers[:, stated_ones]
    of_modulus = laws.powers[:, names.index(_MODULUS)] if _MODULUS in names else np.full(1, inf)
    of_grades = float(np.abs(of_modulus).max()) * log(_NO_GRADE)
    said = []
    # beside what may have any value, what is out of all proportion is told by a check of its own
    factors = [
        [
            k
            for k in SLIPS["mass" if known[names[i]].si == "kg" else "value"]
            if not free or abs(log(k)) <= log(_DECIMAL)
        ]
        for i in stated_ones
    ]
    for slip in slips(laws.measured, laws.model, powers, laws.spread, factors):
        name = names[stated_ones[slip.input]]
        effect = float(np.abs(powers[:, slip.input]).max()) * abs(log(slip.factor))
        if stated_ones[slip.input] in free and effect < of_grades:
            return []
        given = known[name]
        typed = ": its diameter was typed" if "radius" in name and slip.factor == _DIAMETER else ""
        said.append(
            f"{name} is probably {quantity(given.value / slip.factor, given.si)}, not {quantity(given.value, given.si)}"
            f"{typed}; that would explain {100 * slip.share:.0f}{_TIED}% of it"
        )
    if len(said) != 1:
        return []
    return [*said, f"or {scene.another_material}"] if _MODULUS in names else said


def _confirmed(judged: Judgement) -> Set[str]:
    """Return the settings that a check has held against the record and found right."""
    made = [c for c in judged.checks if c.is_made and c.setting and np.isfinite(c.log_ratio)]
    return {c.setting for c in made} - {c.setting for c in made if c.level}


def _common(names: Sequence[str], rows: Sequence[Row], slopes: Any) -> list[str]:
    """Say by which one factor everything that was measured differs from the model, where one explains it."""
    pairs = [(row.measured or 0.0, row.model or 0.0) for row in rows]
    logs = np.array([log(seen / model) for seen, model in pairs if seen * model > 0.0])
    if logs.size < len(rows) or logs.size < _FEWEST_COMMON:
        return []
    middle = float(np.median(logs))
    if abs(middle) < log(_COMMON) or float(np.max(np.abs(logs - middle))) > _TOGETHER * abs(middle):
        return []
    relative = slopes / np.array([row.model for row in rows])[:, None]
    mean = relative.mean(axis=0)
    alike = [n for n, m, r in zip(names, mean, relative.T, strict=True) if np.ptp(r) <= _TOGETHER * abs(m) > 0.0]
    what = ", ".join(alike) or "a gain"
    return [
        f"all {logs.size} measured values are {exp(middle):.3g} times those of the model: what multiplies all of them "
        f"({what}, a unit, or another material's modulus) is wrong by that factor"
    ]


def _covariance(rows: Sequence[Row], slopes: Any, u: Sequence[float]) -> Any:
    """Return the covariance of the differences: what inputs share, and what is each row's own."""
    parts = slopes * np.asarray(u) if len(u) else np.zeros((len(rows), 0))
    shared = parts @ parts.T
    total = np.array([row.u_difference or 0.0 for row in rows]) ** 2
    own = np.maximum(total - np.diagonal(shared), _LEAST_OWN**2 * total)
    return shared + np.diag(own)


def _dataset(
    judged: Judgement,
    found: Agreement | None,
    units: Mapping[str, str],
    smallest: Any,
    relative: Any,
    could_notice: bool,
) -> xr.Dataset:
    def number(value: float, text: str) -> Any:
        return variable((), value, "1", text)

    known = found or Agreement(np.nan, 0, np.nan, np.nan)
    return xr.Dataset(
        {
            "n_checks": number(float(judged.n_made), "checks that were made"),
            "chi_square": number(known.chi2, "chi square of the comparison"),
            "degrees_of_freedom": number(float(known.degrees_of_freedom), "degrees of freedom"),
            "p": number(known.p, "probability of a larger chi square"),
            "largest_deviation": number(known.largest, "largest deviation of a row, in u"),
            "detectable": variable("input", relative, "1", "smallest relative error that would have shown"),
            "detectable_error": variable("input", smallest, "1", "the same in SI units of the input"),
        },
        coords={"input": np.array(list(units), dtype=str)},
        attrs={
            "judgement": to_json(judged),
            "believable": judged.believable,
            "units": json.dumps(list(units.values())),
            "model": model_verdict(found, could_notice),
        },
    )


def believed(result: xr.Dataset) -> Judgement:
    """Return the checks and the verdict of a stored judgement."""
    return from_json(result.attrs["judgement"])


def suspected(result: xr.Dataset) -> list[str]:
    """Return what would explain a model that differs or cannot be held against the record, the likeliest first."""
    return list(json.loads(result.attrs.get("suspects", "[]")))


def sentence(result: xr.Dataset, rows: Iterable[Row] = ()) -> tuple[str, str]:
    """Say in one sentence whether the record can be believed and the model agrees.

    Returns
    -------
    level : "ok", "info", "warning" or "error"
        Colour of the sentence.
    text : str
    """
    judged = believed(result)
    made, found = judged.n_made, judged.findings
    known = [r for r in rows if r.deviation is not None and r.measured is not None]
    # A film is laid against the laser, no model.
    by = "model" if not known or any(r.against == "model" for r in known) else known[0].against
    if judged.believable in ("impossible", "doubtful"):
        cause = f" {capitalised(likeliest)}." if (likeliest := _likeliest(judged)) else ""
        word = capitalised(judged.believable)
        level = "error" if judged.believable == "impossible" else "warning"
        beside = _BESIDE[str(result.attrs["model"])].format(by)
        return level, f"{word}: {found[0].message}.{cause} {beside} {_counted(judged)}."
    checks = _counted(judged) if made else "no check could be made"
    stopped = next((c for c in judged.checks if c.level is not None and not c.is_made), None)
    if stopped is not None:
        return (
            "warning",
            f"Not known: {stopped.name} was not completed: {stopped.message}; {checks}. {capitalised(stopped.cause)}.",
        )
    model = result.attrs["model"]
    worst = max(known, key=lambda r: abs(r.deviation or 0.0), default=None)
    shown = "" if worst is None else f" Largest of {_many(known, 'deviation')}: {_compared(worst, known)}."
    believable = "The record is believable" if made else "Whether the record is believable is not known"
    if model == "agrees":
        return "ok", f"{believable}, and the {by} agrees with it; {checks}.{shown}"
    if model == "differs":
        p = float(result["p"])
        explained = "".join(f" {capitalised(text)}." for text in suspected(result))
        return (
            "warning",
            f"{believable}, but the {by} differs from it ({chance(p)}, largest deviation "
            f"{float(result['largest_deviation']):.1f} u); {checks}.{shown}{explained}",
        )
    if model == "undecided":
        undecided = f"whether the {by} agrees is undecided"
        shown = "" if suspected(result) else shown  # what it is held against tells nothing
        return "info", f"{believable}; {undecided}; {checks}.{shown} {capitalised(_undecided(result))}."
    return "ok" if made else "info", f"{believable}: {checks}. There is no model to compare with."


def _likeliest(judged: Judgement) -> str:
    """Return the cause of the gravest finding, else the first that explains any; empty where none is known."""
    gravest = judged.findings[0].cause if judged.findings else ""
    return gravest or next(iter(judged.causes), "")


def _undecided(result: xr.Dataset) -> str:
    """Say why an agreement says nothing: its basis is wrong, differences are unlikely, or no error would have shown."""
    if basis := suspected(result):
        return basis[0]
    if (p := float(result["p"])) < LIKELY:
        return f"so large differences are unlikely by chance ({chance(p)}), but no proof of another model"
    return f"no error of {MATTERS:.0%} in any input would have shown".replace("%", f"{_TIED}%")


def probability(p: float) -> str:
    """Write a probability; one too small to tell from none is never written as 0.

    Examples
    --------
    >>> probability(0.82), probability(1e-120)
    ('0.82', '< 0.0001')
    """
    return f"{p:.2g}" if p >= _LEAST_P else f"< {_LEAST_P:g}"


def chance(p: float) -> str:
    """Say how likely what was found is: "p = 0.82", "p < 0.0001"."""
    return f"p = {probability(p)}" if p >= _LEAST_P else f"p {probability(p)}"


def _many(found: Sequence[object], noun: str) -> str:
    return f"{len(found)} {noun}{'s' * (len(found) != 1)}"


def _compared(row: Row, among: Sequence[Row]) -> str:
    measured, model = (
        value_with_uncertainty(value or 0.0, u, row.unit) if u else _as_exact(value or 0.0, row)
        for value, u in ((row.measured, row.u_measured), (row.model, row.u_model))
    )
    where = ", ".join(part for part in (row.material, row.condition) if part)
    is_one_of_many = sum(other.quantity == row.quantity for other in among) > 1
    which = f"{row.quantity} ({where})" if where and is_one_of_many else row.quantity
    return f"{which}: {measured} measured, {model} expected (difference {abs(row.deviation or 0.0):.1f}{_TIED}u)"


def _as_exact(value: float, row: Row) -> str:
    """Write a value without an uncertainty of its own with the digits that the difference's can tell."""
    if row.u_difference and value:
        digits = max(1, floor(log10(abs(value))) - floor(log10(row.u_difference)) + 2)
        value = float(f"{value:.{digits}g}")
    return value_with_uncertainty(value, 0.0, row.unit)


def _counted(judged: Judgement) -> str:
    passed = sum(c.is_made and c.level in (None, "note") for c in judged.checks)
    return f"{passed} of {judged.n_made} checks passed"


def capitalised(text: str) -> str:
    """Begin a sentence; files and settings keep their spelling.

    Examples
    --------
    >>> capitalised("the radius is wrong"), capitalised("sphere.radius is wrong")
    ('The radius is wrong', 'sphere.radius is wrong')
    """
    first = text.partition(" ")[0].rstrip(".,:;")
    return text if any(c in first for c in "/._") else text[:1].upper() + text[1:]


def verdict_blocks(result: xr.Dataset | None, rows: Iterable[Row] = ()) -> tuple[Block, ...]:
    """Return the opening of a page: the sentence, then what was checked and what it could show."""
    if result is None:
        return ()
    judged = believed(result)
    level, text = sentence(result, rows)
    blocks: list[Block] = [Notice(level, text, VERDICT)]  # type: ignore[arg-type]
    if len(judged.findings) > 1:
        blocks.append(Details(f"All {len(judged.findings)} findings", blocks=(_found(judged),)))
    elif judged.findings and judged.findings[0].level == "note":  # the sentence tells no note
        blocks.append(Details("What was noted", blocks=(_found(judged),)))
    if result.sizes["input"]:
        blocks.append(Paragraph(noticed(result)))
        blocks.append(Details("What this comparison could have noticed", blocks=(_noticed(result),)))
    blocks.append(Details(f"Checks of the record ({_counted(judged)})", blocks=(_checked(judged),)))
    return tuple(blocks)


def _found(judged: Judgement) -> Table:
    rows = [(f.level, f.check, f.message, f.cause) for f in judged.findings]
    return Table(tuple(Column(name) for name in ("level", "check", "what was seen", "probable cause")), rows)


def noticed(result: xr.Dataset) -> str:
    """Say in one line which error of each input the comparison would have shown.

    Examples
    --------
    ``"Errors that would have shown: height 0.4 % · modulus 2.1 %. Not even 100 % would have shown in: mass."``
    """
    errors = _errors(result)
    parts = [f"{name}{_TIED}{size.replace(' ', _TIED)}" for name, size, _ in errors if size]
    none = [name for name, size, _ in errors if not size]
    between = f"{_TIED}· "
    said = f"Errors that would have shown: {between.join(parts) or 'none below 100' + _TIED + '%'}."
    return f"{said} Not even 100{_TIED}% would have shown in: {between.join(none)}." if none and parts else said


def _errors(result: xr.Dataset) -> list[tuple[str, str, float]]:
    """Return name, size as text, and relative size of what would have shown; the smallest first."""
    units = json.loads(result.attrs["units"])
    values = zip(
        result["input"].values, result["detectable"].values, result["detectable_error"].values, units, strict=True
    )
    found = []
    for name, relative, error, unit in values:
        if np.isnan(relative):  # of an input that is 0, such as a position, or a temperature
            size = quantity(float(error), _of_error(unit)) if np.isfinite(error) else ""
        else:
            size = f"{100 * relative:.2g} %" if np.isfinite(relative) and relative < 1.0 else ""
        found.append((shown_source(str(name)), size, float(relative)))
    return sorted(found, key=lambda each: (not each[1], bool(np.isnan(each[2])), each[2]))


def _noticed(result: xr.Dataset) -> Table:
    rows = [(name, size or "cannot tell (below 100 %)") for name, size, _ in _errors(result)]
    return Table(
        (Column("input"), Column("smallest error that would have shown")),
        rows,
        caption="With 95 % probability at the 5 % level, all other inputs held at their uncertainty.",
    )


def _checked(judged: Judgement) -> Table:
    rows = []
    for check in judged.checks:
        answer = check.level or ("passed" if check.is_made else "not made")
        margin = f"{check.margin:+.1f} u" if np.isfinite(check.margin) else ""
        rows.append((check.name, answer, margin, check.message or f"needs {check.needs}", check.law))
    columns = ("check", "answer", "margin", "what was seen", "law")
    return Table(tuple(Column(name) for name in columns), rows)


def times_over(name: str, stated_value: float, unit: str, what: str) -> Any:
    """Return the sentence of a cause: what a stated value would have to be.

    Parameters
    ----------
    name : str
        What is wrong, such as ``"the sampling cycle"``.
    stated_value : float
        As it is stated, SI.
    unit : str
        SI.
    what : str
        Where it stands, such as ``"laser/a.csv"``.

    Examples
    --------
    >>> say = times_over("the height", 1.5e-3, "m", "")
    >>> say(0.1)
    'the height is probably 15.0 mm, not 1.50 mm'
    >>> say(1.0004)
    'the height is probably 0.04 % less than the 1.50 mm that are stated'
    """

    def say(factor: float) -> str:
        right = quantity(stated_value / factor, unit)
        given = quantity(stated_value, unit)
        place = f" ({what})" if what else ""
        if right == given:
            off, more = abs(100.0 * (1.0 / factor - 1.0)), "more" if factor < 1.0 else "less"
            return f"{name} is probably {off:.2g} % {more} than the {given} that are stated{place}"
        return f"{name} is probably {right}, not {given}{place}"

    return say


def line_of(header: str, *words: str) -> int | None:
    """Return the line of a file's header that holds one of some words; None when none does."""
    for number, text in enumerate(header.splitlines(), 1):
        if any(word.lower() in text.lower() for word in words):
            return number
    return None


def compared(result: xr.Dataset) -> dict[str, Any]:
    """Return what the comparison of one experiment came to, for JSON."""
    units = json.loads(result.attrs["units"])
    errors = result["detectable_error"].values
    names = [str(name) for name in result["input"].values]
    return {
        "model": str(result.attrs["model"]),
        "chi2": _finite(result["chi_square"]),
        "degrees_of_freedom": int(result["degrees_of_freedom"]),
        "p": _finite(result["p"]),
        "suspects": suspected(result),
        "detectable": {
            name: {"value": float(error) if np.isfinite(error) else None, "unit": _of_error(unit)}
            for name, error, unit in zip(names, errors, units, strict=True)
        },
    }


def _finite(value: Any) -> float | None:
    return float(value) if np.isfinite(float(value)) else None
