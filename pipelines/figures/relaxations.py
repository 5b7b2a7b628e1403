"""Figures 2.4 and 3.17: relaxation after a ramp, and a sphere under stepwise load."""

from typing import Any

import numpy as np
from matplotlib.patches import Circle

from labpipe.report import line_arguments
from pipelines.figures.drawing import Drawing, legend_above, letter, panels, right_axis
from pipelines.figures.inputs import Inputs, with_u
from pipelines.rig.apparatus import PUNCH


def relaxation(inputs: Inputs, most: int = 3, drawn: int = 400) -> Drawing:
    """Figure 2.4: force of a ramp and a hold at three depths, recorded and simulated, so many points drawn of each."""
    name = next(iter(inputs.experiments))
    files = inputs.experiments[name].mach1[:most]
    punch = inputs.experiments[name].punch
    notes: list[str] = []
    with panels(1, len(files), width=2, aspect=0.38) as (figure, axes):
        for place, letter_, file in zip(axes[0], "abc", files, strict=False):
            loads, ramps, made = (inputs.result(name, stage, file) for stage in ("loads", "ramps", "comparison"))
            at, time = ramps.isel(ramp=0), loads["time"].values
            since = time - float(at["begin"])
            inside = (loads["block"].values == int(at["block"])) & (since > 0) & (time <= float(at["last"]))
            wanted = np.geomspace(since[inside][0], since[inside][-1], drawn)  # equal steps of log time
            rows = np.flatnonzero(inside)[np.unique(np.searchsorted(since[inside], wanted).clip(0, inside.sum() - 1))]
            t, points = since[rows], line_arguments("measured", style="points") | {"markersize": 2}
            place.semilogx(t, loads["force"].values[rows], label=f"force, {inputs.origin}", **points)
            place.semilogx(t, made["simulated_force"].values[rows], label="model", **line_arguments("model"))
            other = right_axis(place, "indentation (mm)", is_named=file == files[-1])
            moved = (loads["position_z"].values[rows] - float(ramps["contact_position"])) * 1e3
            other.semilogx(t, moved, label="indentation (right axis)", **line_arguments("reference"))
            other.set_ylim(0.0, 0.42)
            peak, depth = float(at["peak_force"]), float(at["depth"])
            place.set(xlabel="time since the ramp began (s)", ylabel="force (N)", ylim=(0.0, 1.3 * peak))
            place.yaxis.label.set_visible(place is axes[0, 0])
            by_radius = "" if punch is None else f", $\\Delta/R$ = {depth / punch.radius.value:.3g}"
            letter(place, letter_, f"$\\Delta$ = {depth * 1e3:.3g} mm{by_radius}")
            known = next((row[1:] for row in PUNCH.forces if abs(depth - row[0]) < 0.1 * row[0]), None)
            notes.append(
                f"{depth * 1e3:.2g} mm: peak {peak:.2f} N behind the cell's filter, plateau "
                f"{with_u(at, 'plateau_force', 1.0, 2)} N (model {float(made['plateau_force_model'][0]):.2f} N), nRMSE "
                f"{100 * float(made['nrmse_all'][0]):.2f} %"
                + ("" if known is None else f" (printed {known[0]:g} and {known[1]:g} N)")
            )
        legend_above(figure, [place, other])
    return Drawing(
        "Force while the punch is pressed in at 1 mm/s and held, at three depths; right axis: "
        "indentation from the recorded position.",
        figure,
        computed="boundary-element simulation with the measured displacement, after the load cell's filter.",
        difference=f"{'; '.join(notes)}.",
        **inputs.data_note(f"the Mach-1 recordings of {name}, thinned to equal steps of log time."),
    )


