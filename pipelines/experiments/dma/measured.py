"""Dynamic mechanical analysis: isothermal sweeps, master curve, and the glass transition."""

from math import hypot
from pathlib import Path

import numpy as np
import xarray as xr

import instruments
from labpipe.errors import InputError
from labpipe.materials import form_factor, gather_sweeps, modulus_factor, trusted_rows, with_responses
from labpipe.uncertainty import Input, linear_budget
from labpipe.units import Quantity
from labpipe.variables import variable
from pipelines.experiments.dma import glass_transition
from pipelines.experiments.dma.settings import Dma
from pipelines.experiments.shared.exclusions import EXCLUDED, without_readings
from pipelines.experiments.shared.settings import named_columns


def readings(path: Path, *, settings: Dma) -> xr.Dataset:
    """Read one export, of a rheometer or as a table; of a stated temperature where it has none.

    Relaxation and creep tests become sweeps.
    """
    options = settings.export
    found = instruments.read_table(
        path,
        "sweep",
        "plain_table",
        encoding=options.encoding,
        decimal=options.decimal,
        columns=named_columns(options.columns),
        allow_incomplete=options.allow_incomplete,
    )
    found = without_readings(found, settings, "storage_modulus", "loss_modulus")
    if EXCLUDED in found:
        found["is_valid"] = found["is_valid"].where(found[EXCLUDED] == 0, 0)
    one, each, files = settings.temperature, settings.temperatures, settings.rheometer
    if each and one is not None:
        raise InputError("temperature and temperatures are both given; keep one of them")
    if each and len(each) != len(files):
        raise InputError(f"temperatures holds {len(each)} values for {len(files)} files")
    if each:
        one = each[next(k for k, name in enumerate(files) if path.as_posix().endswith(Path(name).as_posix()))]
    if one is None:
        return with_responses(found)
    if "temperature" in found:
        raise InputError(
            f"{path.name} has a column of temperature, and the session states {one.value:g} °C for it; "
            "delete one of them (temperature or temperatures in session.toml)"
        )
    constant = np.full(found.sizes["sample"], one.value)
    return with_responses(
        found.assign(temperature=variable("sample", constant, "degC", "temperature, as the session states it"))
    )


def sweeps(readings: list[xr.Dataset], *, settings: Dma) -> xr.Dataset:
    """Gather the isothermal sweeps of all exports."""
    options = settings.sweeps
    made = gather_sweeps(readings, settings.mode, settings.nu.value, tolerance=options.tolerance, fewest=options.fewest)
    scale, moduli = _scale(settings), ["storage", "loss"]
    strains = [run["strain"].values for run in readings if "strain" in run]
    if strains and np.isfinite(largest := np.nanmax(np.concatenate(strains))):
        made.attrs["strain"] = float(largest)  # up to which the moduli are known to be those of a linear solid
    made = made.assign({name: made[name].copy(data=made[name].values * scale.value) for name in moduli})
    u_factor = 2.0 * settings.nu.u if settings.is_shear else 0.0
    return made.assign_attrs(u_modulus_factor=u_factor, u_scale=scale.u / scale.value, scale=scale.value)


def _scale(settings: Dma) -> Quantity:
    """Return the factor of all moduli: the stated scale, and the specimen's form factor over that as entered."""
    specimen, scale = settings.specimen, settings.scale
    if specimen is None:
        return scale
    dimensions = specimen.given()
    inputs = {name: Input(value.value, value.u, value.si) for name, value in dimensions.items()}
    factor = linear_budget(lambda **sizes: form_factor(settings.mode, **sizes), inputs)
    entered = {name: value.value for name, value in (dimensions | specimen.entered.given()).items()}
    own = form_factor(settings.mode, **entered)
    value = scale.value * factor.value / own
    return Quantity(value, value * hypot(scale.u / scale.value, factor.u / factor.value), "1")


def ramps_of(readings: xr.Dataset, least: float = 10.0, spread: float = 0.01) -> list[xr.Dataset]:
    """Return the trusted readings of each sweep over ``least`` [K] at one frequency, of a relative ``spread``."""
    tables = [
        readings.isel(sample=rows) for rows in trusted_rows(readings) if rows.size >= 2 * glass_transition.MEAN_OF
    ]
    return [
        one
        for one in tables
        if np.ptp(f := one["frequency"].values) < spread * np.median(f) and np.ptp(one["temperature"].values) >= least
    ]


def temperature_sweep(readings: list[xr.Dataset], *, settings: Dma) -> xr.Dataset:
    """Find the glass transition in sweeps of temperature at one frequency, if there are any."""
    factor = modulus_factor(settings.mode, settings.nu.value) * _scale(settings).value
    ramps = []
    for run in (run for one in readings for run in ramps_of(one)):
        columns = (run["temperature"], factor * run["storage_modulus"], factor * run["loss_modulus"])
        ramps.append((float(run["frequency"].median()), np.array(columns)))
    if not ramps:
        return xr.Dataset(attrs={"absent": "the exports hold no temperature sweep at one frequency"})
    return glass_transition.transitions(ramps)
