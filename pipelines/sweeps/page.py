"""The page of a sweep: its parameters, a chart of every output, failed points."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from labpipe.report import (
    Block,
    Details,
    Document,
    KeyValues,
    LineChart,
    Listed,
    Notice,
    Paragraph,
    Section,
    Series,
    display_unit,
    listed,
    value_with_uncertainty,
)
from pipelines.sweeps.grid import DRAW, Design
from pipelines.sweeps.simulators import SIMULATORS, Value

if TYPE_CHECKING:
    import xarray as xr

_CURVES = 12  # of one chart; more cannot be told apart


def render(plan: Design, dataset: "xr.Dataset", file: str) -> str:
    """Return the page of a sweep as HTML text; ``file``: the name of its netCDF file."""
    known = SIMULATORS[plan.simulator].parameters
    rows = []
    for name, swept in plan.axes.items():
        first, last = (_text(swept[i], known[name].unit) for i in (0, -1))
        rows.append((_read(name), f"{len(swept)} values, {first} to {last}" if swept[1:] else first, known[name].text))
    for name, values in plan.drawn.items():
        text = value_with_uncertainty(float(np.mean(values)), float(np.std(values, ddof=1)), known[name].unit)
        rows.append((_read(name), text, f"{len(values)} draws: mean and standard deviation"))
    fixed = {n: v for n, v in plan.fixed.items() if n not in plan.drawn and v is not None}
    summary: list[Block] = [KeyValues(rows)] if rows else []
    if failed := [str(text) for text in dataset["problem"].values.ravel() if text]:
        text = f"{len(failed)} points have no result; run the sweep again to retry them. The first: {failed[0]}"
        summary.append(Notice("warning", text))
    shown = [(_read(name), _text(value, known[name].unit), known[name].text) for name, value in fixed.items()]
    summary += [Details("Held fixed", blocks=(KeyValues(shown),))] if shown else []
    summary.append(Paragraph(f"The numbers are in {file}, in SI units."))
    outputs = [dataset[name] for name in SIMULATORS[plan.simulator].outputs if name != "solver_steps"]
    sections = [Section(str(values.attrs["long_name"]), tuple(_output(values))) for values in outputs]
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


def _output(values: "xr.DataArray") -> Iterator[Block]:
    """Chart an output, the mean of its draws, over its first swept number: a curve for each of the other points."""
    title, unit = str(values.attrs["long_name"]), str(values.attrs["units"])
    mean = values.mean(DRAW) if DRAW in values.dims else values
    along = next((str(d) for d in mean.dims if mean[d].dtype.kind == "f"), None)
    others = [str(d) for d in mean.dims if d != along]
    places = list(np.ndindex(*(mean.sizes[name] for name in others)))
    if along is None:
        spread = values.std(DRAW, ddof=1).values.ravel().tolist() if DRAW in values.dims else None
        columns = [Listed(n, [str(mean[n].values[p[i]]) for p in places]) for i, n in enumerate(others)]
        yield listed([*columns, Listed(title, mean.values.ravel().tolist(), unit, u=spread)])
        return
    mean, series = mean.sortby(along), list[Series]()
    shown = display_unit(mean.values[np.isfinite(mean.values)].tolist(), unit)
    x_shown = display_unit(mean[along].values.tolist(), mean[along].attrs["units"])
    x = mean[along].values / x_shown.factor
    for place in places[:: -(-len(places) // _CURVES)]:
        own = dict(zip(others, place, strict=True))
        name = ", ".join(_text(mean[n].values[i].item(), mean[n].attrs["units"].strip("1")) for n, i in own.items())
        series.append(Series(name or title, x, mean.isel(own).values / shown.factor))
    labels = [f"{_read(n)}{f' / {s.text}' if s.text else ''}" for n, s in ((along, x_shown), (title, shown))]
    remarks = [f"curves: {', '.join(map(_read, others))}"] if others else []
    remarks += [f"{len(series)} of {len(places)} shown"] if len(series) < len(places) else []
    caption = "; ".join([*remarks, *(["mean of the draws"] if DRAW in values.dims else [])])
    is_geometric = x.size > 2 and x[0] > 0.0 and np.allclose(x[1:] / x[:-1], x[1] / x[0], rtol=1e-3)
    yield LineChart(title, labels[0], labels[1], series, x_scale="log" if is_geometric else "linear", caption=caption)
