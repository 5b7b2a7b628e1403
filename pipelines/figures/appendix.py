"""Figures and tables of the appendices that are computed."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from calibration.camera import pixel_size
from labpipe import contact
from labpipe.arrays import Floats
from labpipe.report import Role, line_arguments
from labpipe.signals import nrmse
from labpipe.units import Quantity
from pipelines.figures.chapter3 import GRAVITY, HEIGHTS, MASS, SPHERE_RADIUS
from pipelines.figures.drawing import Drawing, legend_above, letter, panels
from pipelines.figures.inputs import Inputs

_YIELD_DEPTH = 2.0e-5
_DAMPING = (13_700.0, 16_800.0)
"""Range of c_v in N s/m^1.5; the text does not say which height has which."""

_FITTED_IMPACTS = 4
_BOUNDS = ((0.0, 5e4), (1e-5, 3e-4), (1.0, 2.0), (1e9, 1e10))
"""Of c_v [N s/m^1.5], yield depth [m], unloading multiplier and E [Pa] in the fit."""

_START = (0.3, 0.5, 0.05, 0.3)
"""Of the fit, as parts of the ranges."""

_STEP, _ENOUGH, _RTOL = 1e-3, 1e-4, 1e-6
"""Of the unknowns in the fit: differences that are taken, and where it ends; of each step of a motion."""
_SHOWN = (-60.0, 250.0)  # ms
_FIRST_BOUNCE = 1.7
"""Until which multiple of the fall's time from first contact the first bounce lasts."""


@dataclass(frozen=True, slots=True)
class _Law:
    """One version of appendix A's law: its words, its look, its numbers."""

    words: str
    look: Role
    is_printed: bool
    damping: float
    yield_depth: float
    unloading: float = 1.0
    modulus: float = 3.2e9

    def run(self, height: float, duration: float, **asked: Any) -> xr.Dataset:
        """Follow a drop from a height [m] for a time [s] from the release."""
        return contact.collision(
            SPHERE_RADIUS,
            MASS,
            height,
            damping=self.damping,
            yield_depth=self.yield_depth,
            unloading_multiplier=self.unloading,
            youngs_modulus=self.modulus,
            as_printed=self.is_printed,
            duration=duration,
            rtol=_RTOL,
            **asked,
        )

    def impacts(self, height: float) -> xr.Dataset:
        """Follow the impacts that are fitted."""
        duration = 2.0 * (_FITTED_IMPACTS + 0.5) * float(np.sqrt(2.0 * height / GRAVITY))  # holds them all
        return self.run(height, duration, impacts=_FITTED_IMPACTS, time=[0.0])


_PRINTED = _Law("as printed", "residual", True, float(np.mean(_DAMPING)), _YIELD_DEPTH)
_ON_A_FLAT = _Law("sphere on a flat, no yield", "model", False, float(np.mean(_DAMPING)), np.inf)


