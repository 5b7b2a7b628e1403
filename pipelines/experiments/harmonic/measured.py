"""Harmonic indentation: oscillations of a periodic punch in rubber."""

import json

import numpy as np
import xarray as xr

from labpipe import signals
from labpipe.arrays import Complexes, Flags, Floats
from labpipe.errors import InputError
from labpipe.signals import common_fit
from labpipe.variables import from_rows, variable, with_u
from pipelines.experiments.harmonic.settings import Harmonic
from pipelines.experiments.shared import mach1_readings

_LOOP_POINTS = 200  # over one cycle
_WAVES = 3  # of a Fourier series: the fundamental and two harmonics
COLUMNS = {
    "storage_stiffness": ("N/m", "storage stiffness"),
    "loss_stiffness": ("N/m", "loss stiffness"),
    "work_per_cycle": ("J", "dissipated work per cycle"),
    "frequency": ("Hz", "frequency, fitted to the position"),
    "amplitude": ("m", "amplitude of the position"),
    "force_amplitude": ("N", "amplitude of the force"),
    "phase_lag": ("rad", "lead of the force over the position"),
    "fourier_storage_stiffness": ("N/m", "storage stiffness by the Fourier components of whole cycles"),
    "fourier_loss_stiffness": ("N/m", "loss stiffness by the Fourier components of whole cycles"),
    "harmonic_2": ("1", "second harmonic of the force over its fundamental"),
    "harmonic_3": ("1", "third harmonic of the force over its fundamental"),
    "position_harmonic_2": ("1", "second harmonic of the position over its fundamental"),
    "position_harmonic_3": ("1", "third harmonic of the position over its fundamental"),
    "declared_frequency": ("Hz", "frequency in the header"),
    "work_sd": ("J", "standard deviation of the loop area over cycles"),
    "loop_area": ("J", "mean area of the recorded loops, filter lag included"),
    "mean_force": ("N", "mean force"),
    "mean_position": ("m", "mean position of the stage"),
    "filter_phase": ("rad", "lag of the load cell's filter that was removed"),
    "filter_gain": ("1", "gain of the load cell's filter that was divided by"),
    "n_cycles": ("1", "evaluated cycles"),
    "begin": ("s", "begin of the evaluated cycles, in the block's time"),
    "end": ("s", "end of the evaluated cycles, in the block's time"),
    "block": ("1", "number of the block in the file"),
}


def evaluated(loads: xr.Dataset, oscillation: xr.Dataset) -> tuple[slice, Flags]:
    """Return the rows of a file that hold an oscillation, and which of them its fit took."""
    rows = mach1_readings.rows(loads, int(oscillation["block"]))
    time = loads["time"].values[rows]
    return rows, (time >= float(oscillation["begin"])) & (time <= float(oscillation["end"]))


def oscillations(loads: xr.Dataset, *, settings: Harmonic) -> xr.Dataset:
    """Fit every Sinusoid block: frequency, stiffness, work; one row per block.

    Raises
    ------
    InputError
        There is no such block, or one holds fewer than two whole cycles after the transient.
    """
    blocks = mach1_readings.blocks_of(loads, settings.function)
    declared, touch = mach1_readings.declared_filter(loads), mach1_readings.first_touch(loads, settings.contact)
    rows = [_oscillation(loads, block, settings.cycles.skip) for block in blocks]
    made = xr.Dataset(
        from_rows("oscillation", rows, COLUMNS), coords={"oscillation": np.arange(1, len(rows) + 1)}
    ).merge(touch)
    return made.assign_attrs(
        touch.attrs,
        filter=json.dumps(declared),
        filter_delay=loads.attrs["filter_delay"],
        is_filter_corrected=int(declared is not None),
        work=json.dumps({"cycles_fitted": int(sum(r["n_cycles"] for r in rows))}),
    )


