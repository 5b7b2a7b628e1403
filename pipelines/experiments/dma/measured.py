"""Dynamic mechanical analysis: isothermal sweeps, master curve, and the glass transition."""

from pathlib import Path

import numpy as np
import xarray as xr

import instruments
from labpipe.arrays import Floats
from labpipe.errors import InputError, SourceError
from labpipe.materials import gather_sweeps, modulus_factor, trusted_tables, with_responses
from labpipe.variables import variable
from pipelines.experiments.dma import glass_transition
from pipelines.experiments.dma.settings import Dma
from pipelines.experiments.shared.settings import named_columns

_ONE_FREQUENCY = 0.01  # relative spread below which a run has a constant frequency
_LEAST_RAMP = 10.0  # K that a temperature sweep covers at least


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
    stated = _stated(path, settings)
    if stated is None:
        return with_responses(found)
    if "temperature" in found:
        raise InputError(
            f"{path.name} has a column of temperature, and the session states {stated:g} °C for it; "
            "delete one of them (temperature or temperatures in session.toml)"
        )
    constant = np.full(found.sizes["sample"], stated)
    return with_responses(
        found.assign(temperature=variable("sample", constant, "degC", "temperature, as the session states it"))
    )


def _stated(path: Path, settings: Dma) -> float | None:
    """Return the temperature that the session states for a file."""
    if not settings.temperatures:
        return None if settings.temperature is None else settings.temperature.value
    if settings.temperature is not None or len(settings.temperatures) != len(settings.rheometer):
        message = (
            f"temperatures holds {len(settings.temperatures)} values for {len(settings.rheometer)} files"
            if settings.temperature is None
            else "temperature and temperatures are both given; keep one of them"
        )
        raise InputError(message)
    at = next(k for k, name in enumerate(settings.rheometer) if path.as_posix().endswith(Path(name).as_posix()))
    return settings.temperatures[at].value


def gathered(readings: list[xr.Dataset], *, settings: Dma) -> xr.Dataset:
    """Gather the isothermal sweeps of all exports."""
    options = settings.sweeps
    made = gather_sweeps(
        readings, settings.mode, settings.nu.value, tolerance=options.tolerance,
        fewest=options.fewest, skip_first=options.skip_first,
    )  # fmt: skip
    u_factor = 2.0 * settings.nu.u if settings.is_shear else 0.0
    made.attrs["u_modulus_factor"] = u_factor
    scale = settings.scale
    for name in ("storage", "loss"):
        made[name] = made[name].copy(data=made[name].values * scale.value)
    made.attrs["u_scale"] = scale.u / scale.value
    return made


def temperature_sweep(readings: list[xr.Dataset], *, settings: Dma) -> xr.Dataset:
    """Find the glass transition in sweeps of temperature at one frequency, if there are any."""
    factor = modulus_factor(settings.mode, settings.nu.value) * settings.scale.value
    ramps = []
    for run in (run for dataset in readings for run in trusted_tables(dataset) if run.rows.size):
        frequency, T = run.values("frequency"), run.values("temperature")
        constant = np.ptp(frequency) < _ONE_FREQUENCY * np.median(frequency)
        if constant and np.ptp(T) >= _LEAST_RAMP and T.size >= glass_transition.FEWEST:
            moduli = (factor * run.values(name) for name in ("storage_modulus", "loss_modulus"))
            ramps.append(glass_transition.Ramp(float(np.median(frequency)), T, *moduli))
    if not ramps:
        return xr.Dataset(attrs={"absent": "the exports hold no temperature sweep at one frequency"})
    return glass_transition.transitions(ramps)


def shift_table(path: Path, settings: Dma) -> tuple[Floats, Floats]:
    """Read a table of temperatures [degC] and log10 a_T, ascending in temperature."""
    options = settings.export
    read = instruments.read_table(path, "sweep", "plain_table", encoding=options.encoding, decimal=options.decimal)
    if "log10_aT" not in read:
        text = "found no column log_aT; this is not a table of shift factors"
        raise SourceError(path, text, line=1, hint="Begin the file with T,log_aT and a row of units such as C,-.")
    T, shift = read["temperature"].values, read["log10_aT"].values
    good = np.isfinite(T) & np.isfinite(shift)
    ascending, first = np.unique(T[good], return_index=True)
    return ascending, shift[good][first]


def shifts_at(table: tuple[Floats, Floats], T: Floats) -> Floats:
    """Interpolate a table of shifts; set temperatures are rounded, so half their spacing beyond the ends counts."""
    x, y = table
    if x.size < 2:
        return np.full(T.size, np.nan)
    reach = 0.5 * float(np.median(np.diff(x)))
    low = y[0] - reach * (y[1] - y[0]) / (x[1] - x[0])
    high = y[-1] + reach * (y[-1] - y[-2]) / (x[-1] - x[-2])
    knots, values = np.concatenate([[x[0] - reach], x, [x[-1] + reach]]), np.concatenate([[low], y, [high]])
    return np.asarray(np.interp(T, knots, values, left=np.nan, right=np.nan))
