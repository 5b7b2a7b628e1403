"""Checks of a harmonic indentation: commands, columns, cell and punch."""

from typing import Any

import numpy as np

from labpipe.judging import bounded
from labpipe.report import value_with_uncertainty
from labpipe.workflow.context import Context
from pipelines.experiments.harmonic.comparison import rows
from pipelines.experiments.harmonic.settings import Harmonic
from pipelines.experiments.shared import judgements, mach1_checks
from pipelines.experiments.shared.given import Given
from pipelines.experiments.shared.judgements import Scene

_STEPS = ("readings", "loads", "oscillations", "model", "comparison")


@judgements.judging(*_STEPS, rests_on=("substrate.material_from",), titles=mach1_checks.TITLES)
def judgement(given: Given, settings: Harmonic, context: Context) -> Scene:
    """Judge one harmonic indentation; a step without a result is judged by its error."""
    scene, waves = mach1_checks.scene("oscillations", rows, given, settings, context), given.get("oscillations")
    if waves is None:
        return scene
    # a solid dissipates work
    loss, u = waves["loss_stiffness"].values, waves["u_loss_stiffness"].values
    # where the storage is negative as well the force has the wrong sign, which another check says
    worst = int(np.argmin(np.where(waves["storage_stiffness"].values > 0.0, loss / u, np.inf)))
    where = f"{settings.mach1}, block {int(waves['block'][worst]) + 1}, {float(waves['frequency'][worst]):.3g} Hz"
    cause = "the force leads or lags wrongly: filter_delay in the record of the load cell, or the sign of the force"
    text = f"{where}: loss stiffness {value_with_uncertainty(float(loss[worst]), float(u[worst]), 'N/m')}"
    place: dict[str, Any] = {"cause": cause, "file": settings.mach1}
    passive = bounded(mach1_checks.LOSS, text, float(loss[worst]), float(u[worst]), at_least=0.0, **place)
    return scene._replace(checks=[*scene.checks, passive])