def stepwise_load(inputs: Inputs, gap: float = 120.0) -> Drawing:
    """Figure 3.17: contact radius of a sphere under five loads, by approach, viscoelastic model and Hertz.

    In (b) the circles are a gap of some µm apart.
    """
    name = next(iter(inputs.experiments))
    measured, steps = inputs.result(name, "approach"), inputs.result(name, "steps")
    model, made = inputs.result(name, "model"), inputs.result(name, "comparison")
    t, a = measured["time"].values / 60, measured["contact_radius"].values * 1e6
    radii = model["hertz_radius_relaxed"].values * 1e6
    edges = np.append(steps["begin"].values / 60, t[-1])
    masses = [load.mass.value for load in inputs.experiments[name].loads]
    held = np.clip(np.searchsorted(edges, t, side="right") - 1, 0, len(masses) - 1)
    means = np.array([float(np.nanmean(a[held == number])) for number in range(len(masses))])
    with panels(2, 1, width=1, aspect=1.25, height_ratios=(2.2, 1.0)) as (figure, grid):
        axes, circles = grid[:, 0]
        raw = line_arguments("measured", style="points") | {"markersize": 1.2, "color": "#9a9a9a"}
        raw |= {"markerfacecolor": "#9a9a9a", "markeredgecolor": "#9a9a9a"}
        axes.plot(t, a, label=f"laser, {inputs.origin}", **raw)
        axes.plot(t, model["contact_radius"].values * 1e6, label="viscoelastic", **line_arguments("model"))
        look: dict[str, Any] = {"color": "#cc2a1e", "linestyle": line_arguments("reference")["linestyle"], "zorder": 3}
        axes.stairs(radii, edges, baseline=None, label=f"Hertz, {model.attrs['reference']}", **look)
        axes.hlines(means, edges[:-1], edges[1:], colors="#444444", linewidth=0.8, linestyle=(0, (6, 2)), label="means")
        for edge in edges[1:-1]:
            axes.axvline(edge, color="#888888", linewidth=0.6, linestyle="--")
        axes.set(xlabel="time (min)", ylabel="contact radius (µm)", ylim=(0, 1.1 * radii.max()))
        for mass, start, radius in zip(masses, edges, radii, strict=False):
            axes.text(max(start, edges[1]) + 0.8, radius - 95, f"{mass:g} kg", fontsize=7)
        inset = axes.inset_axes((0.42, 0.12, 0.55, 0.36))  # where the panel has room
        over_hertz, thin = model["contact_radius"].values * 1e6 / radii[held], {"linewidth": 1.0}
        inset.plot(t, a / radii[held], label="laser over Hertz", **raw)
        inset.plot(t, over_hertz, label="viscoelastic over Hertz", **(line_arguments("model") | thin))
        low = float(np.nanquantile(over_hertz, 0.02))
        inset.set(ylim=(1.0 - 1.5 * (1.0 - low), 1.0), ylabel="$a/a_\\mathrm{Hertz}$")
        inset.tick_params(labelsize=6)
        inset.yaxis.label.set_size(7)
        letter(axes, "a")
        ends = np.cumsum(2.0 * radii + gap)
        for x, radius in zip(ends - radii - gap, radii, strict=True):
            circles.add_patch(Circle((x, 0.0), radius, facecolor="#cfe3f1", edgecolor="#0066a6"))
            circles.text(x, 0.0, f"{radius:.0f}", ha="center", va="center", fontsize=7)
        limits = {"xlim": (-gap, ends[-1]), "ylim": (-1.15 * radii.max(), 1.15 * radii.max())}
        circles.set(**limits, aspect="equal", yticks=[], xlabel="width (µm)")
        circles.grid(visible=False)
        letter(circles, "b")
        legend_above(figure, axes, columns=2)
    ours, gaps, u = (1e6 * made[n].values for n in ("radius_model", "radius_difference", "u_radius_difference"))
    found = [
        f"{masses[i]:g} kg: {ours[i] + gaps[i]:.1f} ± {u[i]:.1f} (model {ours[i]:.1f}, Hertz {radii[i]:.1f}) µm"
        for i in range(len(masses))
    ]
    return Drawing(
        "(a) Contact radius of a PTFE sphere on a flat while masses are added (vertical lines), from the "
        "approach by a = sqrt(R delta): readings and the mean of every load (horizontal); inset: radius over Hertz's "
        "of the same load, which shows the creep; (b) Hertz contact circles to scale.",
        figure,
        computed=(
            f"quasi-static viscoelastic contact, and Hertz with the {model.attrs['reference']}. Radius at the end of "
            f"each load: {'; '.join(found)}. nRMSE of the model {100 * float(made['nrmse_contact_radius_model']):.2f} "
            f"%, of Hertz {100 * float(made['nrmse_contact_radius_hertz']):.2f} %. Means over the loads: "
            f"{', '.join(f'{m:.1f}' for m in means)} µm."
        ),
        difference=(
            "the thesis prints the loads and times, not the radii. The first load is held 3 "
            "min by section 3.1 and 2.55 min by 3.3.4 (as minutes and seconds, 2 min 55 s)."
        ),
        **inputs.data_note(f"the laser's approach of {name}, a reading every few seconds."),
    )
