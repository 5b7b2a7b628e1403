"""Comparison of a harmonic indentation with the model: force over time, and work per cycle."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import xarray as xr

from labpipe.signals import nrmse
from labpipe.variables import variable
from pipelines.experiments.harmonic.measured import evaluated
from pipelines.experiments.harmonic.settings import Harmonic
from pipelines.experiments.shared import mach1_readings
from pipelines.experiments.shared.comparison_rows import (
    FORCE_SCALE,
    STIFFNESS,
    STRETCHES,
    Row,
    curve_row,
    curve_table,
    row,
    with_its_u,
)
from pipelines.experiments.shared.model_inputs import inputs_of, table_of
from pipelines.experiments.shared.punch_model import laid_along

_PARTS = 4 * STRETCHES
"""Stretches of a cycle that are compared, as many in each quarter as in a part of another curve."""


def comparison(loads: xr.Dataset, oscillations: xr.Dataset, model: xr.Dataset, *, settings: Harmonic) -> xr.Dataset:
    """Lay the simulated force, filtered as the cell filters, over the measured one."""
    del settings
    if "absent" in model.attrs:
        return xr.Dataset(attrs={"absent": model.attrs["absent"]})
    agreed = []
    measured, simulated = loads["force"].values, mach1_readings.passed(loads, model["force"].values)
    for i in range(oscillations.sizes["oscillation"]):
        at = oscillations.isel(oscillation=i)
        where, used = evaluated(loads, at)
        samples = where.start + np.flatnonzero(used)
        passed, force = simulated[samples], measured[samples]
        cycles = (loads["time"].values[samples] - float(at["begin"])) * float(at["frequency"])
        part = np.floor(_PARTS * (cycles % 1.0))
        places = [samples[part == number] for number in range(_PARTS)]
        along = laid_along(loads, measured, simulated, places, model)
        agreed.append((along, nrmse(force, passed), float(np.mean(force - passed))))
    table = curve_table("oscillation", agreed, "N")
    table["simulated_force"] = variable("sample", simulated, "N", "simulated force, filtered")
    inputs = inputs_of(model) | {DELAY: mach1_readings.filter_delay(loads)}
    return xr.Dataset(table, coords={"oscillation": oscillations["oscillation"]}).merge(table_of(inputs))


DELAY = "delay of the force"
"""Input of the rows where the load cell's filter was taken out: it turns the phases of all frequencies."""


def rows(comparison: xr.Dataset, oscillations: xr.Dataset, model: xr.Dataset) -> Iterator[Row]:
    """Yield the rows of ``compare``; none where nothing is simulated."""
    if "nrmse" not in comparison:
        return
    inputs = inputs_of(model)
    late: dict[str, Any] = {}
    if bool(oscillations.attrs["is_filter_corrected"]):  # change by which the delay is stated too long
        omega = 2.0 * np.pi * oscillations["frequency"].values
        storage, loss = (oscillations[f"{part}_stiffness"].values for part in ("storage", "loss"))
        work = np.pi * oscillations["amplitude"].values ** 2 * omega * storage
        late = {"storage_stiffness": -omega * loss, "work_per_cycle": work}
    for i in range(oscillations.sizes["oscillation"]):
        condition = f"{float(oscillations['frequency'][i]):.3g} Hz"
        yield curve_row("force", "N", 1, comparison.isel(oscillation=i), condition=condition)
        for title, unit, name in (
            ("storage stiffness", "N/m", "storage_stiffness"),
            ("dissipated work per cycle", "J", "work_per_cycle"),
        ):
            yield row(
                title,
                unit,
                1,
                slopes={FORCE_SCALE: float(oscillations[name][i]), STIFFNESS: -float(model[name][i])}
                | {known: -float(slope) for known, slope in zip(inputs, model[f"slope_{name}"].values[i], strict=True)}
                | ({DELAY: float(late[name][i])} if late else {}),
                condition=condition,
                measured=with_its_u(oscillations, name, i),
                model=with_its_u(model, name, i),
            )
