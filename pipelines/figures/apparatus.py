"""Figures 1.5, B.2 and D.2: volume and molecules, the ringing plate, the ruler."""

from typing import Any

import numpy as np
from matplotlib.patches import Circle

from calibration import ruler
from labpipe import contact, materials
from labpipe.report import line_arguments
from labpipe.units import Quantity
from pipelines.figures.chapter3 import HEIGHTS, MASS, SPHERE_RADIUS
from pipelines.figures.drawing import Drawing, label_outside, legend_above, letter, panels, spelled
from pipelines.rig.calibration_images import ruler_image

_PLATE = contact.Plate(mass=20.0, frequency=180.0, damping_ratio=0.03)
"""Illustrative: the thesis prints neither mass nor frequency nor damping."""

_SPHERES = ("nylon", "acrylic", "peek", "ptfe")
_RINGING = 0.06
"""s after first contact that are shown."""

_IMAGE = (480, 1280)
_TILT = 0.012  # rad, a ruler laid down by hand


def glass_transition() -> Drawing:
    """Figure 1.5: specific volume over temperature, and how molecules pack."""
    t = np.linspace(-1.0, 1.0, 401)
    glass, rubber, width = 0.06, 0.16, 0.06
    # A kink of finite width: the slope goes from glassy to rubbery around the transition.
    volume = 1 + 0.5 * (glass + rubber) * t + 0.5 * (rubber - glass) * width * np.log(np.cosh(t / width))
    cold = 1 + glass * t - 0.5 * (rubber - glass) * width * np.log(2)
    with panels(1, 3, width=2, aspect=0.36, width_ratios=(1.6, 1.0, 1.0)) as (figure, axes):
        left = axes[0, 0]
        left.plot(t, volume, label="specific volume", **line_arguments("measured"))
        left.plot(t[t > 0], cold[t > 0], label="glass, extrapolated", **line_arguments("reference"))
        shade = {"alpha": 0.2, "linewidth": 0, "color": line_arguments("model")["color"]}
        left.fill_between(t[t > 0], cold[t > 0], volume[t > 0], label="free volume", **shade)
        left.axvline(0.0, color="#808080", linewidth=0.7)
        left.set(
            xlabel="temperature $(\\theta - \\theta_g)/\\theta_g$ (1)", ylabel="volume over that at $\\theta_g$ (1)"
        )
        left.legend(loc="upper left")
        letter(left, "a")
        for place, pitch, name, word in ((axes[0, 1], 1.0, "b", "glass"), (axes[0, 2], 1.35, "c", "rubber")):
            _molecules(place, pitch)
            letter(place, name, word)
    return Drawing(
        "(a) Specific volume over temperature with the change of slope at the glass transition, the glassy line "
        "extrapolated, and the free volume; (b), (c) dense and loose packing below and above it.",
        figure,
        computed="two straight lines joined smoothly, slopes 0.06 and 0.16, illustrative.",
        difference="the printed figure is a sketch without numbers.",
    )


def _molecules(axes: Any, pitch: float) -> None:
    """Draw discs on a shaken hexagonal lattice; a larger pitch is a looser packing."""
    shake = np.random.default_rng(5).normal(0.0, 0.12 * (pitch - 1.0) + 0.02, (400, 2))
    count = 0
    for row in range(12):
        for column in range(12):
            x = (column + 0.5 * (row % 2)) * pitch + shake[count, 0]
            y = row * pitch * np.sqrt(0.75) + shake[count, 1]
            count += 1
            axes.add_patch(Circle((x, y), 0.46, facecolor="#cfe3f1", edgecolor="#0066a6", linewidth=0.6))
    axes.set(xlim=(0.2, 8.2), ylim=(0.2, 8.2), aspect="equal", xticks=[], yticks=[])
    axes.grid(visible=False)


