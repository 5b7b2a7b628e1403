"""The stage of a judgement: checks and comparison of an experiment, made one verdict."""

import json
from collections.abc import Callable, Mapping, Sequence, Set
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
import xarray as xr

from labpipe.arrays import Floats
from labpipe.judging import Agreement, Judgement, agreement, detectable, judge, model_verdict, to_json
from labpipe.report import quantity
from labpipe.units import Quantity
from labpipe.variables import variable
from labpipe.workflow.context import Context
from pipelines.experiments.shared.comparison_rows import Row
from pipelines.experiments.shared.exact_values import exact_values, usual_uncertainty
from pipelines.experiments.shared.given import Given
from pipelines.experiments.shared.judgements._page import MATTERS, of_error
from pipelines.experiments.shared.judgements._scene import Basis, Scene, Titles, entitled, laws
from pipelines.experiments.shared.judgements._suspects import explanations
from pipelines.experiments.shared.material_choice import is_unstated

_LEAST_OWN = 0.05
"""Least part of a difference's uncertainty that is its own, not shared with other rows: slopes are no better."""


def judgement(scene: Scene, titles: Titles = MappingProxyType({})) -> xr.Dataset:
    """Derive the verdict on a scene: whether the record is believable and the model agrees.

    ``titles`` are those under which its checks are listed.

    Returned are ``chi_square``, ``degrees_of_freedom``, ``p``, ``n_checks`` [1]; over ``input`` the smallest error
    that the comparison would have shown, ``detectable`` (relative, NaN where the input is 0 or a temperature).
    Attributes ``judgement``, ``model`` and ``believable`` hold the words and, as JSON, all checks; ``suspects`` what
    would explain a model that differs.
    """
    judged = judge(entitled([*scene.checks, *scene.basis.checks], titles), scene.causes, laws(titles))
    rows = [row for row in scene.rows if row.deviation is not None]
    named = {name for row in rows for name in row.slopes}
    known = {**scene.inputs, **scene.shared}
    # what nobody states, such as a change of a rheometer's spectrum, could not have been stated wrongly
    names = sorted(name for name in named & set(scene.inputs) if not is_unstated(name))
    found, smallest = None, np.full(len(names), np.inf)
    differences = [row.difference or 0.0 for row in rows]
    own, covariance = np.empty((0, 0)), np.empty((0, 0))
    if rows:
        every = [*names, *sorted(named & set(known) - set(names))]
        slopes = np.array([[row.slopes.get(name, 0.0) for name in every] for row in rows])
        own = slopes[:, : len(names)]
        covariance, slack = _covariance(rows, slopes, [known[name].u for name in every])
        found = agreement(differences, covariance, slack)
        smallest = detectable(own, covariance, slack=slack) if names else smallest
    # an error of an input that is 0 has no size to be compared with, nor has that of a temperature in °C
    values = np.array([0.0 if scene.inputs[name].si == "degC" else scene.inputs[name].value for name in names])
    relative = np.divide(smallest, np.abs(values), out=np.full(len(names), np.nan), where=values != 0.0)
    model = model_verdict(found, bool((relative < MATTERS).any()) if names else True)
    reason = ""
    if model == "differs" and scene.basis.is_sound:
        reason = _undecided_by(names, scene.inputs, own, differences, covariance)
    elif model == "agrees":
        reason = _doubted(judged, {*named, *scene.inputs})
    is_held = scene.basis.is_sound and not reason
    told: list[str] = []
    if model == "differs" or not is_held:
        first = f"{scene.basis.reason}: see there first" if scene.basis.reason else ""
        told = [text for text in (first, reason, scene.unstated) if text]
        told += explanations(scene, judged, names, rows, own, covariance) if rows else []
    compared = found or Agreement(np.nan, 0, np.nan, np.nan)
    numbers = (
        ("n_checks", judged.n_made, "checks that were made"),
        ("chi_square", compared.chi2, "chi square of the comparison"),
        ("degrees_of_freedom", compared.degrees_of_freedom, "degrees of freedom"),
        ("p", compared.p, "probability of a larger chi square"),
        ("largest_deviation", compared.largest, "largest deviation of a row, in u"),
    )
    return xr.Dataset(
        {name: variable((), float(value), "1", text) for name, value, text in numbers}
        | {
            "detectable": variable("input", relative, "1", "smallest relative error that would have shown"),
            "detectable_error": variable("input", smallest, "1", "the same in SI units of the input"),
        },
        coords={"input": np.array(names, dtype=str)},
        attrs={
            "judgement": to_json(judged),
            "believable": judged.believable,
            "units": json.dumps([scene.inputs[name].si for name in names]),
            "model": model if is_held else "undecided",
            "suspects": json.dumps(told),
        },
    )


