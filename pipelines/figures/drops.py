"""Figures 3.10 to 3.12 and B.2: records of the laser of drops from four heights, of the sphere and of the plate."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from labpipe.report import kept_samples, line_arguments, value_with_uncertainty
from pipelines.figures.drawing import Drawing, label_outside, legend_above, letter, panels
from pipelines.figures.inputs import Inputs, with_u


@dataclass(frozen=True, slots=True)
class Shown:
    """The parts of a drop that are drawn; ms since first contact.

    From ``before`` until ``past`` times the time to rest; the first impacts, ``middle`` of them, as later ones run into
    each other on paper; the first one alone. A band has at most ``points``: a panel is some 800 points of a printer
    wide.
    """

    before: float = 20.0
    past: float = 1.05
    middle: int = 15
    first: tuple[float, float] = (-0.5, 2.0)
    points: int = 4000


_SHOWN = Shown()


def heights(inputs: Inputs, material: str, shown: Shown = _SHOWN) -> Drawing:
    """Draw displacement and first penetration of each drop height, of more than four the four lowest, lowest first."""
    chosen = inputs.of_kind("ball_drop", most=4)
    agreement, widths = [], []
    aspect = 0.1 + 0.25 * len(chosen)
    with panels(len(chosen), 3, width=2, aspect=aspect, width_ratios=(1.7, 1.2, 1.0)) as (figure, axes):
        for row, (name, settings) in enumerate(chosen.items()):
            height = f"{settings.height.value * 1e3:g} mm"
            repeats, model, found = (inputs.result(name, stage) for stage in ("repeats", "model", "comparison"))
            rests = [inputs.result(name, "bounces", file) for file in settings.laser]
            rest = float(np.max([one["rest_time"] - one["first_contact_time"] for one in rests]))
            widths.append(f"{height}: {_row(axes[row], repeats, model, inputs.origin, rest, shown)}")
            letter(axes[row, 0], "abcd"[row], f"$h_0$ = {height}")
            restitution = with_u(found, "restitution_difference", 1.0, 4, impact=0)
            agreement.append(f"{height}: nRMSE {100 * float(found['nrmse']):.2f} %, first restitution {restitution}")
        label_outside(axes, "time $t_c$ (ms)")
        legend_above(figure, axes[0, 0])
    return Drawing(
        f"Displacement of a sphere of {material} dropped from {', '.join(w.partition(':')[0] for w in widths)}, from "
        f"{shown.before:g} ms before first contact to rest or the end of the recordings (left); green: the "
        f"penetration, magnified in the first {shown.middle} impacts (middle) and in the first (right).",
        figure,
        computed=(
            "lines: drop simulation with the material that the session names. Model against the mean of the repeats: "
            f"{'; '.join(agreement)}. Bands: {'; '.join(widths)}; the left panels hold them within the line's width "
            "until the bounces run apart."
        ),
        **inputs.data_note(
            f"bands: the envelope of {repeats.sizes['repeat']} laser recordings per height, from the lowest to the "
            "highest at each time."
        ),
    )


def _row(places: Any, repeats: xr.Dataset, model: xr.Dataset, origin: str, rest: float, shown: Shown) -> str:
    """Draw one height: the whole drop in mm until all rest [s], the first penetrations and one in µm.

    Returned is a note on the width of the band of the repeats.
    """
    t = repeats["time"].values * 1e3
    t_model = (model["time"].values - float(model["impact_time"][0])) * 1e3
    # Where bounces have run apart, a mean less two standard deviations would reach below the flat.
    lowest, highest = repeats["displacement"].min("repeat").values, repeats["displacement"].max("repeat").values
    deepest = float(model["displacement"].min()) * 1e6
    end = float(np.fmin(t[-1], 1e3 * shown.past * rest))
    beyond = 1e3 * float(model["impact_time"][: shown.middle + 1][-1] - model["impact_time"][0])
    spans = ((-shown.before, end), (-shown.before, min(end, beyond)), shown.first)
    for place, factor, limits in zip(places, (1e3, 1e6, 1e6), spans, strict=True):
        place.axhspan(1.3 * deepest * factor * 1e-6, 0.0, color="#bfe3c6", linewidth=0, zorder=-1, label="penetration")
        at = np.flatnonzero((t >= limits[0]) & (t <= limits[1]))
        at = at[kept_samples(t[at], [lowest[at], highest[at]], shown.points)]
        # An edge keeps a band visible that is narrower than a line on this scale.
        band = {"facecolor": "#8cc1e6", "edgecolor": line_arguments("measured")["color"], "linewidth": 0.5}
        low, high = lowest[at] * factor, highest[at] * factor
        place.fill_between(t[at], low, high, label=f"laser, {origin}", **band)
        inside = (t_model >= limits[0]) & (t_model <= limits[1])
        moved = model["displacement"].values[inside] * factor
        place.plot(t_model[inside], moved, label="model", **(line_arguments("model") | {"linewidth": 0.8}))
        place.set_xlim(limits)
        if place is places[0]:
            place.set(ylabel="displacement (mm)", ylim=(1.3e-3 * deepest, None))
        else:
            place.set(ylabel="displacement (µm)", ylim=(1.3 * deepest, -0.6 * deepest))
    wide = (highest - lowest) * 1e6
    first = float(np.nanmedian(wide[(t >= shown.first[0]) & (t <= shown.first[1])]))
    return f"{first:.1f} µm wide in the first impact, at most {float(np.nanmax(wide[t >= 0])):.0f} µm later"


def plate_vibration(inputs: Inputs, bars: tuple[float, float] = (-10.0, 1.5)) -> Drawing:
    """Figure B.2: plate displacement after the impact of several spheres from each height.

    ``bars`` are where the first of the amplitudes stands, and their distance [ms].
    """
    name = next(iter(inputs.experiments))
    made, table = inputs.result(name, "comparison"), inputs.result(name, "table")
    plate = inputs.result(name, "plate")
    heights = np.unique(table["height"].values)[:4]
    kinds = list(dict.fromkeys(table["material"].values.tolist()))
    spelled = {kind: kind.upper() if kind in ("nbr", "peek", "ptfe") else kind for kind in kinds}
    time = made["time"].values * 1e3
    rows, columns = (len(heights) + 1) // 2, min(2, len(heights))
    with panels(rows, columns, width=2, aspect=0.28 * rows, sharex="all", sharey="all") as (figure, axes):
        for panel, height in enumerate(heights):
            place = axes.flat[panel]
            for i in np.flatnonzero(table["height"].values == height):
                material = str(table["material"].values[i])
                look = line_arguments(None, count=kinds.index(material)) | {"linewidth": 0.9}
                place.plot(time, made["measured"].values[i] * 1e6, label=spelled[material], **look)
                # a bar before the blow: lines of like spheres cover each other
                at, amplitude = bars[0] + bars[1] * kinds.index(material), float(table["amplitude"].values[i]) * 1e6
                bar = {"color": look["color"], "linestyle": "-", "linewidth": 2.5, "solid_capstyle": "butt"}
                place.plot([at, at], [0.0, amplitude], **bar)
            letter(place, "abcd"[panel], f"$h_0$ = {height * 1e3:g} mm")
        label_outside(axes, "time from impact (ms)", "plate, upwards (µm)")
        legend_above(figure, axes[0, 0])
    notes = []
    for kind in kinds:
        chosen = np.flatnonzero(table["material"].values == kind)
        values = table["amplitude"].values[chosen[np.argsort(table["height"].values[chosen], kind="stable")]] * 1e6
        notes.append(f"{spelled[kind]} {', '.join(f'{value:.2f}' for value in values)}")
    worst = 100 * float(made["nrmse"].max())
    chance = float(table["probability_natural_frequency"])
    return Drawing(
        "Displacement of the plate beside the disc after the first contact of spheres of "
        f"{', '.join(spelled.values())}, mean of the repeats; bars before the blow: amplitudes at impact, in "
        "this order.",
        figure,
        computed=(
            f"free vibration between the first two contacts: natural frequency {_shown(plate, 'frequency', 'Hz')}, "
            f"damping ratio {_shown(plate, 'damping_ratio', '1')}, modal mass {_shown(plate, 'mass', 'kg')}; "
            f"amplitudes at impact in µm: {'; '.join(notes)}. Measured minus simulated drop on that plate: "
            f"nRMSE at most {worst:.1f} %."
        ),
        difference=(
            f"the thesis prints no numbers; it says that the frequency is the same for all "
            f"materials and heights (here: probability {chance:.2f} of so large a difference "
            "by chance) and that the amplitude grows with the height."
        ),
        **inputs.data_note(f"{int(table['n'].sum())} recordings of the laser on the plate ({name})."),
    )


def _shown(plate: object, name: str, unit: str) -> str:
    value, u = (float(plate[key]) for key in (name, f"u_{name}"))  # type: ignore[index]
    return value_with_uncertainty(value, u, unit) if np.isfinite(value) else "not known"