def plate_vibration() -> Drawing:
    """Figure B.2: plate displacement after the impact of four spheres from four heights."""
    largest: dict[str, list[float]] = {name: [] for name in _SPHERES}
    with panels(2, 2, width=2, aspect=0.56, sharex="all", sharey="all") as (figure, axes):
        for panel, height in enumerate(HEIGHTS):
            place = axes.flat[panel]
            fall = float(np.sqrt(2 * height / 9.81))
            times = fall + np.linspace(0.0, _RINGING, 1201)
            for number, name in enumerate(_SPHERES):
                made = contact.drop(
                    materials.load(name), SPHERE_RADIUS, MASS, height, float(times[-1]), plate=_PLATE, times=times
                )
                moved = -made["plate_displacement"].values * 1e6
                largest[name].append(float(np.abs(moved).max()))
                since, line = (
                    (made["time"].values - fall) * 1e3,
                    line_arguments(None, count=number) | {"linewidth": 0.9},
                )
                place.plot(since, moved, label=spelled(name), **line)
            letter(place, "abcd"[panel], f"$h_0$ = {height * 1e3:g} mm")
        label_outside(axes, "time $t_c$ (ms)", "plate, upwards (µm)")
        legend_above(figure, axes[0, 0])
    peaks = "; ".join(f"{spelled(n)} {', '.join(f'{p:.1f}' for p in v)}" for n, v in largest.items())
    return Drawing(
        "Displacement of the plate after the first contact of nylon, acrylic, PEEK and PTFE spheres from four heights.",
        figure,
        computed=(
            f"drop simulation with a plate of {_PLATE.mass:g} kg, {_PLATE.frequency:g} Hz and damping ratio "
            f"{_PLATE.damping_ratio:g}, illustrative values. Largest displacement in µm from 1.5, 5, 7, 10 mm: {peaks}."
        ),
        difference=(
            "the thesis prints neither frequency, damping nor amplitudes; as it says, the "
            "frequency is the plate's own and the amplitude grows with the height."
        ),
    )


def ruler_on_disc() -> Drawing:
    """Figure D.2: an image of a ruler and the scale found in it."""
    image = ruler_image(*_IMAGE, tilt=_TILT, seed=7)
    found = ruler.graduations(image)
    size = Quantity(1e-4 / found.pitch.value, 1e-4 * found.pitch.u / found.pitch.value**2, "m/px")
    with panels(aspect=0.55) as (figure, grid):
        axes = grid[0, 0]
        axes.imshow(image, cmap="gray", vmin=0, vmax=255, interpolation="nearest")
        start = float(found.lines[5])
        end = start + 10 * found.pitch.value
        arrow = {"arrowstyle": "<->", "color": "#cc4e00", "linewidth": 1.2, "shrinkA": 0, "shrinkB": 0}
        axes.annotate("", (start, 330), (end, 330), arrowprops=arrow)
        axes.text(
            (start + end) / 2,
            405,
            f"1 mm = {10 * found.pitch.value:.2f} px (synthetic)",
            ha="center",
            color="#cc4e00",
            backgroundcolor="white",
            fontsize=7,
        )
        axes.grid(visible=False)
        axes.set(xlabel="column (px)", ylabel="row (px)")
    return Drawing(
        "Ruler with ten graduations per millimetre under the camera below the disc, and the "
        "distance of 1 mm found in the image.",
        figure,
        synthetic="the image: 461 px per mm, tilted by 12 mrad, blurred, with noise.",
        computed=(
            f"pitch by the centroids of {found.lines.size} lines: {found.pitch.value:.4f} px "
            f"per 0.1 mm, so {size.value * 1e6:.4f} µm/px; the lines alone leave "
            f"{1e6 * size.u / size.value:.0f} parts in a million, the ruler itself more."
        ),
        difference=(
            "printed 461 px by hand, 2.17 µm/px, 0.2 % for one px: with all lines the "
            "reading no longer limits the scale."
        ),
    )