def collision_model(inputs: Inputs | None) -> Drawing:
    """Figure A.1: the semi-empirical collision model, as printed and fitted to the drops."""
    measured: dict[int, list[tuple[Floats, Floats]]] = {}  # time in ms and displacement in mm by height in µm
    if inputs is not None:
        for name, settings in inputs.experiments.items():
            repeats = inputs.result(name, "repeats")
            seen = repeats["time"].values * 1e3, repeats["displacement_mean"].values * 1e3
            measured.setdefault(round(settings.height.value * 1e6), []).append(seen)
    laws, said = ({}, "") if inputs is None or not measured else _fitted(inputs)
    notes: list[str] = []
    with panels(2, 4, width=2, aspect=0.58) as (figure, axes):
        for column, height in enumerate(HEIGHTS):
            for place, limits in zip(axes[:, column], (_SHOWN, (-1.2, 2.4)), strict=True):
                place.set(xlim=limits, xlabel="time $t_c$ (ms)")
            axes[0, column].set_ylim(-0.25 * height * 1e3, 1.1 * height * 1e3)  # down to where it sinks as printed
            axes[1, column].set_ylim(-0.25, 0.25)
            nearest = min(laws, key=lambda known: abs(known - height * 1e6)) if laws else None
            law = _ON_A_FLAT if nearest is None else laws[nearest]
            runs = [(one, one.run(height, 0.35)) for one in (_PRINTED, law)]
            _draw_run(axes[:, column], runs[0][1], _PRINTED)
            for curve in measured.get(round(height * 1e6), ()):
                for place in axes[:, column]:
                    place.plot(*curve, label=f"laser ({inputs.origin if inputs else ''})", **line_arguments("measured"))
                notes.append(_agreement(height, runs[1][1], curve))
            _draw_run(axes[:, column], runs[1][1], law)
            deepest = [-1e3 * float(made["displacement"].min()) for _, made in runs]
            notes.append(f"{height * 1e3:g} mm: it sinks {deepest[0]:.2f} mm as printed, {deepest[1]:.3f} mm here")
            letter(axes[0, column], "abcd"[column], f"$h_0$ = {height * 1e3:g} mm")
        for row in range(2):
            axes[row, 0].set_ylabel("displacement (mm)")
        legend_above(figure, axes[0, 0])
    laser = "laser displacement, mean of the repeats at each height, from first contact."
    of_fit = ""
    if laws:
        of_fit = "; with E = 3.2 GPa, which the text takes from the literature, contacts last too long"
    if len(laws) > 1:
        of_fit += "; a damping that must differ by height says that the solid is not that of (A.4), whose loss grows "
        of_fit += "with the fifth root of the speed"
    return Drawing(
        "Displacement of an acrylic sphere after drops from four heights, and the first impact magnified (below).",
        figure,
        computed=(
            "appendix A's model with nu = 0.35, 505 g. As printed: E = 3.2 GPa, the stiffness of two identical "
            "spheres, the mean of the stated damping range (13 700 to 16 800 N s/m^1.5), yield at 20 µm, "
            "unloading multiplier 1. The other: the stiffness of a sphere on a rigid flat, twice as much, "
            f"{said or 'the same damping, no yield'}. {'; '.join(notes)}."
        ),
        difference=(
            "the text gives ranges of damping and unloading multiplier, not the values per "
            f"height, so the printed curves cannot be repeated exactly{of_fit}. The 'yield "
            "stress of 2.0e-5 m' is a depth; taken as the update rule says, every overlap beyond 20 µm "
            "stays, and the sphere hardly bounces: the printed agreement requires a larger one."
        ),
        **(inputs.data_note(laser) if inputs is not None and measured else {}),
    )


def _fitted(inputs: Inputs) -> tuple[dict[int, _Law], str]:
    """Fit E, yield depth and unloading to all restitutions and contact durations, and the damping to each height's.

    Returned are the laws by height in µm, and what is to be said of them.
    """
    from scipy.optimize import least_squares

    wanted: dict[float, list[xr.Dataset]] = {}
    for name, settings in inputs.experiments.items():
        seen = inputs.result(name, "repeats")[["restitution", "contact_duration"]]
        wanted.setdefault(settings.height.value, []).append(seen.isel(impact=slice(_FITTED_IMPACTS)))

    def law(unit: Floats) -> _Law:
        damping, depth, unloading, modulus = (
            low + float(x) * (high - low) for x, (low, high) in zip(unit, _BOUNDS, strict=True)
        )
        return _Law("fitted to the drops", "model", False, damping, depth, unloading, modulus)

    def fit(start: Sequence[float], heights: Sequence[float], known: Sequence[float] = ()) -> Any:
        def misses(unit: Floats) -> Floats:
            one = law(np.append(unit, known))
            return np.concatenate([_missed(one, height, wanted[height]) for height in heights])

        return least_squares(misses, start, bounds=(0.0, 1.0), diff_step=_STEP, xtol=_ENOUGH, ftol=_ENOUGH)

    every = fit(_START, list(wanted))
    common = law(every.x)
    laws, left = {}, []
    for height in sorted(wanted):
        own = fit(every.x[:1], [height], every.x[1:])
        laws[round(height * 1e6)] = law(np.append(own.x, every.x[1:]))
        left.append(float(np.mean(own.fun**2)))
    count = sum(seen.sizes["impact"] for measured in wanted.values() for seen in measured)
    most = max(float(one.impacts(height * 1e-6)["peak_overlap"].max()) for height, one in laws.items())
    depth = f"yield depth {common.yield_depth * 1e6:.0f} µm"
    if common.yield_depth > most:
        depth += f" (never reached: the overlap is at most {most * 1e6:.0f} µm)"
    each = ", ".join(f"{one.damping:.0f}" for one in laws.values())
    one_height = "" if len(laws) > 1 else ", which do not determine all four"
    return laws, (
        f"E = {common.modulus / 1e9:.2f} GPa, c_v = {each} N s/m^1.5 from "
        f"{', '.join(f'{h * 1e-3:g}' for h in laws)} mm, {depth} and unloading multiplier {common.unloading:.3f} "
        f"by a fit to {count} restitutions and contact durations{one_height}, left {np.sqrt(np.mean(left)):.4f} rms "
        f"(with one c_v for all heights {np.sqrt(np.mean(every.fun**2)):.4f})"
    )