def _doubted(judged: Judgement, inputs: Set[str]) -> str:
    """Say why nothing can agree: the record is impossible, or a value that the model takes is not believed."""
    for finding in judged.findings:
        if finding.level == "impossible":
            return "a record that cannot be as it is agrees with nothing"
        name = finding.setting.rpartition(".")[2]
        if finding.level == "doubtful" and name in inputs:
            return f"{finding.setting}, which the model takes, is doubtful itself"
    return ""


def _covariance(rows: Sequence[Row], slopes: Any, u: Sequence[float]) -> tuple[Any, Any]:
    """Return the covariance of the differences, and the part of its diagonal that allows for uncertain slopes.

    It is what inputs share, and what is each row's own.
    """
    parts = slopes * np.asarray(u) if len(u) else np.zeros((len(rows), 0))
    shared = parts @ parts.T
    total = np.array([row.u_difference or 0.0 for row in rows]) ** 2
    own = np.maximum(total - np.diagonal(shared), 0.0)
    least = np.maximum(own, _LEAST_OWN**2 * total)
    return shared + np.diag(least), least - own


def _undecided_by(
    names: Sequence[str],
    inputs: Mapping[str, Quantity],
    slopes: Floats,
    differences: Sequence[float],
    covariance: Floats,
) -> str:
    """Name which values need an uncertainty, where usual ones would explain why a model differs.

    Parameters
    ----------
    names : sequence of str
        Inputs (m) that could have been stated wrongly.
    inputs : mapping of str to Quantity
    slopes : array (n, m)
        Derivatives of the differences, SI.
    differences : sequence of float
        Measured minus model (n).
    covariance : array (n, n)

    Returns
    -------
    str
        Empty where the model differs in spite of usual uncertainties.
    """
    usual = {
        i: usual_uncertainty(given)
        for i, name in enumerate(names)
        if not (given := inputs[name]).u and given.value and not (given.si == "1" and float(given.value).is_integer())
    }

    def differs(some: Sequence[int]) -> bool:
        effects = slopes[:, some] * [usual[i] for i in some]
        found = agreement(differences, covariance + effects @ effects.T)
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


@dataclass(frozen=True)
class Judging:
    """The judgement of a kind: called by its stage, it makes one verdict of what the steps gave.

    ``scene``: asks by name (:mod:`pipelines.experiments.shared.given`), for ``basis`` too; ``names``: of the results
    that the stage is given, in its order; ``rests_on``: fields that name experiments, as the stage lists them; their
    judgements follow the results; ``expected``: names of what is no expectation where one of these experiments is
    impossible; ``titles``: of the checks.
    """

    scene: Callable[..., Scene]
    names: tuple[str, ...]
    rests_on: tuple[str, ...]
    expected: tuple[str, ...]
    titles: Titles

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of what the stage is given, in its order; of a judgement, that of the field."""
        return (*self.names, *self.rests_on)

    def __call__(self, *results: Any, settings: Any, context: Context) -> xr.Dataset:
        """Judge an experiment."""
        known = dict(zip(self.inputs, results, strict=False))
        basis = Basis.of([known.pop(field, None) for field in self.rests_on])
        if not basis.is_sound:
            known |= dict.fromkeys(self.expected)
        made = judgement(Given(**known, settings=settings, context=context, basis=basis).ask(self.scene), self.titles)
        return made.assign_attrs(exact=json.dumps(exact_values(settings)), experiment=context.experiment)


def judging(
    *names: str,
    rests_on: tuple[str, ...] = (),
    expected: tuple[str, ...] = ("model", "comparison"),
    titles: Titles = MappingProxyType({}),
) -> Callable[[Callable[..., Scene]], Judging]:
    """Make the stage of a function that returns the scene of an experiment, see :class:`Judging`."""
    return lambda scene: Judging(scene, names, rests_on, expected, titles)
