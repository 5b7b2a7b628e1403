"""Figures that are drawings: 1.5 and D.2, models of springs and dashpots (1.6, 1.8, 1.10), the ringing plate (B.1b)."""

from typing import Any

import numpy as np
from matplotlib.patches import Circle

from calibration import ruler
from labpipe.report import line_arguments
from labpipe.units import Quantity
from pipelines.figures.drawing import Drawing, letter, panels
from pipelines.rig.calibration_images import Photograph

_LINE: dict[str, Any] = {"color": "black", "linewidth": 1.1, "linestyle": "-"}


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
            # discs on a shaken hexagonal lattice
            shake = np.random.default_rng(5).normal(0.0, 0.12 * (pitch - 1.0) + 0.02, (144, 2))
            row, column = np.divmod(np.arange(144), 12)
            lattice = pitch * np.stack([column + 0.5 * (row % 2), row * np.sqrt(0.75)], axis=1)
            for centre in lattice + shake:
                place.add_patch(Circle(centre, 0.46, facecolor="#cfe3f1", edgecolor="#0066a6", linewidth=0.6))
            place.set(xlim=(0.2, 8.2), ylim=(0.2, 8.2), aspect="equal", xticks=[], yticks=[])
            place.grid(visible=False)
            letter(place, name, word)
    return Drawing(
        "(a) Specific volume over temperature with the change of slope at the glass transition, the glassy line "
        "extrapolated, and the free volume; (b), (c) dense and loose packing below and above it.",
        figure,
        computed="two straight lines joined smoothly, slopes 0.06 and 0.16, illustrative.",
    )


def ruler_on_disc() -> Drawing:
    """Figure D.2: an image of a ruler and the scale found in it."""
    image = Photograph(480, 1280, tilt=0.012, seed=7).ruler()
    found = ruler.graduations(image)
    size = Quantity(1e-4 / found.pitch.value, 1e-4 * found.pitch.u / found.pitch.value**2, "m/px")
    with panels(aspect=0.55) as (figure, grid):
        axes = grid[0, 0]
        axes.imshow(image, cmap="gray", vmin=0, vmax=255, interpolation="nearest")
        start = float(found.lines[5])
        end = start + 10 * found.pitch.value
        arrow = {"arrowstyle": "<->", "color": "#cc4e00", "linewidth": 1.2, "shrinkA": 0, "shrinkB": 0}
        axes.annotate("", (start, 330), (end, 330), arrowprops=arrow)
        words, look = f"1 mm = {10 * found.pitch.value:.2f} px (synthetic)", {"color": "#cc4e00", "fontsize": 7}
        axes.text((start + end) / 2, 405, words, ha="center", backgroundcolor="white", **look)
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


def springs_and_dashpots(shows: str, *branches: str) -> Drawing:
    """Draw branches side by side from the top: "E" and an index for a lone spring, a bare index for a Maxwell element.

    An empty text marks omitted branches.
    """
    levels = [1.1 * (len(branches) - 1 - number) for number in range(len(branches))]
    middle = levels[0] / 2
    with panels(aspect=0.26 + 0.17 * (len(branches) - 1)) as (figure, grid):
        axes = grid[0, 0]
        for y, branch in zip(levels, branches, strict=True):
            if branch == "":
                axes.text(2.0, y, "$\\vdots$", ha="center", va="center", fontsize=12)
            elif branch.startswith("E"):
                axes.plot([0.0, 1.0], [y, y], **_LINE)
                _spring(axes, 1.0, y, f"${branch}$")
                axes.plot([3.0, 4.0], [y, y], **_LINE)
            else:
                _spring(axes, 0.0, y, f"$E{branch.strip()}$")
                for along, across in (  # a dashpot
                    ([2.0, 3.1], [0.0, 0.0]),
                    ([3.1, 3.1], [-0.2, 0.2]),  # the piston
                    ([2.65, 3.45, 3.45, 2.65], [0.27, 0.27, -0.27, -0.27]),  # the pot
                    ([3.45, 4.0], [0.0, 0.0]),
                ):
                    axes.plot(along, y + np.array(across), **_LINE)
                axes.text(3.05, y + 0.34, f"$\\mu{branch.strip()}$", ha="center", va="bottom")
        for x, tip, side in ((0.0, -0.9, "right"), (4.0, 4.9, "left")):
            axes.plot([x, x], [0.0, levels[0]], **_LINE)
            axes.annotate(
                "$\\sigma$", (x, middle), (tip, middle), arrowprops={"arrowstyle": "<-"}, ha=side, va="center"
            )
        axes.set(xlim=(-1.3, 5.3), ylim=(-0.6, levels[0] + 0.9), aspect="equal")
        axes.axis("off")
    return Drawing(shows, figure, computed="a drawing; nothing is computed.")


def _spring(axes: Any, x: float, y: float, label: str) -> None:
    """Draw a spring of length 2 from (x, y) to the right."""
    zigzag = np.array([0.0, 0.4, 0.5, 0.7, 0.9, 1.1, 1.3, 1.5, 1.6, 2.0])
    axes.plot(x + zigzag, y + 0.22 * np.array([0, 0, 1, -1, 1, -1, 1, -1, 0, 0]), **_LINE)
    axes.text(x + 1.0, y + 0.34, label, ha="center", va="bottom")


def ringing_plate() -> Drawing:
    """Figure B.1b: motion of a plate after an impact, dimensionless."""
    t, damping = np.linspace(0.0, 10.0, 1001), 0.05
    envelope = np.exp(-damping * 2 * np.pi * t)
    motion = envelope * np.sin(2 * np.pi * np.sqrt(1 - damping**2) * t)
    with panels(aspect=0.6) as (figure, grid):
        axes = grid[0, 0]
        axes.plot(t, motion, label="plate", **line_arguments("measured"))
        for sign, label in ((1, "envelope"), (-1, "")):
            axes.plot(t, sign * envelope, label=label, **line_arguments("reference"))
        axes.set(xlabel="time since impact $t f_0$ (1)", ylabel="displacement over first amplitude (1)")
        axes.legend(loc="upper right")
    return Drawing(
        "Motion of a plate after an impact over its first amplitude, qualitatively: a decaying oscillation about "
        "its position at rest, with its envelope.",
        figure,
        computed="a damped oscillator with a damping ratio of 0.05, an illustrative value.",
    )
