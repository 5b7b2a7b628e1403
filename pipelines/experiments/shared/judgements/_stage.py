"""The stage of a judgement: titles of checks, the experiments it rests on, and checks and comparison as one verdict."""

import json
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from labpipe.judging import Agreement, Check, agreement, detectable, judge, model_verdict, to_json
from labpipe.units import Quantity
from labpipe.variables import variable
from labpipe.workflow.context import Context
from labpipe.workflow.fields import every_setting
from pipelines.experiments.shared.exact_values import exact_values
from pipelines.experiments.shared.given import Given
from pipelines.experiments.shared.judgements._page import MATTERS
from pipelines.experiments.shared.judgements._scene import Basis, Scene
from pipelines.experiments.shared.judgements._suspects import Compared, curve_differs, explanations, undecided_by
from pipelines.experiments.shared.judgements._usual import measured_by, uncertainties_stated

STEPS = "references and processing steps"
"""Title of the check of all that an experiment is based on."""
REPEATS = "repeats"
"""Title of the check of recordings against each other."""
BY_NAME, MEASURED = 0.5, 0.25
"""Standard uncertainty of the logarithm of a modulus known by the solid's name, and of one measured on a specimen."""


class Title(NamedTuple):
    """A check of a kind: its sentence, and beginnings of the names of the quantities that belong to it."""

    law: str
    names: tuple[str, ...]


Titles = Mapping[str, Title]

OF_FILM: Titles = {
    "frames": Title(
        "A film holds every frame once, whole, unaltered and in order.",
        ("times of the frames", "whole film", "frames differ", "order of the frames"),
    ),
    "light and exposure": Title(
        "No frame is over-exposed, and the exposure is the stated one.",
        ("exposure",),
    ),
}  # fmt: skip
"""Checks of the frames of a film."""

COMMON: Titles = {
    "calibration": Title(
        "The calibration record belongs to the instrument and was valid on the day of the recording.",
        ("day of the recording", "line of sight", "uncertainty of the scale", "date of the cell"),
    ),
    "stated values": Title(
        "Stated values are physically possible, and their uncertainties are small compared with them.",
        ("uncertainty of", "mass of the falling body"),
    ),
    STEPS: Title(
        "Every processing step and every experiment that is referred to gave a valid result.", ("step", "input from")
    ),
}
"""Checks of every kind."""


def entitled(checks: Iterable[Check], titles: Titles) -> list[Check]:
    """Give checks the title under which they are listed, of a kind or of all; others have a title of their own."""
    pairs = ((name, title) for title, of in {**COMMON, **titles}.items() for name in of.names)
    longest = sorted(pairs, key=lambda pair: -len(pair[0]))
    found = []
    for check in checks:
        title = next((title for name, title in longest if check.name.startswith(name)), check.title)
        # repeats are compared with each other: no recording passes by itself
        recording = "" if title == REPEATS else check.recording or check.file
        found.append(replace(check, title=title, recording=recording))
    return found


def u_modulus(material: Any) -> float:
    """Return the relative standard uncertainty of the modulus of a solid as settings choose it."""
    return MEASURED if measured_by(material) else BY_NAME


