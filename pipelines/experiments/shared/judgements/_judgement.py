"""Checks and comparison, made one verdict."""

import json
from collections.abc import Mapping, Sequence, Set
from types import MappingProxyType
from typing import Any

import numpy as np
import xarray as xr

from labpipe.judging import Agreement, Judgement, agreement, detectable, judge, model_verdict, to_json
from labpipe.variables import variable
from pipelines.experiments.shared.comparison_rows import Row
from pipelines.experiments.shared.judgements._exact import undecided_by
from pipelines.experiments.shared.judgements._scene import Scene
from pipelines.experiments.shared.judgements._suspects import explanations
from pipelines.experiments.shared.judgements._titles import Titles, entitled, laws
from pipelines.experiments.shared.material_choice import is_of_spectrum

MATTERS = 0.2
"""Relative error of an input that a comparison must be able to show before it can agree."""
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
    compared_rows = [row for row in scene.rows if row.deviation is not None]
    rows = [row for row in compared_rows if not scene.basis.carries(row, scene.inputs)]
    is_held = scene.basis.is_sound and (bool(rows) or not scene.basis.wrong)
    named = {name for row in rows for name in row.slopes}
    known = {**scene.inputs, **scene.shared}
    # a change of a rheometer's spectrum is no value that could have been stated wrongly
    names = sorted(name for name in named & set(scene.inputs) if not is_of_spectrum(name))
    found, smallest = None, np.full(len(names), np.inf)
    told: list[str] = []
    own: Any = None
    covariance: Any = None
    if rows:
        every = [*names, *sorted(named & set(known) - set(names))]
        slopes = np.array([[row.slopes.get(name, 0.0) for name in every] for row in rows])
        covariance, slack = _covariance(rows, slopes, [known[name].u for name in every])
        found = agreement([row.difference or 0.0 for row in rows], covariance, slack)
        smallest = detectable(slopes[:, : len(names)], covariance, slack=slack) if names else smallest
        own = slopes[:, : len(names)]
    # an error of an input that is 0 has no size to be compared with, nor has that of a temperature in °C
    values = np.array([0.0 if scene.inputs[name].si == "degC" else scene.inputs[name].value for name in names])
    relative = np.divide(smallest, np.abs(values), out=np.full(len(names), np.nan), where=values != 0.0)
    could_notice = bool((relative < MATTERS).any()) if names else True
    units = [scene.inputs[name].si for name in names]
    made = _dataset(judged, found, dict(zip(names, units, strict=True)), smallest, relative, could_notice)
    # what an impossible experiment on which little rests does to that little, nobody knows
    if not is_held or (scene.basis.wrong and made.attrs["model"] == "differs"):
        made.attrs["model"], is_held = "undecided", False
    exact = ""
    if made.attrs["model"] == "differs" and own is not None:
        exact = undecided_by(names, scene.inputs, own, [row.difference or 0.0 for row in rows], covariance)
    if exact:
        made.attrs["model"], is_held = "undecided", False
    doubted = _doubted(judged, {*named, *scene.inputs}) if made.attrs["model"] == "agrees" else ""
    if doubted:
        made.attrs["model"], is_held = "undecided", False
    if made.attrs["model"] == "differs" or not is_held:
        first = f"{scene.basis.reason}: see there first" if scene.basis.reason else ""
        told = [text for text in (first, exact, doubted, scene.unstated) if text]
        told += explanations(scene, judged, names, rows, own, covariance) if rows else []
    return made.assign_attrs(suspects=json.dumps(told))


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
    """Return the covariance of the differences, and what of its diagonal only makes up for slopes.

    It is what inputs share, and what is each row's own.
    """
    parts = slopes * np.asarray(u) if len(u) else np.zeros((len(rows), 0))
    shared = parts @ parts.T
    total = np.array([row.u_difference or 0.0 for row in rows]) ** 2
    own = np.maximum(total - np.diagonal(shared), 0.0)
    least = np.maximum(own, _LEAST_OWN**2 * total)
    return shared + np.diag(least), least - own


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