def _missed(law: _Law, height: float, measured: Sequence[xr.Dataset]) -> Floats:
    """Return model minus measured restitution and relative duration (2 impacts,); a missing impact counts as lost."""
    made = law.impacts(height)
    found = []
    for name, is_relative in (("restitution", False), ("contact_duration", True)):
        ours = np.nan_to_num(np.pad(made[name].values, (0, _FITTED_IMPACTS - made.sizes["impact"])))
        for seen in measured:
            values = seen[name].values
            found.append((ours[: values.size] - values) / (values if is_relative else 1.0))
    return np.concatenate(found)


def _agreement(height: float, made: xr.Dataset, curve: tuple[Floats, Floats]) -> str:
    """Say how well a run agrees with a measured curve over what is drawn, and in the first contact."""
    since, moved = curve
    fall = 1e3 * float(np.sqrt(2.0 * height / GRAVITY))
    time = (made["time"].values - float(made["impact_time"][0])) * 1e3
    notes = []
    spans = ((*_SHOWN, "over all"), (0.0, _FIRST_BOUNCE * fall, "in the first bounce"))
    for low, high, words in spans:
        inside = (since >= low) & (since <= min(high, time[-1])) & np.isfinite(moved)
        ours = np.interp(since[inside], time, made["displacement"].values * 1e3)
        notes.append(f"{100 * nrmse(moved[inside], ours):.1f} % {words}")
    return f"{height * 1e3:g} mm: nRMSE {', '.join(notes)}"


def _draw_run(places: Any, made: xr.Dataset, law: _Law) -> None:
    t = (made["time"].values - float(made["impact_time"][0])) * 1e3
    for place in places:
        place.plot(t, made["displacement"].values * 1e3, label=law.words, **line_arguments(law.look))


def camera_table() -> Drawing:
    """Table D.1: pixel sizes of both cameras with their uncertainties."""
    head = "view,frame rate (Hz),resolution (px),length (m),distance (px),pixel size (m/px)"
    lines = [f"{head},least relative uncertainty (%),largest relative uncertainty (%)"]
    found = []
    for view, length, pixels, errors in (
        ("front (DIC)", 30e-3, 386.0, (1.0, 2.0)),
        ("under the disc", 1e-3, 461.0, (1.0, 1.0)),
    ):
        sizes = [pixel_size(Quantity(length, 0.0, "m"), Quantity(pixels, u, "px")) for u in errors]
        size, (low, high) = sizes[0].value, (100 * one.u / one.value for one in sizes)
        lines.append(f"{view},10000,1280 x 480,{length:g},{pixels:g},{size:.6g},{low:.3g},{high:.3g}")
        found.append((size, low, high))
    (front, low, high), (disc, least, _) = found
    return Drawing(
        "Pixel size of both cameras from a known length and its distance in the image.",
        measured="lengths and distances as the thesis prints them.",
        computed="pixel sizes by eq. (D.1) and the share of 1 to 2 px (front) and 1 px (disc).",
        difference=(
            f"front {front * 1e6:.2f} µm/px, {low:.2f} to {high:.2f} % (printed 77.7 and 0.3 to 0.5); disc "
            f"{disc * 1e6:.3f} µm/px, {least:.2f} % (printed 2.17 and 0.2). The two differ by a factor "
            f"{front / disc:.1f}, not by about two orders of magnitude."
        ),
        table="\n".join(lines) + "\n",
    )
