"""The indentation simulated with the measured displacement."""

from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from labpipe.signals import common_fit
from pipelines.experiments.harmonic.measured import COLUMNS
from pipelines.experiments.harmonic.settings import Harmonic
from pipelines.experiments.shared import mach1_readings
from pipelines.experiments.shared.material_choice import resolve
from pipelines.experiments.shared.punch_model import Geometry, simulated

Array = NDArray[np.float64]


def model(
    loads: xr.Dataset,
    oscillations: xr.Dataset,
    material_file: Path | None,
    fitted: xr.Dataset | None,
    *,
    settings: Harmonic,
) -> xr.Dataset:
    """Simulate the whole history of the file with the measured displacement.

    Without punch and substrate there is nothing to simulate; the result is then empty and says so.
    """
    punch, substrate = settings.punch, settings.substrate
    if punch is None or substrate is None:
        reason = "session.toml names no punch and no substrate, so nothing was simulated"
        return xr.Dataset(attrs={"absent": reason})
    touch, how = mach1_readings.contact_position(loads, settings.contact)
    solid = resolve(substrate, material_file, fitted)
    geometry = Geometry.of(punch, substrate, settings.model, float(solid.nu))
    force, u_force, attrs = simulated(loads, touch, solid, geometry)
    result = _model_rows(loads, oscillations, force, u_force)
    result["contact_position"] = (
        (), touch.value, {"units": "m", "long_name": "stage position of first touch"},
    )  # fmt: skip
    result["u_contact_position"] = (
        (), touch.u, {"units": "m", "long_name": "standard uncertainty: position of first touch"},
    )  # fmt: skip
    result.attrs |= attrs | {"contact": how}
    return result


def _model_rows(
    loads: xr.Dataset, oscillations: xr.Dataset, force: Array, u_force: Array
) -> xr.Dataset:
    """Fit the simulated force as the measured one was, and keep its curve beside the readings."""
    rows, lost = [], []
    for i in range(oscillations.sizes["oscillation"]):
        at = oscillations.isel(oscillation=i)
        where = mach1_readings.rows(loads, int(at["block"]))
        time = loads["time"].values[where]
        used = (time >= float(at["begin"])) & (time <= float(at["end"]))
        x = loads["position_z"].values[where][used]
        fit = common_fit(time[used], x, force[where][used], float(at["frequency"]))
        shifted = common_fit(time[used], x, (force - u_force)[where][used], float(at["frequency"]))
        rows.append((fit, shifted))
        lost.append(float(np.mean(force[where][used] <= 0.0)))
    table: dict[str, Any] = {
        "force": ("sample", force, {"units": "N", "long_name": "simulated force"}),
        "u_force": (
            "sample", u_force,
            {"units": "N", "long_name": "standard uncertainty from first touch and punch"},
        ),
        "contact_loss": (
            "oscillation", np.array(lost),
            {"units": "1", "long_name": "share of a cycle without contact, simulated"},
        ),
    }  # fmt: skip
    for name in ("storage_stiffness", "loss_stiffness"):
        values = np.array([getattr(fit, name) for fit, _ in rows])
        moved = np.array([getattr(shifted, name) for _, shifted in rows])
        units, text = COLUMNS[name]
        table[name] = ("oscillation", values, {"units": units, "long_name": f"{text}, simulated"})
        table[f"u_{name}"] = (
            "oscillation", np.abs(moved - values),
            {"units": units, "long_name": f"standard uncertainty, touch and punch: {text}"},
        )  # fmt: skip
    amplitude = np.array([fit.position.amplitude for fit, _ in rows])
    for prefix in ("", "u_"):
        table[f"{prefix}work_per_cycle"] = (
            "oscillation", np.pi * amplitude**2 * table[f"{prefix}loss_stiffness"][1],
            {"units": "J", "long_name": f"{prefix and 'standard uncertainty: '}simulated work"},
        )  # fmt: skip
    return xr.Dataset(table, coords={"oscillation": oscillations["oscillation"]})
