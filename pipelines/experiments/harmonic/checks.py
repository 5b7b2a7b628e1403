"""Checks of a harmonic indentation: commands, columns, cell and punch."""

import numpy as np
import xarray as xr

from labpipe.units import Quantity
from labpipe.workflow.context import Context
from pipelines.experiments.harmonic.comparison import DELAY, rows
from pipelines.experiments.harmonic.settings import Harmonic
from pipelines.experiments.shared import judgements, mach1_checks, mach1_readings
from pipelines.experiments.shared.comparison_rows import FORCE_SCALE, STIFFNESS
from pipelines.experiments.shared.given import Given
from pipelines.experiments.shared.judgements import Scene
from pipelines.experiments.shared.mach1_checks import NO_TOUCH, OF_LOADS, Tested, of_tests
from pipelines.experiments.shared.mach1_readings import relative_gain
from pipelines.experiments.shared.model_inputs import inputs_of
from pipelines.experiments.shared.punch_model import TOUCH

_FAILED = {
    "loads": OF_LOADS,
    "oscillations": "the file does not hold the oscillations that it declares",
    "model": NO_TOUCH,
    "theory": NO_TOUCH,
}
_STEPS = ("readings", "loads", "oscillations", "model", "comparison")


@judgements.judging(*_STEPS, rests_on=("substrate.material_from",), titles=mach1_checks.TITLES)
def judgement(given: Given, basis: judgements.Basis, settings: Harmonic, context: Context) -> Scene:
    """Judge one harmonic indentation; a step without a result is judged by its error."""
    loads, model = given.get("loads"), given.get("model")
    checks = of_tests([given.ask(_tested)], settings, context, _FAILED)
    relative = 0.0 if loads is None else relative_gain(loads)
    inputs = {FORCE_SCALE: Quantity(1.0, relative, "1"), STIFFNESS: Quantity(1.0, 0.0, "1")} | inputs_of(model)
    if loads is not None:
        inputs[DELAY] = mach1_readings.filter_delay(loads)
    shared = {TOUCH: inputs.pop(TOUCH)} if TOUCH in inputs else {}
    known = judgements.measured_by(settings.substrate)
    return Scene(checks, (), given.each([rows]), inputs, shared, basis, measured_by=known)


def _tested(
    settings: Harmonic,
    readings: xr.Dataset | None = None,
    loads: xr.Dataset | None = None,
    oscillations: xr.Dataset | None = None,
    comparison: xr.Dataset | None = None,
) -> Tested:
    """Return the recording with depth and mean force of its oscillations."""
    depth = force = expected = np.nan
    if oscillations is not None:
        deepest = oscillations["mean_position"] + oscillations["amplitude"] - oscillations["contact_position"]
        depth = float(deepest.max())
        if loads is not None and loads.attrs["is_tared"] and comparison is not None and "bias" in comparison:
            force = float(oscillations["mean_force"][0])
            expected = force - float(comparison["bias"][0])
    return Tested(settings.mach1, readings, loads, depth, force, expected)