def _oscillation(loads: xr.Dataset, block: int, skip: int) -> dict[str, float]:
    """Return stiffness and work of one block without its transient and last cycle; the cell's filter is taken out."""
    part = loads.isel(sample=mach1_readings.rows(loads, block))
    time, position, force = (part[n].values for n in ("time", "position_z", "force"))
    # of another tester's table nothing is declared
    stated = float(loads["declared_frequency"][block]) if "declared_frequency" in loads else np.nan
    window = signals.active_window(time, position, stated if np.isfinite(stated) else None)
    period = 1 / window.frequency
    last = round((window.end - window.start) / period) - 1
    if last - skip < 2:  # one cycle has no spread
        raise InputError(
            f"{last + 1} cycles ran, of which the first {skip} are the transient and the last is "
            "cut: fewer than two are left; lower cycles.skip"
        )
    begin, end = window.start + skip * period, window.start + last * period
    interval = float(np.median(np.diff(time)))
    # one sample beyond either end, so that whole cycles can be cut by interpolation
    used = (time >= begin - interval) & (time <= end + interval)

    def response(f: float) -> complex:
        at = mach1_readings.force_lag(loads, f)
        return at.gain * complex(np.exp(-1j * at.phase))

    lag = mach1_readings.force_lag(loads, window.frequency)
    fit = common_fit(time[used], position[used], force[used], window.frequency, response=response)
    x, f, storage, loss = fit.position, fit.force, fit.storage_stiffness, fit.loss_stiffness
    u_gain = float(np.hypot(lag.u_gain / lag.gain, mach1_readings.relative_gain(loads)))
    u_phase = float(np.hypot(fit.u_phase_lag, lag.u_phase))
    noise = float(np.hypot(f.u_amplitude / f.amplitude, x.u_amplitude / x.amplitude))
    u_storage, u_loss = _u_of_stiffness(complex(storage, loss), float(np.hypot(noise, u_gain)), u_phase)

    areas = signals.hysteresis_loops(time, position, force, x.frequency, start=begin, end=end)
    spread = float(areas.std(ddof=1)) if areas.size > 1 else 0.0
    cycles = begin + np.arange(areas.size)[:, None] / x.frequency
    (moved, u_moved), (pushed, u_pushed) = (_fourier(time, y, cycles, x.frequency) for y in (position, force))
    passed = np.array([response(n * x.frequency) for n in range(1, _WAVES + 1)])
    pushed, u_pushed = pushed / passed, u_pushed / np.abs(passed)
    turned = complex(pushed[0] / moved[0])
    scatter = float(np.hypot(u_pushed[0] / abs(pushed[0]), u_moved[0] / abs(moved[0])))
    u_turned = _u_of_stiffness(turned, float(np.hypot(scatter, u_gain)), float(np.hypot(scatter, lag.u_phase)))
    found = {
        "frequency": (x.frequency, x.u_frequency),
        "amplitude": (x.amplitude, x.u_amplitude),
        "force_amplitude": (f.amplitude, float(np.hypot(f.u_amplitude, u_gain * f.amplitude))),
        "phase_lag": (fit.phase_lag, u_phase),
        "storage_stiffness": (storage, u_storage),
        "loss_stiffness": (loss, u_loss),
        "fourier_storage_stiffness": (turned.real, u_turned[0]),
        "fourier_loss_stiffness": (turned.imag, u_turned[1]),
        "work_per_cycle": (
            np.pi * loss * x.amplitude**2,
            float(np.hypot(np.pi * x.amplitude**2 * u_loss, spread / np.sqrt(max(areas.size, 1)))),
        ),
    }
    for name, lines, u_lines in (("harmonic", pushed, u_pushed), ("position_harmonic", moved, u_moved)):
        for n in range(2, _WAVES + 1):
            found[f"{name}_{n}"] = float(abs(lines[n - 1] / lines[0])), float(u_lines[n - 1] / abs(lines[0]))
    return {name: value for name, (value, _) in found.items()} | {
        **{f"u_{name}": u for name, (_, u) in found.items()},
        "work_sd": spread,
        "loop_area": float(areas.mean()),
        "n_cycles": float(areas.size),
        "declared_frequency": stated,
        "mean_force": f.offset,
        "mean_position": x.offset,
        "filter_phase": lag.phase,
        "filter_gain": lag.gain,
        "begin": begin,
        "end": end,
        "block": float(block),
    }


