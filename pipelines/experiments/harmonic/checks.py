"""Checks of a harmonic indentation: commands, columns, cell and punch."""

from labpipe.workflow.context import Context
from pipelines.experiments.harmonic.comparison import DELAY, rows
from pipelines.experiments.harmonic.settings import Harmonic
from pipelines.experiments.shared import judgements, mach1_checks
from pipelines.experiments.shared.given import Given
from pipelines.experiments.shared.judgements import Scene
from pipelines.experiments.shared.mach1_readings import filter_delay
from pipelines.experiments.shared.model_inputs import inputs_of

_STEPS = ("readings", "loads", "oscillations", "model", "comparison")


@judgements.judging(*_STEPS, rests_on=("substrate.material_from",), titles=mach1_checks.TITLES)
def judgement(given: Given, settings: Harmonic, context: Context) -> Scene:
    """Judge one harmonic indentation; a step without a result is judged by its error."""
    loads = given.get("loads")
    inputs = inputs_of(given.get("model")) | ({} if loads is None else {DELAY: filter_delay(loads)})
    return mach1_checks.scene("oscillations", rows, given, settings, context, inputs)
