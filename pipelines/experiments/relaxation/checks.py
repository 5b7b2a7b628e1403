"""Checks of relaxation tests: commands, columns, cell, punch, and the forces at several depths."""

from collections.abc import Sequence
from math import exp, log

import numpy as np
import xarray as xr

from labpipe.judging import DOUBTFUL, Cause, Check, Level, in_words, judge, not_made, too_large
from labpipe.units import Quantity
from labpipe.workflow.context import Context
from pipelines.experiments.relaxation.comparison import rows
from pipelines.experiments.relaxation.settings import Relaxation
from pipelines.experiments.shared import judgements, mach1_checks
from pipelines.experiments.shared.comparison_rows import FORCE_SCALE, STIFFNESS
from pipelines.experiments.shared.given import Given
from pipelines.experiments.shared.judgements import Scene
from pipelines.experiments.shared.mach1_checks import RATIO
from pipelines.experiments.shared.punch_model import inputs_of
from pipelines.experiments.shared.ramps_and_holds import relative_gain

_OF_DEPTHS = log(1.5)
"""By which forces over those of the model may differ from depth to depth: layers, rough tips, a touch found late."""
_NO_TOUCH = "the position of first touch, or the punch in session.toml, is wrong"
_FAILED = {
    "loads": "the file, or the record of its load cell, does not belong to this test",
    "ramps": "the stage was not moved and held, or its column is wrong",
    "curves": _NO_TOUCH,
    "model": _NO_TOUCH,
}
_STEPS = ("readings", "loads", "ramps", "comparison")


@judgements.judging(
    *_STEPS,
    "tests",
    rests_on=("substrate.material_from",),
    expected=("comparison", "tests"),
    titles=mach1_checks.TITLES,
)
def judgement(given: Given, basis: judgements.Basis, settings: Relaxation, context: Context) -> Scene:
    """Judge all relaxation tests of an experiment; a step without a result is judged by its error."""
    files, tests = settings.mach1, given.get("tests")
    of_files = {step: given.get(step) or [None] * len(files) for step in _STEPS}
    checks: list[Check] = []
    ratios: list[tuple[str, float]] = []
    for name, read, load, ramp, compared in zip(files, *of_files.values(), strict=True):
        found = _of_file(name, read, load, ramp, compared)
        causes: list[Cause] = []
        if read is not None and any(check.level for check in found):
            causes = list(mach1_checks.causes(name, read, settings.punch, settings.load_cell, found))
        ratios += [(name, check.log_ratio) for check in found if check.name == RATIO and np.isfinite(check.log_ratio)]
        # a mistake in one file does not show in the others
        checks += judge(mach1_checks.weighed(found), causes).checks
    known = {name: one for name, one in zip(files, of_files["readings"], strict=True) if one is not None}
    checks.append(mach1_checks.of_files(known))
    loads = [load for load in of_files["loads"] if load is not None]
    if loads:
        checks += mach1_checks.of_cell(settings.load_cell, loads[0])
    if not any(check.level == "impossible" for check in checks):
        checks.append(_one_specimen(ratios))
    if mach1_checks.knows_depth(checks):
        depths = [float(ramp["depth"].max()) for ramp in of_files["ramps"] if ramp is not None]
        deepest = max((depth for depth in depths if np.isfinite(depth)), default=np.nan)
        checks += mach1_checks.of_punch(settings.punch, settings.model, deepest)
    checks += mach1_checks.placed(judgements.failed_steps(context, _FAILED), *files, settings.load_cell.record)
    relative = relative_gain(loads[-1]) if loads else 0.0
    inputs = {FORCE_SCALE: Quantity(1.0, relative, "1"), STIFFNESS: Quantity(1.0, 0.0, "1")} | inputs_of(tests)
    return Scene(checks, (), given.each([rows]), inputs, basis=basis)


def _one_specimen(ratios: Sequence[tuple[str, float]]) -> Check:
    """Compare the forces of the files, each over that of the model at its depth."""
    name = "force at other depths"
    if len(ratios) < 2:
        return not_made(name, "two files, and a model")
    logs = np.array([ratio for _, ratio in ratios])
    worst = int(np.argmax(np.abs(logs - np.median(logs))))
    others = float(np.mean(np.delete(logs, worst)))
    gap, file = float(logs[worst]) - others, ratios[worst][0]
    text = (
        f"{file}: {in_words(exp(logs[worst]))} times the simulated force, {in_words(exp(others))} times in the others"
    )
    level: Level | None = "impossible" if abs(gap) > log(3.0) else "doubtful" if abs(gap) > _OF_DEPTHS else None
    cause = (
        f"the forces of {file} are {too_large(exp(gap))}: its scale, the specimen, the punch or the position "
        "of first touch is another than in the other files"
    )
    if len(ratios) == 2 and level:
        cause = f"the scale, the specimen or the punch of {ratios[0][0]} and {ratios[1][0]} are not the same"
    return Check(name, text, level, gap / _OF_DEPTHS * DOUBTFUL, cause=cause, file=file)


def _of_file(
    name: str,
    readings: xr.Dataset | None,
    loads: xr.Dataset | None,
    ramps: xr.Dataset | None,
    comparison: xr.Dataset | None,
) -> list[Check]:
    if readings is None:
        return [not_made(mach1_checks.SWAPPED, "a file that can be read")]
    checks = mach1_checks.of_file(name, readings)
    if mach1_checks.is_swapped(checks):
        return checks
    if ramps is None or loads is None or not bool(loads.attrs["is_tared"]) or not mach1_checks.knows_depth(checks):
        return checks
    force, expected = float(ramps["plateau_force"][-1]), np.nan
    if comparison is not None and "plateau_force_model" in comparison:
        expected = float(comparison["plateau_force_model"][-1])
    return [*checks, mach1_checks.of_force(name, force, expected)]
