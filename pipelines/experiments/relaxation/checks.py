"""Checks of relaxation tests: commands, columns, cell, punch, and the forces at several depths."""

from labpipe.workflow.context import Context
from pipelines.experiments.relaxation.comparison import rows
from pipelines.experiments.relaxation.settings import Relaxation
from pipelines.experiments.shared import judgements, mach1_checks
from pipelines.experiments.shared.given import Given
from pipelines.experiments.shared.judgements import Scene

_STEPS = ("readings", "loads", "ramps", "comparison")


@judgements.judging(
    *_STEPS, rests_on=("substrate.material_from",), expected=("comparison",), titles=mach1_checks.TITLES
)
def judgement(given: Given, settings: Relaxation, context: Context) -> Scene:
    """Judge all relaxation tests of an experiment; a step without a result is judged by its error."""
    return mach1_checks.scene("ramps", rows, given, settings, context)
