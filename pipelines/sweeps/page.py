"""The page of a sweep: its parameters, a chart of every output, failed points."""

from typing import TYPE_CHECKING

import numpy as np

from labpipe.report import Document, KeyValues, LineChart, Notice, Section, Series, display_unit, value_with_uncertainty
from pipelines.sweeps.simulators import DRAW, SIMULATORS, Design, Value

if TYPE_CHECKING:
    import xarray as xr

_CURVES = 12  # of one chart; more cannot be distinguished


def render(plan: Design, dataset: "xr.Dataset", file: str) -> str:
    """Return the page of a sweep as HTML text; ``file``: the name of its netCDF file."""
    rows: list[tuple[str, str, str]] = []
    for name, known in SIMULATORS[plan.simulator].parameters.items():
        text, remark = "", known.text
        if values := plan.axes.get(name):
            first, last = (_text(values[i], known.unit) for i in (0, -1))
            text = f"{len(values)} values, {first} to {last}" if values[1:] else first
        elif drawn := plan.drawn.get(name):
            text = value_with_uncertainty(float(np.mean(drawn)), float(np.std(drawn, ddof=1)), known.unit)
            remark = f"{len(drawn)} draws: mean and standard deviation"
        elif (value := plan.fixed[name]) is not None:
            text = _text(value, known.unit)
        rows += [(_read(name), text, remark)] if text else []
    summary: list[KeyValues | Notice] = [KeyValues(rows)]
    if failed := [str(text) for text in dataset["problem"].values.ravel() if text]:
        text = f"{len(failed)} points have no result; run the sweep again to retry them. The first: {failed[0]}"
        summary.append(Notice("warning", text))
    outputs = [dataset[name] for name in SIMULATORS[plan.simulator].outputs if name != "solver_steps"]
    rows.append(("numbers", file, "in SI units"))
    sections = [Section(str(values.attrs["long_name"]), (_output(values),)) for values in outputs]
    return Document(
        title=f"Sweep of the simulator: {plan.simulator}",
        subtitle=f"{' × '.join(map(str, plan.sizes.values())) or '1'} points over {', '.join(plan.sizes) or 'nothing'}",
        badge="simulated",
        sections=[Section("Sweep", tuple(summary)), *sections],
    ).render()


def _read(name: str) -> str:
    return name.replace("_", " ")


def _text(value: Value, unit: str) -> str:
    if not isinstance(value, float):
        return str(value)
    shown = display_unit([value], unit)
    return f"{value / shown.factor:.6g} {'' if shown.text == '1' else shown.text}".strip()


def _output(values: "xr.DataArray") -> KeyValues | LineChart:
    """Chart an output, the mean of its draws, over its first swept number: a curve for each of the other points."""
    title, unit = str(values.attrs["long_name"]), str(values.attrs["units"])
    mean = values.mean(DRAW) if DRAW in values.dims else values
    along = next((str(d) for d in mean.dims if mean[d].dtype.kind == "f"), None)
    others = [str(d) for d in mean.dims if d != along]
    places = [dict(zip(others, place, strict=True)) for place in np.ndindex(*(mean.sizes[name] for name in others))]
    if along is None:
        spread = values.std(DRAW, ddof=1) if DRAW in values.dims else 0.0 * mean
        names = [", ".join(str(mean[n].values[i]) for n, i in place.items()) or title for place in places]
        texts = [value_with_uncertainty(float(mean[p]), float(spread[p]), unit) for p in places]
        return KeyValues(list(zip(names, texts, [""] * len(texts), strict=True)))
    mean, every = mean.sortby(along), -(-len(places) // _CURVES)
    shown = display_unit(mean.values[np.isfinite(mean.values)].tolist(), unit)
    x_shown = display_unit(mean[along].values.tolist(), mean[along].attrs["units"])
    x, series = mean[along].values / x_shown.factor, list[Series]()
    for place in places[::every]:
        name = ", ".join(_text(mean[n].values[i].item(), mean[n].attrs["units"].strip("1")) for n, i in place.items())
        series.append(Series(name or title, x, mean.isel(place).values / shown.factor))
    x_label, y_label = (f"{_read(n)}{f' / {s.text}' if s.text else ''}" for n, s in ((along, x_shown), (title, shown)))
    remarks = [f"curves: {', '.join(map(_read, others))}"] if others else []
    remarks += [f"{len(series)} of {len(places)} shown"] if every > 1 else []
    remarks += ["mean of the draws"] if DRAW in values.dims else []
    is_geometric = x.size > 2 and x[0] > 0.0 and np.allclose(x[1:] / x[:-1], x[1] / x[0], rtol=1e-3)
    labels, caption = (title, x_label, y_label), "; ".join(remarks)
    return LineChart(*labels, series, x_scale="log" if is_geometric else "linear", caption=caption)
