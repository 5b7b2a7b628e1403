"""Figures and tables of the appendices that are computed."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import xarray as xr

from calibration.camera import pixel_size
from labpipe import contact
from labpipe.arrays import Floats
from labpipe.report import Role, line_arguments
from labpipe.signals import nrmse
from labpipe.units import Quantity
from pipelines.figures.drawing import Drawing, legend_above, letter, panels
from pipelines.figures.inputs import Inputs
from pipelines.rig.apparatus import SPHERE, VIEWS


@dataclass(frozen=True, slots=True)
class _Law:
    """One version of appendix A's law: its words, its look, its numbers; Pa, m, N s/m^1.5.

    The damping is the mean of the printed range; the text does not say which height has which.
    """

    words: str
    look: Role
    is_printed: bool = False
    damping: float = 0.5 * (13_700.0 + 16_800.0)
    yield_depth: float = np.inf
    modulus: float = 3.2e9

    def run(self, height: float, duration: float, **asked: Any) -> xr.Dataset:
        """Follow a drop from a height [m] for a time [s] from the release."""
        return contact.collision(
            SPHERE.radius,
            SPHERE.mass,
            height,
            damping=self.damping,
            yield_depth=self.yield_depth,
            youngs_modulus=self.modulus,
            as_printed=self.is_printed,
            duration=duration,
            rtol=1e-6,  # the fit takes differences of 1e-3
            **asked,
        )


_PRINTED = _Law("as printed", "residual", True, yield_depth=2.0e-5)
_ON_A_FLAT = _Law("sphere on a flat, no yield", "model")


def collision_model(inputs: Inputs | None, shown: tuple[float, float] = (-60.0, 250.0)) -> Drawing:
    """Figure A.1: the semi-empirical collision model, as printed and fitted to the drops, over the times shown [ms]."""
    drops: dict[float, list[xr.Dataset]] = {}  # the repeats by height
    for name, settings in ({} if inputs is None else inputs.of_kind("ball_drop")).items():
        drops.setdefault(settings.height.value, []).append(inputs.result(name, "repeats"))  # type: ignore[union-attr]
    laws, said = _fitted(drops) if drops else ({}, "the same E and damping")
    notes: list[str] = []
    with panels(2, 4, width=2, aspect=0.58) as (figure, axes):
        for column, height in enumerate(SPHERE.heights):
            for place, limits in zip(axes[:, column], (shown, (-1.2, 2.4)), strict=True):
                place.set(xlim=limits, xlabel="time $t_c$ (ms)", ylabel="displacement (mm)")
                place.yaxis.label.set_visible(column == 0)
            axes[0, column].set_ylim(-0.25 * height * 1e3, 1.1 * height * 1e3)  # down to where it sinks as printed
            axes[1, column].set_ylim(-0.25, 0.25)
            nearest = min(laws, key=lambda known: abs(known - height), default=None)
            law = _ON_A_FLAT if nearest is None else laws[nearest]
            runs = [(one, one.run(height, 0.35)) for one in (_PRINTED, law)]
            _draw_run(axes[:, column], runs[0][1], _PRINTED)
            for repeats in drops.get(height, ()):
                curve = repeats["time"].values * 1e3, repeats["displacement_mean"].values * 1e3
                for place in axes[:, column]:
                    place.plot(*curve, label=f"laser ({inputs.origin if inputs else ''})", **line_arguments("measured"))
                bounce = 1.7e3 * float(np.sqrt(2.0 * height / SPHERE.gravity))  # the fall twice, less what it loses
                whole, first = (_agreement(runs[1][1], *curve, shown[0], until) for until in (shown[1], bounce))
                notes.append(f"{height * 1e3:g} mm: nRMSE {whole:.1f} % over all, {first:.1f} % in the first bounce")
            _draw_run(axes[:, column], runs[1][1], law)
            deepest = [-1e3 * float(made["displacement"].min()) for _, made in runs]
            notes.append(f"{height * 1e3:g} mm: it sinks {deepest[0]:.2f} mm as printed, {deepest[1]:.3f} mm here")
            letter(axes[0, column], "abcd"[column], f"$h_0$ = {height * 1e3:g} mm")
        legend_above(figure, axes[0, 0])
    laser = "laser displacement, mean of the repeats at each height, from first contact."
    of_fit = "; with E = 3.2 GPa, which the text takes from the literature, contacts last too long" if laws else ""
    return Drawing(
        "Displacement of an acrylic sphere after drops from four heights, and the first impact magnified (below).",
        figure,
        computed=(
            "appendix A's model with nu = 0.35, 505 g. As printed: E = 3.2 GPa, the stiffness of two identical "
            "spheres, the mean of the stated damping range (13 700 to 16 800 N s/m^1.5), yield at 20 µm, unloading "
            f"multiplier 1. The other: the stiffness of a sphere on a rigid flat, twice as much, no yield, {said}. "
            f"{'; '.join(notes)}."
        ),
        difference=(
            "the text gives ranges of damping and unloading multiplier, not the values per height, so the printed "
            f"curves cannot be repeated exactly{of_fit}. The 'yield stress of 2.0e-5 m' is a depth; taken as the "
            "update rule says, every overlap beyond 20 µm stays, and the sphere hardly bounces."
        ),
        **(inputs.data_note(laser) if inputs is not None and drops else {}),
    )


def _fitted(drops: Mapping[float, Sequence[xr.Dataset]], impacts: int = 4) -> tuple[dict[float, _Law], str]:
    """Fit one E, and the damping of each height, to the first restitutions and contact durations.

    Returned are the laws by height in m, and a note on them.
    """
    from scipy.optimize import least_squares

    def laws(parts: Floats) -> dict[float, _Law]:
        common = replace(_ON_A_FLAT, words="fitted to the drops", modulus=float(parts[0]) * _ON_A_FLAT.modulus)
        dampings = zip(drops, (parts[1:] * _ON_A_FLAT.damping).tolist(), strict=True)
        return {height: replace(common, damping=damping) for height, damping in dampings}

    def misses(parts: Floats) -> Floats:
        """Model minus measured restitution and relative duration; a missing impact counts as lost."""
        found = []
        for height, law in laws(parts).items():
            fall = float(np.sqrt(2.0 * height / SPHERE.gravity))
            made = law.run(height, 2.0 * (impacts + 0.5) * fall, impacts=impacts, time=[0.0])
            for name, is_relative in (("restitution", False), ("contact_duration", True)):
                ours = np.nan_to_num(np.pad(made[name].values, (0, impacts - made.sizes["impact"])))
                for seen in drops[height]:
                    values = seen[name].values[:impacts]
                    found.append((ours[: values.size] - values) / (values if is_relative else 1.0))
        return np.concatenate(found)

    found = least_squares(misses, np.ones(1 + len(drops)), bounds=(0.0, np.inf), diff_step=1e-3, xtol=1e-4, ftol=1e-4)
    best = laws(found.x)
    each = ", ".join(f"{law.damping:.0f} ({height * 1e3:g} mm)" for height, law in best.items())
    return best, (
        f"E = {found.x[0] * _ON_A_FLAT.modulus / 1e9:.2f} GPa and c_v = {each} N s/m^1.5 by a fit to "
        f"{found.fun.size // 2} restitutions and contact durations, left {np.sqrt(np.mean(found.fun**2)):.4f} rms"
    )


def _agreement(made: xr.Dataset, since: Floats, moved: Floats, begin: float, until: float) -> float:
    """Return the nRMSE in % of a run against a curve in ms and mm, from one to another in ms."""
    time = (made["time"].values - float(made["impact_time"][0])) * 1e3
    inside = (since >= begin) & (since <= min(until, time[-1])) & np.isfinite(moved)
    return 100 * nrmse(moved[inside], np.interp(since[inside], time, made["displacement"].values * 1e3))


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
        ("front (DIC)", 30e-3, VIEWS.holder, (1.0, 2.0)),
        ("under the disc", 1e-3, VIEWS.under, (1.0, 1.0)),
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