def _u_of_stiffness(stiffness: complex, u_relative: float, u_phase: float) -> tuple[float, float]:
    """Return the standard uncertainties of storage and loss, by those of size and phase."""
    parts = (stiffness.real, stiffness.imag), (stiffness.imag, stiffness.real)
    storage, loss = (float(np.hypot(u_relative * own, u_phase * other)) for own, other in parts)
    return storage, loss


def _fourier(time: Floats, values: Floats, begin: Floats, frequency: float) -> tuple[Complexes, Floats]:
    """Return the Fourier components (wave,) over whole cycles without their drift, and the uncertainty of each part."""
    share = np.linspace(0.0, 1.0, _LOOP_POINTS + 1)
    y = np.interp(begin + share / frequency, time, values)
    y -= share * (y[:, -1:] - y[:, :1])
    lines = 2.0 / _LOOP_POINTS * np.fft.rfft(y[:, :-1], axis=1)[:, 1 : _WAVES + 1]
    n = len(lines)
    scatter = np.abs(lines - lines.mean(axis=0))
    u = float(np.sqrt(np.sum(scatter**2) / (2.0 * _WAVES * max(n - 1, 1) * n)))
    seen = np.arange(1, _WAVES + 1) * frequency < 0.5 / float(np.median(np.diff(time)))
    return np.where(seen, lines.mean(axis=0), np.nan), np.where(seen, u, np.nan)


def loops(loads: xr.Dataset, oscillations: xr.Dataset, *, settings: Harmonic, clear: float = 2.0) -> xr.Dataset:
    """Average the loop of every oscillation, as recorded, and see whether contact is kept.

    Where the mean loop's force does not exceed its uncertainty, ``clear`` times, the punch has left the surface:
    ``contact_loss`` is that share of the cycle. The cell's filter rounds the force off, so that a loss shorter than its
    delay is not seen.
    """
    del settings
    phase = np.linspace(0, 1, _LOOP_POINTS + 1)
    positions, forces, u = [], [], []
    for i in range(oscillations.sizes["oscillation"]):
        at = oscillations.isel(oscillation=i)
        part = loads.isel(sample=mach1_readings.rows(loads, int(at["block"])))
        grid = float(at["begin"]) + (phase + np.arange(int(at["n_cycles"]))[:, None]) / float(at["frequency"])
        x, f = (np.interp(grid, part["time"].values, part[name].values) for name in ("position_z", "force"))
        # a slowly relaxing mean would smear the loops over each other
        f = f - f.mean(axis=1, keepdims=True) + f.mean()
        positions.append(x.mean(axis=0))
        forces.append(f.mean(axis=0))
        spread = float(np.median(f.std(axis=0, ddof=1))) if len(f) > 1 else 0.0
        noise = max(spread, float(loads.attrs["resolution"]) / np.sqrt(12))
        u.append(np.hypot(noise / np.sqrt(len(f)), float(loads["u_tare"])))
    dims, limits = ("oscillation", "cycle"), clear * np.array(u)[:, None]
    known = 1.0 if loads.attrs["is_tared"] else np.nan
    least, losses = known * np.min(forces, axis=1), known * np.mean(np.array(forces)[:, :-1] < limits, axis=1)
    return xr.Dataset(
        {
            "position": variable(dims, positions, "m", "stage position"),
            "force": variable(dims, forces, "N", "force, compression positive"),
            **with_u("least_force", "oscillation", least, known * np.array(u), "N", "least force of the mean loop"),
            "contact_loss": variable("oscillation", losses, "1", "share of a cycle without contact"),
        },
        coords={
            "oscillation": oscillations["oscillation"],
            "cycle": variable("cycle", phase, "1", "fraction of a cycle"),
        },
    )
