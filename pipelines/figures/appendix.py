"""Figures and tables of the appendices that are computed."""

from typing import Any

import numpy as np
import xarray as xr

from calibration.camera import pixel_size
from labpipe import contact
from labpipe.report import Role, line_arguments
from labpipe.units import Quantity
from pipelines.figures.chapter3 import HEIGHTS, MASS, SPHERE_RADIUS
from pipelines.figures.drawing import Caption, Drawing, legend_above, letter, panels
from pipelines.figures.inputs import Inputs

_YIELD_DEPTH = 2.0e-5
_DAMPING = (13_700.0, 16_800.0)
"""Range of c_v in N s/m^1.5; the text does not say which height has which."""


_VERSIONS: tuple[tuple[str, bool, float, Role], ...] = (
    ("as printed, yield 20 µm", True, _YIELD_DEPTH, "residual"),
    ("as printed, no yield", True, np.inf, "model"),
    ("sphere on a flat, no yield", False, np.inf, "reference"),
)
"""Words, whether the stiffness is the printed one, elastic depth in m, look."""


def collision_model(inputs: Inputs | None) -> Drawing:
    """Figure A.1: the semi-empirical collision model, as printed and corrected."""
    measured = {} if inputs is None else _first_contacts(inputs)
    restitution: dict[str, list[float]] = {words: [] for words, *_ in _VERSIONS}
    with panels(2, 4, width=2, aspect=0.58) as (figure, axes):
        for column, height in enumerate(HEIGHTS):
            _height_column(axes[:, column], height)
            for words, made in _runs(height).items():
                restitution[words].append(float(made["restitution"][0]))
                _draw_run(axes[:, column], made, words)
            for curve in measured.get(round(height * 1e6), ()):
                for place in axes[:, column]:
                    place.plot(*curve, label=f"laser ({inputs.origin if inputs else ''})", **line_arguments("measured"))
            letter(axes[0, column], "abcd"[column], f"$h_0$ = {height * 1e3:g} mm")
        for row in range(2):
            axes[row, 0].set_ylabel("displacement (mm)")
        legend_above(figure, axes[0, 0])
    first = "; ".join(f"{words}: {', '.join(f'{e:.2f}' for e in values)}" for words, values in restitution.items())
    laser = "laser displacement, mean of the repeats at each height, from first contact."
    return Drawing(
        Caption(
            "Displacement of an acrylic sphere after drops from four heights, and the first impact magnified (below).",
            computed=(
                "appendix A's model with E = 3.2 GPa, nu = 0.35, 505 g and the mean of the stated "
                "damping range (13 700 to 16 800 N s/m^1.5). The printed stiffness is that of two "
                "identical spheres; a sphere on a rigid flat has twice as much. First "
                f"restitution from 1.5, 5, 7 and 10 mm: {first}."
            ),
            difference=(
                "the text gives ranges of damping and unloading multiplier, not the values per "
                "height, so the printed curves cannot be repeated exactly. The 'yield stress of "
                "2.0e-5 m' is a depth; taken as the update rule says, every overlap beyond 20 µm "
                "stays, and the sphere hardly bounces: the printed agreement requires a larger one."
            ),
            **(inputs.data_note(laser) if inputs is not None and measured else {}),
        ),
        figure,
    )


def _runs(height: float) -> dict[str, xr.Dataset]:
    return {
        words: contact.collision(
            SPHERE_RADIUS,
            MASS,
            height,
            damping=float(np.mean(_DAMPING)),
            yield_depth=depth,
            duration=0.35,
            as_printed=printed,
        )
        for words, printed, depth, _ in _VERSIONS
    }


def _draw_run(places: Any, made: xr.Dataset, words: str) -> None:
    role = next(role for name, *_, role in _VERSIONS if name == words)
    t = (made["time"].values - float(made["impact_time"][0])) * 1e3
    for place in places:
        look = line_arguments(role)
        place.plot(t, made["displacement"].values * 1e3, label=words, **look)


def _height_column(places: Any, height: float) -> None:
    """Set the limits of the two panels of one height: the whole drop, the first impact."""
    for place, limits in zip(places, ((-60.0, 250.0), (-1.2, 2.4)), strict=True):
        place.set_xlim(*limits)
        place.set_xlabel("time $t_c$ (ms)")
    places[0].set_ylim(-0.15 * height * 1e3, 1.1 * height * 1e3)
    places[1].set_ylim(-0.25, 0.25)


def _first_contacts(inputs: Inputs) -> dict[int, list[tuple[np.ndarray, np.ndarray]]]:
    """Return time [ms] and displacement [mm] from first contact by height in µm."""
    found: dict[int, list[tuple[np.ndarray, np.ndarray]]] = {}
    for name, settings in inputs.experiments.items():
        made = inputs.result(name, "repeats")
        curve = made["time"].values * 1e3, made["displacement_mean"].values * 1e3
        found.setdefault(round(settings.height.value * 1e6), []).append(curve)
    return found


def camera_table() -> Drawing:
    """Table D.1: pixel sizes of both cameras with their uncertainties."""
    rows = [_scale("front (DIC)", 30e-3, 386.0, (1.0, 2.0)), _scale("under the disc", 1e-3, 461.0, (1.0, 1.0))]
    head = "view,frame rate (Hz),resolution (px),length (m),distance (px),pixel size (m/px)"
    lines = [f"{head},least relative uncertainty (%),largest relative uncertainty (%)"]
    lines += [
        f"{view},10000,1280 x 480,{length:g},{pixels:g},{size:.6g},{low:.3g},{high:.3g}"
        for view, length, pixels, size, low, high in rows
    ]
    return Drawing(
        Caption(
            "Pixel size of both cameras from a known length and its distance in the image.",
            measured="lengths and distances as the thesis prints them.",
            computed="pixel sizes by eq. (D.1) and the share of 1 to 2 px (front) and 1 px (disc).",
            difference=(
                f"front {rows[0][3] * 1e6:.2f} µm/px, {rows[0][4]:.2f} to {rows[0][5]:.2f} % "
                "(printed 77.7 and 0.3 to 0.5); disc "
                f"{rows[1][3] * 1e6:.3f} µm/px, {rows[1][4]:.2f} % (printed 2.17 and 0.2). "
                f"The two differ by a factor {rows[0][3] / rows[1][3]:.1f}, not by about two "
                "orders of magnitude."
            ),
        ),
        table="\n".join(lines) + "\n",
    )


def _scale(
    view: str, length: float, pixels: float, u_pixels: tuple[float, float]
) -> tuple[str, float, float, float, float, float]:
    """Return view, length, distance, pixel size [m/px] and its least and largest share of u [%]."""
    sizes = [pixel_size(Quantity(length, 0.0, "m"), Quantity(pixels, u, "px")) for u in u_pixels]
    least, largest = (100 * size.u / size.value for size in sizes)
    return view, length, pixels, sizes[0].value, least, largest
