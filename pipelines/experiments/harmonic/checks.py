"""Whether a harmonic indentation can be believed: commands, columns, cell, punch and phase."""

import numpy as np
import xarray as xr

from labpipe.judging import Check, not_made
from labpipe.units import Quantity
from labpipe.workflow.context import Context
from pipelines.experiments.harmonic.comparison import DELAY, rows
from pipelines.experiments.harmonic.settings import Harmonic
from pipelines.experiments.shared import judgements, mach1_checks, mach1_readings
from pipelines.experiments.shared.comparison_rows import FORCE_SCALE, STIFFNESS
from pipelines.experiments.shared.given import Given
from pipelines.experiments.shared.judgements import Scene
from pipelines.experiments.shared.punch_model import TOUCH, inputs_of
from pipelines.experiments.shared.ramps_and_holds import relative_gain

_FAILED = {
    "loads": "the file, or the record of its load cell, does not belong to this test",
    "oscillations": "the file does not hold the oscillations that it declares",
    "hold": "the stage was not held, or its column is wrong",
    "model": "the position of first touch, or the punch in session.toml, is wrong",
    "theory": "the position of first touch, or the punch in session.toml, is wrong",
}


_STEPS = ("readings", "loads", "hold", "oscillations", "model", "comparison")


@judgements.judging(*_STEPS, rests_on=("substrate.material_from",), titles=mach1_checks.TITLES)
def judgement(given: Given, basis: judgements.Basis, settings: Harmonic, context: Context) -> Scene:
    """Judge one harmonic indentation; what gave no result is judged by that."""
    readings, loads, _, oscillations, model, _ = map(given.get, _STEPS)
    name = settings.mach1
    checks: list[Check] = []
    if readings is None:
        checks.append(not_made("columns of the file", "a file that can be read"))
    else:
        checks += mach1_checks.of_file(name, readings)
    if loads is not None:
        checks += mach1_checks.of_cell(settings.load_cell, loads)
    if oscillations is not None:
        lag, u, frequency = (oscillations[n].values for n in ("phase_lag", "u_phase_lag", "frequency"))
        worst = int(np.argmax(np.abs(lag - np.pi / 4)))  # the loss angle that lies furthest outside
        at, u_at, hertz = (float(each[worst]) for each in (lag, u, frequency))
        checks.append(mach1_checks.phase(name, at, u_at, hertz, settings.load_cell.record))
    if mach1_checks.knows_depth(checks):
        depth, force, expected = given.ask(_worked)
        deepest = depth + (0.0 if oscillations is None else float(oscillations["amplitude"].max()))
        checks += mach1_checks.of_punch(settings.punch, settings.model, deepest)
        checks.append(mach1_checks.of_force(name, force, expected))
    failed = mach1_checks.placed(judgements.failed_steps(context, _FAILED), name, settings.load_cell.record)
    checks = [*mach1_checks.weighed(checks), *failed]
    causes = []
    if readings is not None:
        causes = list(mach1_checks.causes(name, readings, settings.punch, settings.load_cell, checks))
    relative = 0.0 if loads is None else relative_gain(loads)
    inputs = {FORCE_SCALE: Quantity(1.0, relative, "1"), STIFFNESS: Quantity(1.0, 0.0, "1")}
    inputs |= inputs_of(model)
    if loads is not None:
        inputs[DELAY] = mach1_readings.filter_delay(loads)
    shared = {TOUCH: inputs.pop(TOUCH)} if TOUCH in inputs else {}
    return Scene(checks, causes, given.each([rows]), inputs, shared, basis)


def _worked(
    loads: xr.Dataset | None = None,
    hold: xr.Dataset | None = None,
    oscillations: xr.Dataset | None = None,
    model: xr.Dataset | None = None,
    comparison: xr.Dataset | None = None,
) -> tuple[float, float, float]:
    """Return depth [m], force [N], and the force of the model where it is known, of one state."""
    if oscillations is not None and loads is not None and bool(loads.attrs["is_tared"]):
        force = float(oscillations["mean_force"][0])
        if model is not None and "contact_position" in model:
            depth = float(oscillations["mean_position"][0]) - float(model["contact_position"])
            expected = np.nan
            if comparison is not None and "bias" in comparison:
                expected = force - float(comparison["bias"][0])
            return depth, force, expected
    if hold is not None and "depth" in hold:
        names = ("depth", "plateau_force")
        depth, force = (float(hold[name].values[-1]) if hold[name].size else np.nan for name in names)
        return depth, force, np.nan
    return np.nan, np.nan, np.nan
