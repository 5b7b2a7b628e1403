"""Checks of relaxation tests: commands, columns, cell, punch, and the forces at several depths."""

from math import nan

from labpipe.units import Quantity
from labpipe.workflow.context import Context
from pipelines.experiments.relaxation.comparison import rows
from pipelines.experiments.relaxation.settings import Relaxation
from pipelines.experiments.shared import judgements, mach1_checks
from pipelines.experiments.shared.given import Given
from pipelines.experiments.shared.judgements import Scene
from pipelines.experiments.shared.model_inputs import inputs_of

_STEPS = ("readings", "loads", "ramps", "comparison")


@judgements.judging(
    *_STEPS, rests_on=("substrate.material_from",), expected=("comparison",), titles=mach1_checks.TITLES
)
def judgement(given: Given, settings: Relaxation, context: Context) -> Scene:
    """Judge all relaxation tests of an experiment; a step without a result is judged by its error."""
    steps = [given.get(step) or [None] * len(settings.mach1) for step in _STEPS]
    tested, inputs = [], dict[str, Quantity]()
    for name, read, load, ramps, compared in zip(settings.mach1, *steps, strict=True):
        depth = nan if ramps is None else float(ramps["depth"].max())
        force = expected = nan
        if load is not None and load.attrs["is_tared"] and compared is not None and "plateau_force_model" in compared:
            force, expected = float(ramps["plateau_force"][-1]), float(compared["plateau_force_model"][-1])
        tested.append(mach1_checks.Tested(name, read, load, depth, force, expected))
        inputs |= inputs_of(compared)
    return mach1_checks.scene(tested, inputs, rows, given, settings, context)
