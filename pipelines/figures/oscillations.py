"""Figures 2.5 and 2.8: harmonic indentation, loops and dissipated work against model and theory."""

from typing import Any

import numpy as np
import xarray as xr
from matplotlib import colormaps

from labpipe import contact
from labpipe.arrays import Floats
from labpipe.contact.line import dissipation
from labpipe.materials import Prony
from labpipe.report import Role, line_arguments
from pipelines.experiments.shared import mach1_readings
from pipelines.figures.drawing import Drawing, legend_above, letter, panels
from pipelines.figures.inputs import Inputs
from pipelines.rig.apparatus import PUNCH

_AXIS = PUNCH.tau_0 * 1e10
"""From Hz to f tau_0 in units of 1e-10, which makes short tick labels."""


def _first(inputs: Inputs) -> tuple[str, Any, Prony]:
    """Return name, settings and solid of the first harmonic experiment that has a model."""
    name, settings = next((n, s) for n, s in inputs.experiments.items() if s.punch is not None and s.substrate)
    return name, settings, inputs.solid_of(settings.substrate)


def loops(inputs: Inputs, printed: float = 0.5, shown: int = 3) -> Drawing:
    """Figure 2.5: displacement and force over time, some cycles nearest to a frequency [Hz], and over displacement."""
    name, settings, solid = _first(inputs)
    parts = {stage: inputs.result(name, stage) for stage in ("loads", "oscillations", "loops", "comparison", "model")}
    punch = settings.punch
    scale = solid.E_relaxed * punch.period.value * punch.depth.value * punch.tips
    touch = float(parts["oscillations"]["contact_position"])
    radius = punch.radius.value
    with panels(2, 2, width=2, aspect=0.52, sharex="col") as (figure, axes):
        above, below = axes[:, 0]
        right = figure.add_subplot(axes[0, 1].get_gridspec()[:, 1])
        for unused in axes[:, 1]:
            unused.remove()
        table, loads = parts["oscillations"], parts["loads"]
        nearest = int(np.argmin(np.abs(np.log(table["frequency"].values / printed))))
        frequency, begin = (float(table[n][nearest]) for n in ("frequency", "begin"))
        block = mach1_readings.rows(loads, int(table["block"][nearest]))
        cycles = (loads["time"].values[block] - loads["time"].values[block][0] - begin) * frequency
        inside = (cycles >= 0) & (cycles <= shown)
        every, line = max(1, inside.sum() // (30 * shown)), line_arguments("measured", style="points")
        t, depth = cycles[inside], (loads["position_z"].values[block][inside] - touch) / radius
        force, model = (
            values[block][inside] / scale
            for values in (loads["force"].values, parts["comparison"]["simulated_force"].values)
        )
        above.plot(t[::every], depth[::every], label=f"indentation, {inputs.origin}", **line)
        above.set(ylabel="indentation $\\tilde\\Delta = \\Delta/R$ (1)")
        below.plot(t[::every], force[::every], label=f"force, {inputs.origin}", **line)
        below.plot(t, model, label="model", **line_arguments("model"))
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
            "applied to its force, in (b) its lag and gain at the frequency are taken out of the recorded one. nRMSE "
            f"{100 * np.nanmin(error):.2f} to {100 * np.nanmax(error):.2f} % over {error.size} frequencies."
        ),
        difference="f tau_0 = 0.78e-10 is 0.5 Hz; no number is printed for the agreement.",
        **inputs.data_note("force and displacement of the Mach-1 tester, force tared."),
    )


