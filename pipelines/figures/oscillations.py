"""Figures 2.5 and 2.8: harmonic indentation, loops and dissipated work against model and theory."""

from typing import Any

import numpy as np
import xarray as xr
from matplotlib import colormaps

from labpipe import contact
from labpipe.arrays import Floats
from labpipe.contact.line import dissipation
from labpipe.materials import Prony
from labpipe.report import line_arguments
from pipelines.experiments.shared import mach1_readings
from pipelines.figures.chapter2 import CHARACTERISTIC_TIME
from pipelines.figures.drawing import Drawing, legend_above, letter, panels
from pipelines.figures.inputs import Inputs

_SHOWN_CYCLES = 3
_PRINTED_FREQUENCY = 0.5  # Hz, of panel (a)
_PASSED = 0.5
"""Part of the filter's cutoff up to which harmonics of a loop are set right; beyond is noise."""

_DRAWN_POINTS = 24
"""Of a simulated loop."""

_EVERY = 6
"""Of the frequencies at which eq. (2.31) is drawn, the simulation takes every so many."""

_HOLD, _CYCLE_SAMPLES, _CYCLES = 600.0, 120, 3
"""Of the sine that is simulated between the measured frequencies: hold before it in s."""
_AXIS = CHARACTERISTIC_TIME * 1e10
"""From Hz to f tau_0 in units of 1e-10, which makes short tick labels."""


def _only(inputs: Inputs) -> tuple[str, Any, Prony]:
    """Return name, settings and solid of the first harmonic experiment that has a model."""
    name, settings = next((n, s) for n, s in inputs.experiments.items() if s.punch is not None and s.substrate)
    return name, settings, inputs.solid_of(settings.substrate)


