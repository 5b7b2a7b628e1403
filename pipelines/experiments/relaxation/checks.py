"""Checks of relaxation tests: commands, columns, cell, punch, and the forces at several depths."""

from collections.abc import Sequence
from math import exp, log

import numpy as np

from labpipe.judging import DOUBTFUL, Check, Level, in_words, not_made, too_large
from labpipe.units import Quantity
from labpipe.workflow.context import Context
from pipelines.experiments.relaxation.comparison import rows
from pipelines.experiments.relaxation.settings import Relaxation
from pipelines.experiments.shared import judgements, mach1_checks
from pipelines.experiments.shared.comparison_rows import FORCE_SCALE, STIFFNESS
from pipelines.experiments.shared.given import Given
from pipelines.experiments.shared.judgements import Scene
from pipelines.experiments.shared.model_inputs import inputs_of
from pipelines.experiments.shared.punch_checks import NO_TOUCH, OF_LOADS, Tested, of_tests
from pipelines.experiments.shared.ramps_and_holds import relative_gain

_OF_DEPTHS = log(1.5)
"""By which forces over those of the model may differ from depth to depth: layers, rough tips, a touch found late."""
_FAILED = {
    "loads": OF_LOADS,
    "ramps": "the stage was not moved and held, or its column is wrong",
    "curves": NO_TOUCH,
    "model": NO_TOUCH,
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
    files, none = settings.mach1, [None] * len(settings.mach1)
    steps = [given.get(step) or none for step in _STEPS]
    tested = []
    for name, read, load, ramps, compared in zip(files, *steps, strict=True):
        depth = np.nan if ramps is None else float(ramps["depth"].max())
        force = expected = np.nan
        if load is not None and load.attrs["is_tared"] and compared is not None and "plateau_force_model" in compared:
            force, expected = float(ramps["plateau_force"][-1]), float(compared["plateau_force_model"][-1])
        tested.append(Tested(name, read, load, depth, force, expected))
    checks = of_tests(tested, settings, context, _FAILED)
    known = {test.name: test.readings for test in tested if test.readings is not None}
    checks.append(mach1_checks.of_files(known))
    if not any(check.level == "impossible" for check in checks):
        ratios = [(c.file, c.log_ratio) for c in checks if c.name == mach1_checks.RATIO and np.isfinite(c.log_ratio)]
        checks.append(_one_specimen(ratios))
    relative = next((relative_gain(test.loads) for test in reversed(tested) if test.loads is not None), 0.0)
    inputs = {FORCE_SCALE: Quantity(1.0, relative, "1"), STIFFNESS: Quantity(1.0, 0.0, "1")}
    inputs |= inputs_of(given.get("tests"))
    source = judgements.measured_by(settings.substrate)
    return Scene(checks, (), given.each([rows]), inputs, basis=basis, measured_by=source)


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
