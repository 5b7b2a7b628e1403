"""Figures 3.9 and 3.15: the film of the holder, and the film of the contact."""

from typing import Any

import numpy as np

from labpipe.arrays import Floats
from labpipe.report import line_arguments
from pipelines.figures.drawing import Drawing, label_outside, legend_above, letter, panels
from pipelines.figures.inputs import Inputs, referred, with_u

_IMPACTS = 3
_MOST_HEIGHTS = 4
AROUND_PEAK = 0.8
"""ms on either side of the largest radius in which the model is drawn."""


def laser_and_film(inputs: Inputs) -> Drawing:
    """Figure 3.9: displacement and velocity by image correlation and by laser."""
    name = next(n for n, s in inputs.experiments.items() if s.laser_experiment)
    drop = referred(inputs.experiments[name].laser_experiment)
    dropped: Any = inputs.plan.session.experiments[drop].settings
    made, speed, repeats = (
        inputs.result(name, "comparison"),
        inputs.result(name, "velocity"),
        inputs.result(drop, "repeats"),
    )
    # Results count from first contact; the figure shows the film's own recording time.
    touch = float(inputs.result(name, "bounces")["first_contact_time"])
    t, t_laser = (made["time"].values + touch) * 1e3, (repeats["time"].values + touch) * 1e3
    inside = (t_laser >= t.min()) & (t_laser <= t.max())
    film, laser = line_arguments("measured", style="points") | {"markersize": 1.8}, line_arguments("model")
    with panels(1, 2, width=2, aspect=0.42) as (figure, axes):
        first, second = axes[0]
        first.plot(t, made["film"].values * 1e3, label=f"film, {inputs.origin}", **film)
        first.plot(t, made["laser"].values * 1e3, label=f"laser, {inputs.origin}", **laser)
        first.set(ylabel="displacement (mm)")
        second.plot(speed["time"].values * 1e3, speed["velocity"].values, label="film", **film)
        second.plot(t_laser[inside], repeats["velocity_mean"].values[inside], label="laser", **laser)
        second.set(ylabel="velocity (m/s)")
        for place, one in zip(axes[0], "ab", strict=True):
            letter(place, one)
            place.axvline(touch * 1e3, **line_arguments("reference"))
            place.set(xlabel="recording time $t$ (ms)", xlim=(t.min(), t.max()))
        legend_above(figure, first)
    low, high = (f"{float(made[f'limit_{end}']) * 1e6:+.1f}" for end in ("low", "high"))
    return Drawing(
        "(a) Displacement of the holder by digital image correlation of a film and by laser, over the recording time "
        "of the film, on which the laser's record is laid at first contact (dotted); (b) velocity by a smoothing "
        "spline.",
        figure,
        computed=(
            f"film minus laser: mean {with_u(made, 'bias')} µm, 95 % limits of agreement {low} to {high} µm; nRMSE "
            f"{100 * float(made['nrmse']):.2f} %."
        ),
        difference=(
            "the thesis gives no number for the agreement. First contact is printed as about 0.04 s for 7 mm (37.8 ms "
            f"of free fall); here it comes at {touch * 1e3:.2f} ms of a recording that begins before the release, from "
            f"{dropped.height.value * 1e3:g} mm. The text counts displacement from the release, -7 mm at first "
            "contact; here it is 0 there."
        ),
        **inputs.data_note(f"the film {name} and the laser recordings {drop}."),
    )


def contact_radius(inputs: Inputs) -> Drawing:
    """Figure 3.15: contact radius of the first impacts at each height, film and model."""
    chosen = dict(list(inputs.of_kind("contact_area").items())[:_MOST_HEIGHTS])
    notes = []
    shape: dict[str, Any] = {"aspect": 0.1 + 0.26 * len(chosen), "sharex": "all", "sharey": "row"}
    with panels(len(chosen), _IMPACTS, width=2, **shape) as (figure, axes):
        for row, (name, settings) in enumerate(chosen.items()):
            made, height = inputs.result(name, "comparison"), f"{settings.height.value * 1e3:g} mm"
            for number, place in enumerate(axes[row]):
                inside = made["impact_number"].values == number + 1
                t, a, u = (made[n].values[inside] for n in ("since_peak", "film", "u_film"))
                points = line_arguments("measured", style="points") | {"capsize": 1.5}
                place.errorbar(t * 1e3, a * 1e6, 2e6 * u, label=f"film, {inputs.origin}", **points)
                peak = float(made["model_peak_time"][number])
                place.plot(*around_peak(inputs.result(name, "model"), peak), label="model", **line_arguments("model"))
                place.set_ylim(bottom=0.0)
                letter(place, "abcd"[row], f"$h_0$ = {height}, {'I' * (number + 1)}")
            gaps = [with_u(made, "peak_radius_difference", impact=number) for number in range(_IMPACTS)]
            notes.append(f"{height}: {', '.join(gaps)} µm")
        label_outside(axes, "time from largest radius $t_p$ (ms)", "contact radius (µm)")
        legend_above(figure, axes[0, 0])
    return Drawing(
        "Contact radius of the first impacts (I, II, III) at each drop height, t_p = 0 at the largest radius; "
        "bars: two standard uncertainties.",
        figure,
        computed=f"simulated drops; largest radius, film minus model: {'; '.join(notes)}.",
        **inputs.data_note("contact radius from the interference fringes of films."),
    )


def around_peak(model: Any, peak: float) -> tuple[Floats, Floats]:
    """Return the simulated contact around one largest radius at ``peak`` s: time in ms, radius in µm."""
    since = (model["time"].values - peak) * 1e3
    shown = np.abs(since) <= AROUND_PEAK
    radius = model["contact_radius"].values[shown] * 1e6
    return since[shown], np.where(radius > 0, radius, np.nan)