def loops(inputs: Inputs) -> Drawing:
    """Figure 2.5: displacement and force over time, and force over displacement."""
    name, settings, solid = _only(inputs)
    parts = {stage: inputs.result(name, stage) for stage in ("loads", "oscillations", "loops", "comparison", "model")}
    punch = settings.punch
    scale = solid.E_relaxed * punch.period.value * punch.depth.value * punch.tips
    touch = float(parts["model"]["contact_position"])
    radius = punch.radius.value
    with panels(2, 2, width=2, aspect=0.52, sharex="col") as (figure, axes):
        above, below = axes[:, 0]
        right = figure.add_subplot(axes[0, 1].get_gridspec()[:, 1])
        for unused in axes[:, 1]:
            unused.remove()
        table, loads = parts["oscillations"], parts["loads"]
        nearest = int(np.argmin(np.abs(np.log(table["frequency"].values / _PRINTED_FREQUENCY))))
        frequency, begin = (float(table[n][nearest]) for n in ("frequency", "begin"))
        block = mach1_readings.rows(loads, int(table["block"][nearest]))
        cycles = (loads["time"].values[block] - loads["time"].values[block][0] - begin) * frequency
        inside = (cycles >= 0) & (cycles <= _SHOWN_CYCLES)
        every, line = max(1, inside.sum() // (30 * _SHOWN_CYCLES)), line_arguments("measured", style="points")
        depth, force, model = (
            values[block][inside]
            for values in (
                (loads["position_z"].values - touch) / radius,
                loads["force"].values / scale,
                parts["comparison"]["simulated_force"].values / scale,
            )
        )
        above.plot(cycles[inside][::every], depth[::every], **line)
        above.set(ylabel="indentation $\\tilde\\Delta = \\Delta/R$ (1)")
        below.plot(cycles[inside][::every], force[::every], label=f"force, {inputs.origin}", **line)
        below.plot(cycles[inside], model, label="model", **line_arguments("model"))
        below.set(xlabel="time $t f$ (1)", ylabel="force $\\tilde F = F/(E_0\\lambda d)$ (1)")
        drawn = _loop_panel(right, parts, (touch, radius, scale))
        letter(above, "a", f"$\\tilde f = {frequency * _AXIS:.2f}\\times 10^{{-10}}$")
        letter(right, "b", f"mean loops: lines {inputs.origin}, points model")
        legend_above(figure, below)
    error = parts["comparison"]["nrmse"].values
    return Drawing(
        f"(a) Indentation (above) and dimensionless force over time at {frequency:.2g} Hz, the "
        "transient cycles left out. (b) Mean loop of force over indentation at each "
        f"frequency, f tau_0, recorded (lines) and simulated (points). {drawn}",
        figure,
        computed=(
            "simulation with the recorded displacement as input; in (a) the load cell's filter is "
            f"applied to its force. nRMSE {100 * np.nanmin(error):.2f} to "
            f"{100 * np.nanmax(error):.2f} % over {error.size} frequencies."
        ),
        difference="f tau_0 = 0.78e-10 is 0.5 Hz; no number is printed for the agreement.",
        **inputs.data_note("force and displacement of the Mach-1 tester, force tared."),
    )


def _loop_panel(axes: Any, parts: dict[str, xr.Dataset], scales: tuple[float, float, float]) -> str:
    """Draw recorded and simulated loops; return what is to be said of them."""
    touch, radius, scale = scales
    recorded, table = parts["loops"], parts["oscillations"]
    # Compression-positive force; the stage counts downwards, so that it grows into the sample.
    position = recorded["position"].values
    # An ordered quantity gets an ordered scale of colours, which colour-blind readers see too.
    shades = colormaps["cividis"](np.linspace(0.0, 0.75, table.sizes["oscillation"]))
    widths = []
    for number, frequency in enumerate(table["frequency"].values.tolist()):
        depth = (position[number] - touch) / radius
        force = _without_lag(recorded["force"].values[number], frequency, parts["loads"])
        axes.plot(
            depth, force / scale, label=f"{frequency * _AXIS:.3g}", color=shades[number], linewidth=1.2, linestyle="-"
        )
        loads, end = parts["loads"], float(table["end"][number])
        block = mach1_readings.rows(loads, int(table["block"][number]))
        grid = np.linspace(end - 1.0 / frequency, end, _DRAWN_POINTS + 1)  # the last evaluated cycle
        x, simulated = (
            np.interp(grid, loads["time"].values[block], values[block])
            for values in (loads["position_z"].values, parts["model"]["force"].values)
        )
        axes.plot(
            (x - touch) / radius,
            simulated / scale,
            linestyle="none",
            marker="o",
            markersize=2.6,
            markerfacecolor="white",
            markeredgecolor=shades[number],
            markeredgewidth=0.7,
        )
        widths.append(abs(float(np.trapezoid(force, position[number]))) / np.ptp(position[number]))
    axes.set(xlabel="indentation $\\Delta/R$ (1)", ylabel="force $\\tilde F$ (1)")
    axes.legend(title="$\\tilde f$ ($10^{-10}$)", loc="center left", bbox_to_anchor=(1.0, 0.5))
    order = np.argsort(table["frequency"].values)
    slow, fast = widths[order[0]], widths[order[-1]]
    removed = "The lag of the load cell's filter is taken out" if parts["loads"].attrs.get("filter") else "As recorded"
    return (
        f"{removed}; mean width of the loops (work over stroke) {slow:.3f} N at the lowest and {fast:.3f} N at "
        "the highest frequency."
    )


def _without_lag(force: Floats, frequency: float, loads: xr.Dataset) -> Floats:
    """Return a mean loop's force (cycle,) [N] before the load cell's filter.

    Every harmonic up to a part of the filter's cutoff is turned back and divided by the gain;
    those beyond are left out, as are all of noise only.
    """
    declared = mach1_readings.declared_filter(loads)
    if declared is None:
        return force
    waves = np.fft.rfft(force[:-1])
    for order in range(1, waves.size):
        lag = None
        if order == 1 or order * frequency <= _PASSED * declared["cutoff"]:
            lag = mach1_readings.force_lag(loads, order * frequency)
        waves[order] *= 0.0 if lag is None else np.exp(1j * lag.phase) / lag.gain
    whole = np.fft.irfft(waves, force.size - 1)
    return np.append(whole, whole[0])


def _work_of_a_sine(solid: Prony, settings: Any, mean: float, amplitude: float, frequency: float) -> float:
    """Simulate the work [J] in a cycle of a sine about a mean indentation [m] that was held before."""
    ramp, hold = np.linspace(0.0, 1.0, 21), np.geomspace(1e-2, _HOLD, 60)
    cycles = np.linspace(0.0, _CYCLES / frequency, _CYCLES * _CYCLE_SAMPLES + 1)[1:]
    time = np.concatenate([ramp, ramp[-1] + hold, ramp[-1] + _HOLD + cycles])
    swing = amplitude * np.sin(2.0 * np.pi * frequency * cycles)
    moved = np.concatenate([mean * ramp, np.full(hold.size, mean), mean + swing])
    punch, chosen = settings.punch, settings.model
    length = punch.depth.value * punch.tips
    layer = settings.substrate.thickness
    thickness = np.inf if layer is None else layer.value
    made = contact.indent(
        solid,
        punch.radius.value,
        punch.period.value,
        length,
        time,
        moved,
        profile=chosen.profile,
        thickness=thickness,
        elements=chosen.elements,
    )
    last = slice(-_CYCLE_SAMPLES - 1, None)
    return float(np.trapezoid(made["force"].values[last], moved[last]))


def dissipated_work(inputs: Inputs) -> Drawing:
    """Figure 2.8: dissipated work over frequency, measured, simulated and by eq. (2.31)."""
    name, settings, solid = _only(inputs)
    table, model = inputs.result(name, "oscillations"), inputs.result(name, "model")
    punch = settings.punch
    radius, period = punch.radius.value, punch.period.value
    depth = punch.depth.value * punch.tips
    scale = (solid, radius, period, depth)
    mean = float(np.mean(table["mean_position"])) - float(model["contact_position"])
    frequency = table["frequency"].values
    order = np.argsort(frequency)
    fine = np.geomspace(frequency.min(), frequency.max(), 61)
    amplitude = np.interp(fine, frequency[order], table["amplitude"].values[order])
    theory = contact.dissipated_work(solid, fine, amplitude, abs(mean), radius, period, depth)
    simulated = [
        _work_of_a_sine(solid, settings, abs(mean), a, f)
        for a, f in zip(amplitude[::_EVERY], fine[::_EVERY], strict=True)
    ]
    with panels(aspect=0.8) as (figure, grid):
        axes = grid[0, 0]
        work = dissipation.dimensionless_work(theory, *scale)
        axes.plot(fine * _AXIS, work, label="eq. (2.31)", **line_arguments("reference"))
        work = dissipation.dimensionless_work(np.array(simulated), *scale)
        axes.plot(fine[::_EVERY] * _AXIS, work, label="simulated sine", **line_arguments("model"))
        # The filled points are drawn last and fit into the open ones, which would hide them.
        for source, role, word, size in ((model, "model", "simulated", 6.5), (table, "measured", inputs.origin, 3.0)):
            work = dissipation.dimensionless_work(source["work_per_cycle"].values[order], *scale)
            u = dissipation.dimensionless_work(source["u_work_per_cycle"].values[order], *scale)
            axes.errorbar(
                frequency[order] * _AXIS,
                work,
                2 * u,
                label=word,
                capsize=2,
                markersize=size,
                zorder=4 if role == "measured" else 3,
                **line_arguments(role, style="points"),  # type: ignore[arg-type]
            )
        axes.set(xlabel="frequency $\\tilde f = f\\tau_0$ ($10^{-10}$)", ylabel="dissipated work $\\tilde W$ (1)")
        axes.set_ylim(bottom=0.0)
        legend_above(figure, axes, columns=2)
    gap = model["work_per_cycle"].values / table["work_per_cycle"].values - 1
    at = contact.dissipated_work(solid, frequency, table["amplitude"].values, abs(mean), radius, period, depth)
    theory_gap = at / table["work_per_cycle"].values - 1
    return Drawing(
        "Work dissipated in a cycle over frequency, with two standard uncertainties; "
        "dimensionless as eq. (2.40) per depth.",
        figure,
        computed=(
            "simulation with the recorded displacement (points) and, between the frequencies, with a sine after a hold "
            f"of 600 s; eq. (2.31) with the fitted amplitudes at mean indentation {abs(mean) * 1e6:.1f} µm. Simulated "
            f"over {inputs.origin}: {100 * gap.min():+.1f} to {100 * gap.max():+.1f} %; eq. (2.31) over "
            f"{inputs.origin}: {100 * theory_gap.min():+.1f} to {100 * theory_gap.max():+.1f} %."
        ),
        difference="the printed legend says the simulation is 'based on Eq. 2.31'; it is not, the two are independent.",
        **inputs.data_note(f"work of the mean loops at {frequency.size} frequencies."),
    )
