"""Figure B.2: vibration of the plate."""

import numpy as np

from labpipe.report import line_arguments, value_with_uncertainty
from pipelines.figures.drawing import Drawing, label_outside, legend_above, letter, panels
from pipelines.figures.inputs import Inputs

_ABBREVIATIONS = ("nbr", "peek", "ptfe")
_MOST_HEIGHTS = 4
_SHOWN = (-3.0, 60.0)  # ms around the blow
_BARS, _BAR_STEP = -10.0, 1.5  # ms, where the amplitudes stand


def plate_vibration(inputs: Inputs) -> Drawing:
    """Figure B.2: plate displacement after the impact of several spheres from each height."""
    name = next(iter(inputs.experiments))
    made, table = inputs.result(name, "comparison"), inputs.result(name, "table")
    plate = inputs.result(name, "plate")
    heights = np.unique(table["height"].values)[:_MOST_HEIGHTS]
    kinds = list(dict.fromkeys(table["material"].values.tolist()))
    spelled = {kind: kind.upper() if kind in _ABBREVIATIONS else kind for kind in kinds}
    time = made["time"].values * 1e3
    inside = (time >= _SHOWN[0]) & (time <= _SHOWN[1])
    rows, columns = (len(heights) + 1) // 2, min(2, len(heights))
    with panels(rows, columns, width=2, aspect=0.28 * rows, sharex="all", sharey="all") as (figure, axes):
        for panel, height in enumerate(heights):
            place = axes.flat[panel]
            for i in np.flatnonzero(table["height"].values == height):
                material = str(table["material"].values[i])
                look = line_arguments(None, count=kinds.index(material)) | {"linewidth": 0.9}
                place.plot(time[inside], made["measured"].values[i][inside] * 1e6, label=spelled[material], **look)
                # a bar before the blow: lines of like spheres cover each other
                at, amplitude = _BARS + _BAR_STEP * kinds.index(material), float(table["amplitude"].values[i]) * 1e6
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