def _loop_panel(axes: Any, parts: dict[str, xr.Dataset], scales: tuple[float, float, float], points: int = 24) -> str:
    """Draw recorded and simulated loops, before the load cell's filter; return a note on their widths."""
    touch, radius, scale = scales
    recorded, table, loads = parts["loops"], parts["oscillations"], parts["loads"]
    phase = recorded["cycle"].values
    # An ordered quantity gets an ordered scale of colours, which colour-blind readers see too.
    shades = colormaps["cividis"](np.linspace(0.0, 0.75, table.sizes["oscillation"]))
    hollow = {"linestyle": "none", "marker": "o", "markersize": 2.6, "markerfacecolor": "white", "markeredgewidth": 0.7}
    for number, (frequency, end) in enumerate(zip(table["frequency"].values, table["end"].values, strict=True)):
        depth, force = (recorded[name].values[number] for name in ("position", "force"))
        lag, gain = (float(table[f"filter_{name}"][number]) for name in ("phase", "gain"))
        swing = np.interp(phase + lag / (2.0 * np.pi), phase, force - force.mean(), period=1.0)
        force = force.mean() + swing / gain
        look: dict[str, Any] = {"color": shades[number]}
        axes.plot((depth - touch) / radius, force / scale, label=f"{frequency * _AXIS:.3g}", linestyle="-", **look)
        block = mach1_readings.rows(loads, int(table["block"][number]))
        grid = np.linspace(end - 1.0 / frequency, end, points + 1)  # the last evaluated cycle
        x, y = (
            np.interp(grid, loads["time"].values[block], values[block])
            for values in (loads["position_z"].values, parts["model"]["force"].values)
        )
        axes.plot((x - touch) / radius, y / scale, label=f"_{frequency * _AXIS:.3g}, model", **hollow, **look)
    axes.set(xlabel="indentation $\\Delta/R$ (1)", ylabel="force $\\tilde F$ (1)")
    axes.legend(title="$\\tilde f$ ($10^{-10}$)", loc="center left", bbox_to_anchor=(1.0, 0.5))
    table = table.sortby("frequency").isel(oscillation=[0, -1])
    slow, fast = table["work_per_cycle"].values / (2.0 * table["amplitude"].values)
    return (
        f"Mean width of the loops (work over stroke, the lag of the load cell's filter taken out) {slow:.3f} N at the "
        f"lowest and {fast:.3f} N at the highest frequency."
    )


def dissipated_work(inputs: Inputs) -> Drawing:
    """Figure 2.8: dissipated work over frequency, measured, simulated and by eq. (2.31)."""
    name, settings, solid = _first(inputs)
    table, model = inputs.result(name, "oscillations"), inputs.result(name, "model")
    order = np.argsort(table["frequency"].values)
    table, model = table.isel(oscillation=order), model.isel(oscillation=order)
    punch = settings.punch
    geometry = (punch.radius.value, punch.period.value, punch.depth.value * punch.tips)
    mean = abs(float(np.mean(table["mean_position"])) - float(table["contact_position"]))
    frequency, amplitude = table["frequency"].values, table["amplitude"].values

    def scaled(work: Any) -> Floats:
        return dissipation.dimensionless_work(work, solid, *geometry)

    with panels(aspect=0.8) as (figure, grid):
        axes = grid[0, 0]
        fine = np.geomspace(frequency[0], frequency[-1], 61)
        swings = np.interp(fine, frequency, amplitude)
        theory = scaled(contact.dissipated_work(solid, fine, swings, mean, *geometry))
        axes.plot(fine * _AXIS, theory, label="eq. (2.31)", **line_arguments("reference"))
        # The filled points are drawn last and fit into the open ones, which would hide them.
        roles: tuple[tuple[xr.Dataset, Role, str, float, int], ...] = (
            (model, "model", "simulated", 6.5, 3),
            (table, "measured", inputs.origin, 3.0, 4),
        )
        for source, role, word, size, level in roles:
            work, u = (scaled(source[f"{prefix}work_per_cycle"].values) for prefix in ("", "u_"))
            look = line_arguments(role, style="points") | {"markersize": size, "zorder": level, "capsize": 2}
            axes.errorbar(frequency * _AXIS, work, 2 * u, label=word, **look)
        axes.set(xlabel="frequency $\\tilde f = f\\tau_0$ ($10^{-10}$)", ylabel="dissipated work $\\tilde W$ (1)")
        axes.set_ylim(bottom=0.0)
        legend_above(figure, axes)
    at = contact.dissipated_work(solid, frequency, amplitude, mean, *geometry)
    gap, theory_gap = (100 * (w / table["work_per_cycle"].values - 1) for w in (model["work_per_cycle"].values, at))
    return Drawing(
        "Work dissipated in a cycle over frequency, with two standard uncertainties; "
        "dimensionless as eq. (2.40) per depth.",
        figure,
        computed=(
            "simulation with the recorded displacement; eq. (2.31) with the fitted amplitudes at mean indentation "
            f"{mean * 1e6:.1f} µm. Simulated over {inputs.origin}: {gap.min():+.1f} to {gap.max():+.1f} %; eq. (2.31) "
            f"over {inputs.origin}: {theory_gap.min():+.1f} to {theory_gap.max():+.1f} %."
        ),
        difference="the printed legend says the simulation is 'based on Eq. 2.31'; it is not, the two are independent.",
        **inputs.data_note(f"work of the mean loops at {frequency.size} frequencies."),
    )
