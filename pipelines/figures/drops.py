"""Figures 3.10 to 3.12: drops from four heights, band of the repeats and simulation."""

from typing import Any

import numpy as np
import xarray as xr

from labpipe.arrays import Floats
from labpipe.report import kept_samples, line_arguments
from pipelines.figures.drawing import Drawing, label_outside, legend_above, letter, panels
from pipelines.figures.inputs import Inputs

_BEFORE, _PAST_REST = 20.0, 1.05
"""Shown before first contact in ms, and until when, as a multiple of the time until rest."""

_ZOOM = (-0.5, 2.0)
_MOST_HEIGHTS = 4
_GREEN = "#bfe3c6"

_DRAWN_POINTS = 4000
"""Of a band; a panel is some 800 points of a printer wide."""


def heights(inputs: Inputs, sphere: str) -> Drawing:
    """Draw displacement and first penetration of each drop height, of more than four the four lowest, lowest first.

    The caption names the sphere with its article.
    """
    chosen = sorted(inputs.experiments, key=lambda name: inputs.experiments[name].height.value)
    chosen = chosen[:_MOST_HEIGHTS]
    notes = []
    aspect = 0.1 + 0.25 * len(chosen)
    with panels(len(chosen), 3, width=2, aspect=aspect, width_ratios=(1.7, 1.2, 1.0)) as (figure, axes):
        for row, name in enumerate(chosen):
            height = inputs.experiments[name].height.value
            results = {stage: inputs.result(name, stage) for stage in ("repeats", "model", "comparison")}
            _row(axes[row], results, inputs.origin, _rest(inputs, name))
            letter(axes[row, 0], "abcd"[row], f"$h_0$ = {height * 1e3:g} mm")
            found = results["comparison"]
            gap, u = (float(found[f"{p}restitution_difference"][0]) for p in ("", "u_"))
            nrmse = 100 * float(found["nrmse"])
            notes.append(f"{height * 1e3:g} mm: nRMSE {nrmse:.2f} %, first restitution {gap:+.4f} ± {u:.4f}")
        label_outside(axes, "time $t_c$ (ms)")
        legend_above(figure, axes[0, 0])
    number = int(results["repeats"].sizes["repeat"])
    is_at_rest = np.isfinite([_rest(inputs, name) for name in chosen]).all()
    until = "rest" if is_at_rest else "rest or the end of the recordings"
    return Drawing(
        f"Displacement of {sphere} sphere after drops from {len(chosen)} {'heights' if len(chosen) > 1 else 'height'}, "
        f"from {_BEFORE:g} ms before first contact to {until} (left); green: the penetration, "
        "magnified in all impacts (middle) and in the first (right).",
        figure,
        computed=(
            "lines: drop simulation with the material that the session names. Agreement with "
            f"the mean of the repeats: {'; '.join(notes)}."
        ),
        difference="the printed figures give no number for the agreement.",
        **inputs.data_note(
            f"bands: the envelope of {number} laser recordings per height, from the lowest to the highest at "
            f"each time ({'; '.join(_widths(inputs, chosen))}; the left panels hold it within the line's width until "
            "the bounces run apart)."
        ),
    )


def _widths(inputs: Inputs, chosen: list[str]) -> list[str]:
    """Say how wide the band of each height is, at the first impact and at most."""
    found = []
    for name in chosen:
        repeats = inputs.result(name, "repeats")
        time, (low, high) = repeats["time"].values * 1e3, _envelope(repeats)
        wide = (high - low) * 1e6
        first = float(np.nanmedian(wide[(time >= _ZOOM[0]) & (time <= _ZOOM[1])]))
        found.append(
            f"{inputs.experiments[name].height.value * 1e3:g} mm: {first:.1f} µm wide in the first impact, "
            f"at most {float(np.nanmax(wide[time >= 0])):.0f} µm later"
        )
    return found


def _envelope(repeats: xr.Dataset) -> tuple[Floats, Floats]:
    """Return the lowest and highest displacement [m] (time,) of the recordings.

    Where bounces have run apart, a mean less two standard deviations would lie below the flat.
    """
    moved = repeats["displacement"]
    return moved.min("repeat").values, moved.max("repeat").values


def _row(places: Any, results: dict[str, xr.Dataset], origin: str, rest: float) -> None:
    """Draw one height: the whole drop in mm until all rest, all penetrations and the first one in µm."""
    repeats, model = results["repeats"], results["model"]
    t = repeats["time"].values * 1e3
    first = float(model["impact_time"][0])
    t_model = (model["time"].values - first) * 1e3
    lowest, highest = _envelope(repeats)
    deepest = float(model["displacement"].min()) * 1e6
    end = float(np.fmin(t[-1], 1e3 * _PAST_REST * rest))
    look = line_arguments("measured")
    spans = ((-_BEFORE, end), (-_BEFORE, end), _ZOOM)
    for place, factor, limits in zip(places, (1e3, 1e6, 1e6), spans, strict=True):
        place.axhspan(1.3 * deepest * factor * 1e-6, 0.0, color=_GREEN, linewidth=0, zorder=-1, label="penetration")
        shown = np.flatnonzero((t >= limits[0]) & (t <= limits[1]))
        shown = shown[kept_samples(t[shown], [lowest[shown], highest[shown]], _DRAWN_POINTS)]
        low, high = lowest[shown] * factor, highest[shown] * factor
        # An edge keeps a band visible that is narrower than a line on this scale.
        place.fill_between(
            t[shown], low, high, facecolor="#8cc1e6", edgecolor=look["color"], linewidth=0.5, label=f"laser, {origin}"
        )
        inside = (t_model >= limits[0]) & (t_model <= limits[1])
        moved = model["displacement"].values[inside] * factor
        place.plot(t_model[inside], moved, label="model", **(line_arguments("model") | {"linewidth": 0.8}))
        place.set_xlim(limits)
    places[0].set(ylabel="displacement (mm)", ylim=(1.3e-3 * deepest, None))
    places[1].set(ylabel="displacement (µm)", ylim=(1.3 * deepest, -0.6 * deepest))
    places[2].set(ylabel="displacement (µm)", ylim=(1.3 * deepest, -0.6 * deepest))


def _rest(inputs: Inputs, name: str) -> float:
    """Return how long after first contact [s] the last repeat came to rest; NaN where one ended before."""
    seen = [inputs.result(name, "bounces", file) for file in inputs.experiments[name].laser]
    return float(np.max([one["rest_time"] - one["first_contact_time"] for one in seen]))
