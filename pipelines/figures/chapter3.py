"""Figures of chapter 3 that are computed: the reduced gap and the quantities of an impact."""

from typing import Any

import numpy as np
from matplotlib.patches import Circle, Rectangle

from labpipe import contact
from labpipe.report import line_arguments
from pipelines.figures.drawing import Drawing, letter, panels
from pipelines.figures.inputs import Inputs, solid_or_library
from pipelines.rig.apparatus import SPHERE


def reduced_gap(inputs: Inputs | None, duration: float = 3.2, after: float = 1e-4) -> Drawing:
    """Figure 3.3: reduced gap and contact radius of a drop to rest, with the symbols explained.

    The drop is followed for ``duration`` s from the release; the caption states the dent that is left ``after`` s.
    """
    (solid, origin, sweeps), height = solid_or_library(inputs, "acrylic"), SPHERE.heights[0]
    made = contact.drop(solid, SPHERE.radius, SPHERE.mass, height, duration)
    first = float(made["impact_time"][0])
    t = (made["time"].values - first) * 1e3
    until = 1.2e3 * (float(made["rest_time"]) - first)
    limits = (-0.05 * until, until) if np.isfinite(until) else (t[0], t[-1])
    rest = float(np.cbrt(0.75 * SPHERE.mass * SPHERE.gravity * SPHERE.radius * (1 - 0.35**2) / 3.2e9))
    with panels(2, 2, width=2, aspect=0.52, width_ratios=(2.0, 1.0)) as (figure, axes):
        gap, radius, sketch, near = axes[0, 0], axes[1, 0], axes[0, 1], axes[1, 1]
        under = made["displacement"].values * 1e3
        gap.plot(t, np.where(under < 0, under, np.nan), label="$z_O - R$ in contact", **line_arguments("model"))
        gap.plot(t, made["reduced_gap"].values * 1e3, label="$g_r$", **line_arguments("measured"))
        gap.axhline(0.0, **line_arguments("reference"))
        gap.set(ylabel="reduced gap $g_r$ (mm)", xlabel="time since first contact $t_c$ (ms)", xlim=limits)
        gap.legend(loc="upper right")
        letter(gap, "a", f"$h_0$ = {height * 1e3:g} mm")
        radius.plot(t, made["contact_radius"].values * 1e6, **line_arguments("measured"))
        radius.axhline(rest * 1e6, label="Hertz at rest", **line_arguments("reference"))
        radius.set(ylabel="contact radius $a$ (µm)", xlabel=gap.get_xlabel(), xlim=limits, ylim=(0, 950))
        radius.legend(loc="upper right")
        dashes = ("-", (0, (5, 2)), (0, (1.5, 1.5)))
        for number, dash in enumerate(dashes):
            start, end = (float(made[f"{name}_time"][number]) for name in ("impact", "lift_off"))
            inside = (made["time"].values >= start) & (made["time"].values <= end)
            a, label = made["contact_radius"].values[inside] * 1e6, "I" * (number + 1)
            since = (made["time"].values[inside] - made["time"].values[inside][np.argmax(a)]) * 1e3
            near.plot(since, a, label=label, **line_arguments("measured", count=number) | {"linestyle": dash})
            where, how = (
                ((start - first) * 1e3, a.max()),
                {"textcoords": "offset points", "ha": "center", "fontsize": 7},
            )
            radius.annotate(label, where, (0, 3), **how)
        near.set(xlabel="time from largest radius $t_p$ (ms)", ylabel="contact radius $a$ (µm)", ylim=(0, 1150))
        near.legend(loc="upper center", ncols=len(dashes))
        _sketch(sketch)
        letter(sketch, "b")
    dents = (made["reduced_gap"] + made["approach"]).values
    left = np.interp(made["lift_off_time"].values[0] + after, made["time"].values, dents)
    return Drawing(
        "(a) Reduced gap at the centre and contact radius of an acrylic sphere dropped from 1.5 mm, to rest; I, II, "
        "III are the impacts that are analysed, each shown over t_p = 0 at its largest contact radius (below right). "
        "(b) The quantities: drop height h_0, centre O, contact radius a.",
        figure,
        computed=(
            f"drop simulation with {origin}, R = 9.525 mm, 505 g. g_r = z_O - R + w with the displacement "
            "w of the surface at the centre: 0 as long as sphere and disc touch there, in flight with the dent that is "
            f"left ({left * 1e6:.1f} µm 0.1 ms after the first lift-off). {made.sizes['impact']} bounces; the last "
            f"touch comes at {(float(made['final_contact_time']) - first) * 1e3:.0f} ms, and nothing swings after "
            f"{(float(made['rest_time']) - first) * 1e3:.0f} ms. Contact radius at the end "
            f"{float(made['contact_radius'][-1]) * 1e6:.1f} µm; dotted: Hertz radius under the weight with E = 3.2 "
            f"GPa, nu = 0.35: {rest * 1e6:.1f} µm."
        ),
        difference=(
            "the printed figure is a sketch without numbers. The text has g_r negative in contact, by the approach; "
            "with the printed g_r = z_O - R + w it cannot be, as w makes up for it. The approach is drawn beside it."
        ),
        **sweeps,
    )


def _sketch(axes: Any) -> None:
    """Draw the sphere before, in and after contact; not to scale."""
    axes.set(xlim=(-0.2, 8.2), ylim=(-0.9, 4.4), aspect="equal")
    axes.axis("off")
    axes.add_patch(Rectangle((-0.2, -0.6), 8.4, 0.6, facecolor="#d5d5d5", edgecolor="none"))
    places = ((1.0, 1.9, "falling"), (4.0, 0.8, "contact"), (7.0, 1.5, "rebound"))
    for x, height, word in places:
        sphere = Circle((x, height), 1.0, facecolor="#cfe3f1", edgecolor="#0066a6", linewidth=1.0)
        axes.add_patch(sphere)
        sphere.set_clip_path(Rectangle((-0.2, 0.0), 8.4, 9.0, transform=axes.transData))
        axes.plot([x], [height], ".", color="black", markersize=3)
        axes.text(x, 3.6, word, ha="center", fontsize=7)
    axes.text(1.15, 1.95, "$O$", fontsize=7)
    arrow = {"arrowstyle": "<->", "linewidth": 0.7, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", (1.0, 0.9), (1.0, 0.0), arrowprops=arrow)
    axes.text(1.15, 0.25, "$h_0$", fontsize=7)
    axes.annotate("", (3.4, -0.15), (4.6, -0.15), arrowprops=arrow)
    axes.text(4.0, -0.78, "$2a$", fontsize=7, ha="center")
