"""Checks of a harmonic indentation: commands, columns, cell and punch."""

import numpy as np
import xarray as xr

from labpipe.judging import Check, bounded
from labpipe.report import value_with_uncertainty
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
    scene = mach1_checks.scene("oscillations", rows, given, settings, context, inputs)
    waves = given.get("oscillations")
    return scene if waves is None else scene._replace(checks=[*scene.checks, _passive(settings.mach1, waves)])


def _passive(file: str, waves: xr.Dataset) -> Check:
    """Compare the loss stiffness with zero: a solid dissipates work."""
    loss, u = waves["loss_stiffness"].values, waves["u_loss_stiffness"].values
    # where the storage is negative as well the force has the wrong sign, which another check says
    worst = int(np.argmin(np.where(waves["storage_stiffness"].values > 0.0, loss / u, np.inf)))
    where = f"{file}, block {int(waves['block'][worst]) + 1}, {float(waves['frequency'][worst]):.3g} Hz"
    cause = "the force leads or lags wrongly: filter_delay in the record of the load cell, or the sign of the force"
    text = f"{where}: loss stiffness {value_with_uncertainty(float(loss[worst]), float(u[worst]), 'N/m')}"
    value, of = float(loss[worst]), float(u[worst])
    return bounded(mach1_checks.LOSS, text, value, of, at_least=0.0, cause=cause, file=file)
