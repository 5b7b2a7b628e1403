"""Figures 2.3 and 3.4 to 3.7: master curves, shift factors and spectrum from a rheometer."""

import json
from typing import Any

import numpy as np
import xarray as xr

from labpipe.report import line_arguments
from pipelines.figures.drawing import Drawing, legend_above, letter, panels, right_axis
from pipelines.figures.inputs import Inputs


def master_curve(inputs: Inputs, printed_T_ref: float, note: str = "", with_spectrum: bool = False) -> Drawing:
    """Draw the master curve and the shift factors of the first fitting experiment.

    The printed caption's T_ref [degC] is compared with ours, a note is a remark on the printed figure; with the
    spectrum the compliances over the retardation times are shown.
    """
    name = next(iter(inputs.experiments))
    made = inputs.result(name, "master_curve")
    is_shear = inputs.experiments[name].mode in ("shear", "torsion")
    ratios = (1.0, 1.0, 1.0) if with_spectrum else (1.5, 1.0)
    with panels(1, len(ratios), width=2, aspect=0.4, width_ratios=ratios) as (figure, axes):
        drawn = _moduli(axes[0, 0], made, inputs.origin, is_shear=is_shear, is_split=not with_spectrum)
        T, shift, u = (made[column].values for column in ("temperature", "log10_aT", "u_log10_aT"))
        axes[0, 1].errorbar(T, shift, 2.0 * u, capsize=1.5, **line_arguments("measured", style="both"))
        axes[0, 1].axvline(float(made["T_ref"]), **line_arguments("reference"))
        axes[0, 1].set(xlabel="temperature (°C)", ylabel="shift factor $\\log_{10} a_T$ (1)")
        if with_spectrum:
            _spectrum(axes[0, 2], made)
        for place, letter_ in zip(axes[0], "abc", strict=False):
            letter(place, letter_, f"$T_0$ = {float(made['T_ref']):g} °C" if letter_ == "b" else "")
        legend_above(figure, drawn)
    verdict = json.loads(made.attrs["kramers_kronig"])["verdict"]
    residual = [100 * float(np.sqrt(np.nanmean(made[f"{part}_residual"] ** 2))) for part in ("storage", "loss")]
    reference = float(made["T_ref"])
    spectrum = "; (c) creep compliances over retardation times, hollow where no sweep reaches 1/(2 pi tau)"
    return Drawing(
        f"(a) Storage and loss modulus{'' if with_spectrum else ' (right axis)'} in "
        f"{'shear' if is_shear else 'tension'}, shifted to the reference temperature {reference:g} degC, with the "
        "fitted generalised Maxwell model; (b) horizontal shift factors with two standard uncertainties, dotted: the "
        f"reference temperature{spectrum if with_spectrum else ''}.",
        figure,
        computed=(
            f"shifts and spectrum from one joint fit to both moduli; residuals {residual[0]:.2f} % (storage) and "
            f"{residual[1]:.2f} % (loss) rms over {made.sizes['temperature']} isotherms; Kramers-Kronig: {verdict}. "
            "Band: two standard uncertainties."
        ),
        difference=(
            f"printed reference temperature {printed_T_ref:g} degC, here {reference:g} degC; the printed curves are of "
            f"other specimens, so levels cannot be compared{note and f'; {note}'}."
        ),
        **inputs.data_note(f"isothermal frequency sweeps of {name}."),
    )


def _moduli(left: Any, made: xr.Dataset, origin: str, *, is_shear: bool, is_split: bool) -> list[Any]:
    """Draw both moduli in the mode that was loaded, the loss on an axis of its own if split; return the axes."""
    f = made["point_reduced_frequency"].values.ravel()
    x = made["reduced_frequency"].values
    scale = 1.0 / (2.0 * (1.0 + float(made["nu"]))) if is_shear else 1.0
    symbol = "G" if is_shear else "E"
    right = right_axis(left, "") if is_split else left
    for axes, part, role, dashes in ((left, "storage", "measured", "'"), (right, "loss", "model", "''")):
        look = line_arguments(role)  # type: ignore[arg-type]
        points = line_arguments(role, style="points")  # type: ignore[arg-type]
        reduced = made[f"{part}_reduced"].values.ravel() * scale
        line = points | {"markersize": 2.2, "markerfacecolor": "white", "markeredgewidth": 0.5}
        axes.loglog(f, reduced, label=f"{part}, {origin}", **line)
        centre = made[f"master_{part}"].values * scale
        half = 2.0 * made[f"u_master_{part}"].values * scale
        axes.fill_between(
            x, np.maximum(centre - half, centre / 10), centre + half, color=look["color"], alpha=0.25, linewidth=0
        )
        axes.loglog(x, centre, label=f"{part}, fit", **look)
        if not is_split:
            continue
        low, high = (float(g(made[f"{part}_reduced"])) * scale for g in (np.nanmin, np.nanmax))
        # Whole decades in different halves of the two axes: neither curve hides the other.
        span = 2.0 * max(np.log10(high / low), 0.5)
        limits = (high / 10**span * 1.3, high * 1.3) if part == "storage" else (low / 1.3, low / 1.3 * 10**span)
        axes.set_ylim(limits)
        axes.set_ylabel(f"{part} modulus ${symbol}{dashes}$ (Pa)")
        axes.tick_params(axis="y", which="both", colors=look["color"], labelcolor=look["color"])
        axes.yaxis.label.set_color(look["color"])
    if not is_split:
        low, high = float(np.nanmin(made["loss_reduced"])) * scale, float(np.nanmax(made["storage_reduced"])) * scale
        left.set(ylim=(low / 3, high * 3), ylabel=f"modulus ${symbol}'$, ${symbol}''$ (Pa)")
    left.set_xlabel("frequency $a_T f$ (Hz)")
    return [left, right]


def _spectrum(axes: Any, made: xr.Dataset) -> None:
    weight, tau = made["C"].values, made["tau"].values
    shown = weight > 0
    reached = 2.0 * np.pi * made["point_reduced_frequency"].values
    inside = shown & (tau * np.nanmax(reached) >= 1.0) & (tau * np.nanmin(reached) <= 1.0)
    axes.vlines(
        tau[shown], weight[shown].min() / 3, weight[shown], color=line_arguments("repeat")["color"], linewidth=0.7
    )
    look = line_arguments("measured", style="points")
    axes.loglog(tau[inside], weight[inside], label="within the sweeps", **look)
    if (beyond := shown & ~inside).any():
        axes.loglog(tau[beyond], weight[beyond], label="extrapolated", **(look | {"markerfacecolor": "white"}))
    axes.legend(loc="upper center")
    axes.set(
        xlabel="retardation time $\\tau_k$ (s)",
        ylabel="compliance $C_k$ (1/Pa)",
        ylim=(weight[shown].min() / 3, weight.max() * 50),
    )
