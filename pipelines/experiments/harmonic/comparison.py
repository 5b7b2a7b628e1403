"""Comparison of a harmonic indentation with the model: force over time, and work per cycle."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import xarray as xr

from labpipe.judging import along_curve, stretch_means, stretches
from labpipe.signals import nrmse
from labpipe.variables import variable
from pipelines.experiments.harmonic.measured import COLUMNS, evaluated
from pipelines.experiments.harmonic.settings import Harmonic
from pipelines.experiments.shared import mach1_readings
from pipelines.experiments.shared.comparison_rows import STRETCHES, Row, curve_row, curve_table, row, with_its_u
from pipelines.experiments.shared.model_inputs import slopes_of, table_of
from pipelines.experiments.shared.punch_model import effects, inputs_behind

_PARTS = 4 * STRETCHES
"""Stretches of a cycle that are compared, as many in each quarter as in a part of another curve."""


def comparison(loads: xr.Dataset, oscillations: xr.Dataset, model: xr.Dataset, *, settings: Harmonic) -> xr.Dataset:
    """Lay the simulated force, filtered as the cell filters, over the measured one."""
    del settings
    if "absent" in model.attrs:
        return xr.Dataset(attrs={"absent": model.attrs["absent"]})
    agreed = []
    measured, simulated = loads["force"].values, mach1_readings.passed(loads, model["force"].values)
    shared = effects(loads, simulated, model)
    for i in range(oscillations.sizes["oscillation"]):
        at = oscillations.isel(oscillation=i)
        where, used = evaluated(loads, at)
        samples = where.start + np.flatnonzero(used)
        passed, force = simulated[samples], measured[samples]
        cycles = (loads["time"].values[samples] - float(at["begin"])) * float(at["frequency"])
        part = np.floor(_PARTS * (cycles % 1.0))
        places = [samples[part == number] for number in range(_PARTS)]
        along = along_curve(*stretches(measured - simulated, places), stretch_means(shared, places))
        agreed.append((along, nrmse(force, passed), float(np.mean(force - passed))))
    table = curve_table("oscillation", agreed, "N")
    table["simulated_force"] = variable("sample", simulated, "N", "simulated force, filtered")
    inputs, is_late = inputs_behind(loads, model), bool(oscillations.attrs["is_filter_corrected"])
    omega = 2.0 * np.pi * oscillations["frequency"].values
    storage, loss = (omega * oscillations[f"{part}_stiffness"].values for part in ("storage", "loss"))
    work = np.pi * oscillations["amplitude"].values ** 2 * storage
    for name, late in (("storage_stiffness", -loss), ("work_per_cycle", work)):  # by a delay that is stated too long
        changes = [oscillations[name].values, -model[name].values, *(-model[f"slope_{name}"].values.T)]
        text = f"change with an input, SI: {COLUMNS[name][1]}, measured minus model"
        dims = ("uncertain", "oscillation")
        table[f"slope_{name}"] = variable(dims, np.array([*changes, *([late] if is_late else [])]), "1", text)
    inputs |= {DELAY: mach1_readings.filter_delay(loads)} if is_late else {}
    return xr.Dataset(table, coords={"oscillation": oscillations["oscillation"]}).merge(table_of(inputs))


DELAY = "delay of the force"
"""Input of the rows where the load cell's filter was taken out: it turns the phases of all frequencies."""


def rows(comparison: xr.Dataset, oscillations: xr.Dataset, model: xr.Dataset) -> Iterator[Row]:
    """Yield the rows of ``compare``; none where nothing is simulated."""
    if "nrmse" not in comparison:
        return
    for i in range(oscillations.sizes["oscillation"]):
        condition = f"{float(oscillations['frequency'][i]):.3g} Hz"
        yield curve_row("force", "N", 1, comparison.isel(oscillation=i), condition=condition)
        for name in ("storage_stiffness", "work_per_cycle"):
            unit, title = COLUMNS[name]
            seen, simulated = (with_its_u(one, name, i) for one in (oscillations, model))
            words: dict[str, Any] = {"condition": condition, "slopes": slopes_of(comparison, f"slope_{name}", i)}
            yield row(title, unit, 1, measured=seen, model=simulated, **words)
