"""Figures 3.10 to 3.12: drops from four heights, band of the repeats and simulation."""

from typing import Any

import numpy as np
import xarray as xr

from labpipe.report import line_arguments
from pipelines.figures.drawing import Caption, Drawing, legend_above, letter, panels
from pipelines.figures.inputs import Inputs

_COVERAGE = 2.0
"""Standard deviations of the repeats in the band."""

_BEFORE, _AFTER = 20.0, 250.0
_ZOOM = (-0.5, 2.0)
_MOST_HEIGHTS = 4


def acrylic(inputs: Inputs) -> Drawing:
    """Figure 3.10."""
    return heights(inputs, "an acrylic")


def nylon(inputs: Inputs) -> Drawing:
    """Figure 3.11."""
    return heights(inputs, "a nylon")


def peek(inputs: Inputs) -> Drawing:
    """Figure 3.12."""
    return heights(inputs, "a PEEK")


def heights(inputs: Inputs, sphere: str) -> Drawing:
    """Draw displacement and first penetration of each drop height, lowest first.

    Parameters
    ----------
    inputs : Inputs
        Ball drops; of more than four the four lowest are shown.
    sphere : str
        With its article, for the caption.
    """
    chosen = sorted(inputs.experiments, key=lambda name: inputs.experiments[name].height.value)
    chosen = chosen[:_MOST_HEIGHTS]
    notes = []
    aspect = 0.58 if len(chosen) > 1 else 1.2
    with panels(2, len(chosen), width=2, aspect=aspect) as (figure, axes):
        for column, name in enumerate(chosen):
            height = inputs.experiments[name].height.value
            results = {stage: inputs.result(name, stage) for stage in ("repeats", "model", "comparison")}
            _column(axes[:, column], results, inputs.origin)
            letter(axes[0, column], "abcd"[column], f"$h_0$ = {height * 1e3:g} mm")
            notes.append(_agreement(height, results))
        for row in range(2):
            axes[row, 0].set_ylabel("displacement (mm)" if row == 0 else "displacement (µm)")
        legend_above(figure, axes[0, 0])
    number = int(results["repeats"].sizes["repeat"])
    return Drawing(
        Caption(
            f"Displacement of {sphere} sphere after drops from {len(chosen)} heights, from first "
            "contact (above), and the first penetration (below).",
            computed=(
                "lines: drop simulation with the material that the session names. Agreement with "
                f"the mean of the repeats: {'; '.join(notes)}."
            ),
            difference="the printed figures give no number for the agreement.",
            **inputs.data_note(
                f"bands: mean of {number} laser recordings per height, plus and minus two "
                "standard deviations over the repeats."
            ),
        ),
        figure,
    )


def _column(places: Any, results: dict[str, xr.Dataset], origin: str) -> None:
    repeats, model = results["repeats"], results["model"]
    t = repeats["time"].values * 1e3
    first = float(model["impact_time"][0])
    t_model = (model["time"].values - first) * 1e3
    # A single recording has no scatter: its band is its own uncertainty.
    spread = repeats["displacement_sd"].values
    half = np.where(np.isfinite(spread), spread, repeats["u_displacement_mean"].values) * _COVERAGE
    mean = repeats["displacement_mean"].values
    look = line_arguments("measured")
    for place, factor, limits in zip(places, (1e3, 1e6), ((-_BEFORE, _AFTER), _ZOOM), strict=True):
        shown = (t >= limits[0]) & (t <= limits[1])
        place.fill_between(
            t[shown],
            (mean - half)[shown] * factor,
            (mean + half)[shown] * factor,
            color=look["color"],
            alpha=0.35,
            linewidth=0.0,
            label=f"laser, {origin}",
        )
        place.plot(t[shown], mean[shown] * factor, **(look | {"linewidth": 0.6}))
        inside = (t_model >= limits[0]) & (t_model <= limits[1])
        place.plot(
            t_model[inside], model["displacement"].values[inside] * factor, label="model", **line_arguments("model")
        )
        place.set(xlim=limits, xlabel="time $t_c$ (ms)")
    deepest = float(model["displacement"].min()) * 1e6
    places[1].set_ylim(1.3 * deepest, -0.6 * deepest)


def _agreement(height: float, results: dict[str, xr.Dataset]) -> str:
    found = results["comparison"]
    difference = float(found["restitution_difference"][0])
    u = float(found["u_restitution_difference"][0])
    return (
        f"{height * 1e3:g} mm: nRMSE {100 * float(found['nrmse']):.2f} %, first restitution {difference:+.4f} ± {u:.4f}"
    )
