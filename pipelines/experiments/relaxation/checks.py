"""Checks of relaxation tests: commands, columns, cell, punch, and the forces at several depths."""

import numpy as np

from labpipe.units import Quantity
from labpipe.workflow.context import Context
from pipelines.experiments.relaxation.comparison import rows
from pipelines.experiments.relaxation.settings import Relaxation
from pipelines.experiments.shared import judgements, mach1_checks
from pipelines.experiments.shared.comparison_rows import FORCE_SCALE, STIFFNESS
from pipelines.experiments.shared.given import Given
from pipelines.experiments.shared.judgements import Scene
from pipelines.experiments.shared.mach1_checks import NO_TOUCH, OF_LOADS, Tested, of_tests
from pipelines.experiments.shared.mach1_readings import relative_gain
from pipelines.experiments.shared.model_inputs import inputs_of

_FAILED = {
    "loads": OF_LOADS,
    "ramps": "the stage was not moved and held, or its column is wrong",
    "curves": NO_TOUCH,
    "model": NO_TOUCH,
}
_STEPS = ("readings", "loads", "ramps", "comparison")


@judgements.judging(
    *_STEPS, rests_on=("substrate.material_from",), expected=("comparison",), titles=mach1_checks.TITLES
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
    relative = next((relative_gain(test.loads) for test in reversed(tested) if test.loads is not None), 0.0)
    inputs = {FORCE_SCALE: Quantity(1.0, relative, "1"), STIFFNESS: Quantity(1.0, 0.0, "1")}
    for compared in steps[-1]:
        inputs |= inputs_of(compared)
    source = judgements.measured_by(settings.substrate)
    return Scene(checks, (), given.each([rows]), inputs, basis=basis, measured_by=source)
