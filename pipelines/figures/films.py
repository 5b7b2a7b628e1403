"""Figures 3.9 and 3.15: the film of the holder, and the film of the contact."""

from typing import Any

import numpy as np

from labpipe.arrays import Floats
from labpipe.report import line_arguments
from pipelines.figures.drawing import Drawing, label_outside, legend_above, letter, panels
from pipelines.figures.inputs import Inputs, referred

_IMPACTS = 3
_MOST_HEIGHTS = 4
_AROUND_PEAK = 0.8
"""ms on either side of the largest radius in which the model is drawn."""


def laser_and_film(inputs: Inputs) -> Drawing:
    """Figure 3.9: displacement and velocity by image correlation and by laser."""
    name = next(n for n, s in inputs.experiments.items() if s.laser_experiment)
    drop = referred(inputs.experiments[name].laser_experiment)
    drops: Any = inputs.plan.session.experiments[drop].settings
    made, speed = inputs.result(name, "comparison"), inputs.result(name, "velocity")
    bounces = inputs.result(name, "bounces")
    repeats = inputs.result(drop, "repeats")
    # Results count from first contact; the figure shows the film's own recording time.
    touch = float(bounces["first_contact_time"])
    t = (made["time"].values + touch) * 1e3
    with panels(1, 2, width=2, aspect=0.42) as (figure, axes):
        first, second = axes[0]
        film, laser = line_arguments("measured", style="points"), line_arguments("model")
        film |= {"markersize": 1.8}
        first.plot(t, made["film"].values * 1e3, label=f"film, {inputs.origin}", **film)
        first.plot(t, made["laser"].values * 1e3, label=f"laser, {inputs.origin}", **laser)
        first.set(ylabel="displacement (mm)")
        t_laser = (repeats["time"].values + touch) * 1e3
        inside = (t_laser >= t.min()) & (t_laser <= t.max())
        second.plot(speed["time"].values * 1e3, speed["velocity"].values, **film)
        second.plot(t_laser[inside], repeats["velocity_mean"].values[inside], **laser)
        second.set(ylabel="velocity (m/s)")
        for place, one in zip(axes[0], "ab", strict=True):
            letter(place, one)
            place.axvline(touch * 1e3, **line_arguments("reference"))
            place.set(xlabel="recording time $t$ (ms)", xlim=(t.min(), t.max()))
        legend_above(figure, first)
    return Drawing(
        "(a) Displacement of the holder by digital image correlation of a film and by laser, over the "
        "recording time of the film, on which the laser's record is laid at first contact (dotted); "
        "(b) velocity by a smoothing spline.",
        figure,
        computed=(
            f"film minus laser: mean {float(made['bias']) * 1e6:+.1f} ± {float(made['u_bias']) * 1e6:.1f} µm, 95 % "
            f"limits of agreement {float(made['limit_low']) * 1e6:+.1f} to {float(made['limit_high']) * 1e6:+.1f} µm; "
            f"lag {float(made['lag']) * 1e6:+.0f} µs; nRMSE {100 * float(made['nrmse']):.2f} %."
        ),
        difference=(
            "the thesis gives no number for the agreement. First contact is printed as about 0.04 s for "
            f"7 mm (37.8 ms of free fall); here it comes at {touch * 1e3:.2f} ms of a recording that begins "
            f"before the release, from {drops.height.value * 1e3:g} mm. The text counts displacement from the "
            "release, -7 mm at first contact; here it is 0 there."
        ),
        **inputs.data_note(f"the film {name} and the laser recordings {drop}."),
    )


def contact_radius(inputs: Inputs) -> Drawing:
    """Figure 3.15: contact radius of the first impacts at each height, film and model."""
    chosen = sorted(inputs.experiments, key=lambda n: inputs.experiments[n].height.value)
    chosen = chosen[:_MOST_HEIGHTS]
    notes = []
    with panels(len(chosen), _IMPACTS, width=2, aspect=0.1 + 0.26 * len(chosen), sharex="all", sharey="row") as (
        figure,
        axes,
    ):
        for row, name in enumerate(chosen):
            made = inputs.result(name, "comparison")
            _impact_row(axes[row], made, inputs.result(name, "model"), inputs.origin)
            height = inputs.experiments[name].height.value * 1e3
            letter(axes[row, 0], "abcd"[row], f"$h_0$ = {height:g} mm, I")
            for number, place in enumerate(axes[row, 1:], start=2):
                place.set_title("I" * number, loc="left", fontsize=8.0)
            gap = made["peak_radius_difference"].values[:_IMPACTS] * 1e6
            u = made["u_peak_radius_difference"].values[:_IMPACTS] * 1e6
            pairs = ", ".join(f"{g:+.1f} ± {s:.1f}" for g, s in zip(gap, u, strict=True))
            notes.append(f"{height:g} mm: {pairs} µm")
        label_outside(axes, "time from largest radius $t_p$ (ms)", "contact radius (µm)")
        legend_above(figure, axes[0, 0])
    return Drawing(
        "Contact radius of the first impacts (I, II, III) at each drop height, t_p = 0 at the largest radius.",
        figure,
        computed=f"simulated drops; largest radius, film minus model: {'; '.join(notes)}.",
        difference="the thesis gives no number for the agreement.",
        **inputs.data_note("contact radius from the interference fringes of films."),
    )


def _impact_row(places: Any, made: Any, model: Any, origin: str) -> None:
    for number, place in enumerate(places, start=1):
        inside = made["impact_number"].values == number
        t = made["since_peak"].values[inside] * 1e3
        place.plot(
            t, made["film"].values[inside] * 1e6, label=f"film, {origin}", **line_arguments("measured", style="points")
        )
        since, radius = around_peak(model, float(made["model_peak_time"][number - 1]))
        place.plot(since, radius, label="model", **line_arguments("model"))
        place.set_ylim(bottom=0.0)


def around_peak(model: Any, peak: float) -> tuple[Floats, Floats]:
    """Return the simulated contact around one largest radius at ``peak`` s: time in ms, radius in µm."""
    since = (model["time"].values - peak) * 1e3
    shown = np.abs(since) <= _AROUND_PEAK
    radius = model["contact_radius"].values[shown] * 1e6
    return since[shown], np.where(radius > 0, radius, np.nan)
