"""The charts of a ball drop: the whole train of bounces and its first impacts, linked."""

import numpy as np
import xarray as xr

from labpipe.arrays import Floats
from labpipe.report import Band, Block, LineChart, Section, Series
from pipelines.experiments.shared.pages import model_curves

_VIEWS = 3  # impacts that get a view; the thesis analyses the first three
_MARGIN = 0.3  # of a contact's duration, shown before and after it
_CONTACT = 1e-3  # s, shown where no duration was found
_MM, _UM, _MS = 1e3, 1e6, 1e3
_LABEL = "time since first contact / ms"
_SPREAD = "± 2 sd of the repeats"


def motion(repeats: xr.Dataset, model: xr.Dataset | None = None, comparison: xr.Dataset | None = None) -> Section:
    """Draw position, difference, velocity, force and contact radius over one axis of time.

    Without model or comparison the measurement stands alone.
    """
    views = impact_views(repeats)
    position = _measured("displacement", repeats, _MM)
    speed = _measured("velocity", repeats, 1.0)
    if model is not None:
        since = _since(model)
        position += model_curves(since * _MS, model["displacement"] * _MM, model["u_displacement"] * _MM)
        speed.append(_simulated("velocity", model, 1.0))
    told = []
    if repeats.sizes["repeat"] > 1:
        told.append(
            "Mean of the repeats with the band of ± 2 standard deviations. Point at the chart to show each repeat."
        )
    followed = int(np.isfinite(model["u_impact_time"]).sum()) if model is not None else 0
    until = f"The model's band is what the uncertainties of its inputs do to the path, until impact {followed}."
    told += [until] if followed else []
    caption = " ".join(told)
    labels = ("Displacement", _LABEL, "height over first contact / mm")
    charts: list[Block] = [LineChart(*labels, tuple(position), group="drop", views=views, caption=caption)]
    if model is not None and comparison is not None:
        charts.append(_difference(repeats, model, comparison, views))
    charts.append(LineChart("Velocity", _LABEL, "velocity / (m/s), upwards", tuple(speed), group="drop", views=views))
    if model is not None:
        for title, label, name, factor in (
            ("Contact force (model)", "force / N", "force", 1.0),
            ("Contact radius (model)", "contact radius / mm", "contact_radius", _MM),
        ):
            curve = (_simulated(name, model, factor),)
            charts.append(LineChart(title, _LABEL, label, curve, group="drop", views=views, height_px=220))
    return Section("Motion", tuple(charts))


def impact_views(repeats: xr.Dataset) -> tuple[tuple[str, float, float], ...]:
    """Return windows in ms that show one impact each, a little more than its contact."""
    touches = repeats["touch_time"].values[:_VIEWS]
    found = repeats["contact_duration"].values[:_VIEWS]
    durations = np.where(np.isfinite(found), found, _CONTACT)
    return tuple(
        (f"impact {i + 1}", float((t - _MARGIN * d) * _MS), float((t + (1 + _MARGIN) * d) * _MS))
        for i, (t, d) in enumerate(zip(touches, durations, strict=True))
        if np.isfinite(t)
    )


def _measured(name: str, repeats: xr.Dataset, factor: float) -> list[Series | Band]:
    """Give the mean, and behind it the band and each repeat where there are several."""
    time = repeats["time"].values * _MS
    mean = repeats[f"{name}_mean"].values * factor
    curve = Series("mean of the repeats", time, mean, role="measured")
    if repeats.sizes["repeat"] < 2:
        return [curve]
    wide = 2 * repeats[f"{name}_sd"].values * factor
    single = [
        Series(_repeat_name(repeats, i), time, repeats[name].values[i] * factor, role="repeat", on_hover=True)
        for i in range(repeats.sizes["repeat"])
    ]
    return [Band(_SPREAD, time, mean - wide, mean + wide, role="measured"), *single, curve]


def _repeat_name(repeats: xr.Dataset, i: int) -> str:
    remark = " (outlier)" if bool(repeats["is_outlier"][i]) else ""
    return f"repeat {int(repeats['repeat'][i])}{remark}"


def _simulated(name: str, model: xr.Dataset, factor: float) -> Series:
    return Series("model", _since(model) * _MS, model[name].values * factor, role="model")


def _since(model: xr.Dataset) -> Floats:
    """Return the model's time (time,) in s since its first contact."""
    return model["time"].values - float(model["impact_time"][0])


def _difference(
    repeats: xr.Dataset, model: xr.Dataset, comparison: xr.Dataset, views: tuple[tuple[str, float, float], ...]
) -> LineChart:
    """Draw measured minus model, behind it how far the repeats differ and how well the model is known."""
    time = comparison["time"].values
    difference = Series("difference", time * _MS, comparison["residual"].values * _UM, role="residual")
    known = 2 * np.interp(time, _since(model), model["u_displacement"].values) * _UM
    series: list[Series | Band] = [Band("model ± 2 u", time * _MS, -known, known, role="model"), difference]
    if repeats.sizes["repeat"] > 1:
        wide = 2 * repeats["displacement_sd"].sel(time=time).values * _UM
        series.insert(1, Band(_SPREAD, time * _MS, -wide, wide, role="repeat"))
    caption = (
        "An impact that is early or late in the model shows as a spike, as both curves are steep there; the table of "
        "bounces gives the difference in time."
    )
    labels, drawn = ("Measured minus model", _LABEL, "difference / µm"), tuple(series)
    return LineChart(*labels, drawn, group="drop", views=views, height_px=220, caption=caption)
