"""Figures 3.8, 3.9 and D.1: the holder by image correlation, and against the laser."""

from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.patches import Rectangle

from labpipe.errors import InputError
from labpipe.report import line_arguments
from pipelines.figures.drawing import Drawing, legend_above, letter, panels
from pipelines.figures.inputs import Inputs, referred, with_u

_LINE, _POINT = "#0066a6", "#f2c200"


def _film(inputs: Inputs) -> str:
    """Return the first film that tracks a line of subsets."""
    for name, settings in inputs.experiments.items():
        if settings.tracking.line is not None:
            return name
    raise InputError("no film of the session tracks a line of subsets; give it tracking.line")


def _reference(place: Any, keys: Any, track: Any, *, squares: bool) -> None:
    """Draw the first frame with the line and its subsets."""
    reduction = float(keys["reduction"])
    image = keys["image"].values[0]
    rows, columns = image.shape
    right, low = columns * reduction - 0.5, rows * reduction - 0.5
    place.imshow(image, cmap="gray", interpolation="nearest", extent=(-0.5, right, low, -0.5))
    x, y = track["x"].values[1:], track["y"].values[1:]
    place.plot(x, y, color=_LINE, linewidth=1.6)
    place.plot(x, y, "o", color=_POINT, markersize=2.6, markeredgewidth=0)
    if squares:
        for size, cx, cy in zip(track["subset"].values, track["x"].values, track["y"].values, strict=True):
            colour = _POINT if size == track["subset"].values[-1] else "#cc4e00"
            corner = cx - size / 2, cy - size / 2
            place.add_patch(Rectangle(corner, size, size, fill=False, edgecolor=colour, linewidth=0.7))
    place.set(xlabel="column (px)", ylabel="row (px)")
    place.grid(visible=False)


def falling_line(
    inputs: Inputs, printed: tuple[float, ...] = (0.0, 0.074, 0.085, 0.106, 0.126, 0.138, 0.149, 0.155, 0.161, 0.300)
) -> Drawing:
    """Figure 3.8: the line on the holder, and where it is at the printed times [s].

    A film that is too short for four of them shows as many of its own.
    """
    name = _film(inputs)
    keys, track = inputs.result(name, "keys"), inputs.result(name, "track")
    motion, events = inputs.result(name, "motion"), inputs.result(name, "bounces")
    size = float(motion["pixel_size"]) * 1e3
    time = track["time"].values
    # Times count from the release, as the printed ones from the beginning of the fall.
    since = time - float(events["release_time"])
    wanted = [t for t in printed if t <= since[-1]]
    told = "the frames nearest to those printed in the thesis"
    if len(wanted) < 4:
        wanted, told = np.linspace(0.0, since[-1], len(printed)).tolist(), "evenly spaced"
    chosen = [int(np.argmin(np.abs(since - t))) for t in wanted]
    with panels(1, 2, width=2, aspect=0.46, width_ratios=(1.0, 2.2)) as (figure, axes):
        _reference(axes[0, 0], keys, track, squares=False)
        letter(axes[0, 0], "a", "reference frame")
        place = axes[0, 1]
        shades = colormaps["cividis"](np.linspace(0.0, 0.88, len(chosen)))
        for shade, frame in zip(shades, chosen, strict=True):
            at = track.isel(frame=frame, point=slice(1, None))
            x = (at["x"] + at["dx"]).values * size
            look = {"marker": "o", "markersize": 2.0, "linewidth": 1.0, "color": shade}
            place.plot(x, -at["dy"].values * size, label=f"{abs(since[frame]):.3f} s", **look)
        place.set(xlabel="along the line (mm)", ylabel="displacement (mm)")
        place.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), title="from release")
        letter(place, "b")
    turned = float(np.nanmax(np.abs(motion["rotation"].values))) * 1e3
    return Drawing(
        "(a) Reference frame of the holder of a PTFE sphere with the line of subsets that are "
        f"followed; (b) the line at chosen times, {told}.",
        figure,
        computed=(f"image correlation; {size * 1e3:.2f} µm per pixel. The holder turns by at most {turned:.2f} mrad."),
        difference=(
            "the printed line 'progressively deforms upon impact'; the holder is far too "
            "stiff for that at these scales: the line moves as a rigid body."
        ),
        **inputs.data_note(f"the film {name}, {len(time)} frames were tracked."),
    )


def reference_frame(inputs: Inputs) -> Drawing:
    """Figure D.1: subsets and line on the reference frame."""
    name = _film(inputs)
    keys, track = inputs.result(name, "keys"), inputs.result(name, "track")
    with panels(1, 1, width=1, aspect=1.1) as (figure, axes):
        _reference(axes[0, 0], keys, track, squares=True)
    small, body = int(track["subset"].values[-1]), int(track["subset"].values[0])
    return Drawing(
        "Reference frame with the line (blue), its subsets (yellow) and the large subset by "
        "which the body's motion is measured (orange).",
        figure,
        computed=(f"{track.sizes['point'] - 1} subsets of {small} px on the line; one of {body} px on the body."),
        **inputs.data_note(f"the first frame of the film {name}."),
    )


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
    return Drawing(
        "(a) Displacement of the holder by digital image correlation of a film and by laser, over the recording time "
        "of the film, on which the laser's record is laid at first contact (dotted); (b) velocity by a smoothing "
        "spline.",
        figure,
        computed=(f"film minus laser: mean {with_u(made, 'bias')} µm; nRMSE {100 * float(made['nrmse']):.2f} %."),
        difference=(
            "the thesis gives no number for the agreement. First contact is printed as about 0.04 s for 7 mm (37.8 ms "
            f"of free fall); here it comes at {touch * 1e3:.2f} ms of a recording that begins before the release, from "
            f"{dropped.height.value * 1e3:g} mm. The text counts displacement from the release, -7 mm at first "
            "contact; here it is 0 there."
        ),
        **inputs.data_note(f"the film {name} and the laser recordings {drop}."),
    )