def judgement(scene: Scene, titles: Titles = MappingProxyType({})) -> xr.Dataset:
    """Derive the verdict on a scene: whether the record is believable and the model agrees.

    ``titles`` are those under which its checks are listed.

    Returned are ``chi_square``, ``degrees_of_freedom``, ``p``, ``n_checks`` [1]; over ``input`` the smallest error
    that the comparison would have shown, ``detectable`` (relative, NaN where the input is 0 or a temperature).
    Attributes ``judgement``, ``model`` and ``believable`` hold the words and, as JSON, all checks; ``suspects``
    explanations of a model that differs, and ``is_explained`` whether the first of them is plausible.
    """
    laws = {title: of.law for title, of in {**titles, **COMMON}.items()}  # in the order of the page
    judged = judge(entitled([*scene.checks, *scene.basis.checks], titles), scene.causes, laws)
    made = Compared.of(scene)
    names, found, smallest = made.names, None, np.full(len(made.names), np.inf)
    if made.rows:
        found = agreement(made.differences, made.covariance, made.slack)
        smallest = detectable(made.slopes, made.covariance, slack=made.slack) if names else smallest
    # an error of an input that is 0 has no size to be compared with, nor has that of a temperature in °C
    values = np.array([0.0 if scene.inputs[name].si == "degC" else scene.inputs[name].value for name in names])
    relative = np.divide(smallest, np.abs(values), out=np.full(len(names), np.nan), where=values != 0.0)
    curves = {row.p_alone: row for row in scene.rows if row.p_alone is not None}
    could_notice = bool((relative < MATTERS).any()) if names else True
    model = model_verdict(found, could_notice, [*curves])
    reason, by_curve = "", ""
    if model == "differs" and model_verdict(found, could_notice) != "differs":
        by_curve = curve_differs(curves[min(curves)])
    elif model == "differs" and scene.basis.is_sound:
        reason = undecided_by(scene.inputs, made)
    elif model == "agrees":
        taken = {name for row in made.rows for name in row.slopes} | set(scene.inputs)
        settings = (finding.setting for finding in judged.findings if finding.level == "doubtful")
        doubted = next((setting for setting in settings if setting.rpartition(".")[2] in taken), "")
        reason = f"{doubted}, which the model takes, is doubtful itself" if doubted else ""
        if judged.believable == "impossible":
            reason = "a record that cannot be as it is agrees with nothing"
    is_held = scene.basis.is_sound and not reason
    told, is_plausible = list[str](), True
    if model == "differs" or not is_held:
        first = f"{scene.basis.reason}: see there first" if scene.basis.reason else ""
        told = [text for text in (first, reason, by_curve, scene.unstated) if text]
        found_causes, is_plausible = explanations(scene, judged, made) if made.rows and not by_curve else ([], False)
        told, is_plausible = told + found_causes, bool(told) or is_plausible
    agreed = found or Agreement(np.nan, 0, np.nan, np.nan)
    numbers = (
        ("n_checks", judged.n_made, "checks that were made"),
        ("chi_square", agreed.chi2, "chi square of the comparison"),
        ("degrees_of_freedom", agreed.degrees_of_freedom, "degrees of freedom"),
        ("p", agreed.p, "probability of a larger chi square"),
        ("largest_deviation", agreed.largest, "largest deviation of a row, in u"),
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
            "is_explained": int(is_plausible),
        },
    )


def judging(
    *names: str,
    rests_on: tuple[str, ...] = (),
    expected: tuple[str, ...] = ("model", "comparison"),
    titles: Titles = MappingProxyType({}),
) -> Callable[[Callable[..., Scene]], Any]:
    """Make the stage that judges a kind of a function that returns the scene of an experiment.

    The function asks by name (:mod:`pipelines.experiments.shared.given`), for ``basis`` too; ``names`` are those of the
    results that the stage is given, in its order; ``rests_on`` are fields that name experiments, whose judgements
    follow; ``expected`` are results that are no expectation where one of these is impossible; ``titles`` those of the
    checks. Its attribute ``inputs`` holds the names of all that it is given. The stage takes ``others`` besides, master
    curves by the names of their experiments: materials of which the specimen may be.
    """

    def of_scene(scene: Callable[..., Scene]) -> Any:
        def judged(
            *results: Any, settings: Any, context: Context, others: Mapping[str, xr.Dataset] | None = None
        ) -> xr.Dataset:
            known = dict(zip((*names, *rests_on), results, strict=False)) | {"others": others}
            basis = Basis.of([known.pop(field, None) for field in rests_on])
            known |= {} if basis.is_sound else dict.fromkeys(expected)
            found: Scene = Given(**known, settings=settings, context=context, basis=basis).ask(scene)
            given = [(place, value) for place, value, _ in every_setting(settings)]
            stated = [(place, value) for place, value in given if isinstance(value, Quantity)]
            counted = [one for one in given if f"number of {one[0].rpartition('.')[2]}" in found.inputs]
            stated += [(place, Quantity(float(value), 0.0, "1")) for place, value in counted]
            found = found._replace(checks=[*found.checks, *uncertainties_stated(settings)], stated=stated)
            made = judgement(found, titles)
            return made.assign_attrs(exact=json.dumps(exact_values(settings)), experiment=context.experiment)

        vars(judged)["inputs"] = (*names, *rests_on)
        return judged

    return of_scene
