"""The page of a sweep: its parameters, a chart of every output, failed points."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Literal

import numpy as np

from labpipe.report import (
    Band,
    Block,
    Column,
    Details,
    Document,
    KeyValues,
    LineChart,
    Listed,
    Notice,
    Paragraph,
    Section,
    Series,
    Table,
    display_unit,
    listed,
    value_with_uncertainty,
)
from pipelines.sweeps.grid import DRAW, Design
from pipelines.sweeps.simulators import SIMULATORS, Value

if TYPE_CHECKING:
    import xarray as xr

_SHOWN_PROBLEMS = 20
Scale = Literal["linear", "log"]


def render(plan: Design, dataset: "xr.Dataset", file: str) -> str:
    """Return the page of a sweep as HTML text; ``file``: the name of its netCDF file."""
    failed = int(np.count_nonzero(dataset["problem"].values != ""))
    outputs = [name for name in SIMULATORS[plan.simulator].outputs if name != "solver_steps"]
    sections = [
        Section("Sweep", _summary(plan, failed, file)),
        *(Section(str(dataset[name].attrs["long_name"]), tuple(_output(dataset[name]))) for name in outputs),
    ]
    if failed:
        sections.append(Section("Points without result", (_problems(dataset),)))
    size = " × ".join(map(str, plan.shape)) or "1"
    return Document(
        title=f"Sweep of the simulator: {plan.simulator}",
        subtitle=f"{size} points over {', '.join(plan.dims) or 'nothing'}",
        badge="simulated",
        sections=sections,
    ).render()


def _summary(plan: Design, failed: int, file: str) -> tuple[Block, ...]:
    known = SIMULATORS[plan.simulator].parameters
    rows = []
    for axis in plan.axes:
        ends = [_text(value, known[axis.name].unit) for value in (axis.values[0], axis.values[-1])]
        count = len(axis.values)
        span = f"{count} values, {ends[0]} to {ends[1]}" if count > 1 else ends[0]
        rows.append((_read(axis.name), span, known[axis.name].text))
    for name, values in plan.drawn.items():
        text = value_with_uncertainty(float(np.mean(values)), float(np.std(values, ddof=1)), known[name].unit)
        rows.append((_read(name), text, f"{len(values)} draws: mean and standard deviation"))
    fixed = [
        (_read(name), _text(value, known[name].unit), known[name].text)
        for name, value in plan.fixed.items()
        if name not in plan.drawn and value is not None
    ]
    blocks: list[Block] = [KeyValues(rows)] if rows else []
    if failed:
        text = f"{failed} points have no result; run the sweep again to retry them."
        blocks.append(Notice("warning", text))
    if fixed:
        blocks.append(Details("Held fixed", blocks=(KeyValues(fixed),)))
    blocks.append(Paragraph(f"The numbers are in {file}, in SI units."))
    return tuple(blocks)


def _read(name: str) -> str:
    return name.replace("_", " ")


def _text(value: Value, unit: str) -> str:
    if not isinstance(value, float):
        return str(value)
    shown = display_unit([value], unit)
    return f"{value / shown.factor:.6g} {'' if shown.text == '1' else shown.text}".strip()


def _output(values: "xr.DataArray") -> Iterator[Block]:
    """Chart an output over its first swept number; a second number makes a family of curves, others are held fixed."""
    numbers = [str(d) for d in values.dims if d != DRAW and values[d].dtype.kind == "f"]
    remarks = []
    for dim in numbers[2:]:
        middle = values.sizes[dim] // 2
        remarks.append(f"{_read(dim)} = {_text(float(values[dim][middle]), values[dim].attrs['units'])}")
        values = values.isel({dim: middle})
    names = [str(d) for d in values.dims if d not in (*numbers, DRAW)]
    mean = values.mean(DRAW) if DRAW in values.dims else values
    deviation = values.std(DRAW, ddof=1) if DRAW in values.dims else None
    title, unit = str(values.attrs["long_name"]), str(values.attrs["units"])
    if not numbers:
        points = list(np.ndindex(mean.shape))
        columns = [Listed(n, [str(mean[n].values[p[i]]) for p in points]) for i, n in enumerate(names)]
        spread = None if deviation is None else deviation.values.ravel().tolist()
        yield listed([*columns, Listed(title, mean.values.ravel().tolist(), unit, u=spread)])
        return
    shown = display_unit(mean.values[np.isfinite(mean.values)].tolist(), unit)
    along = mean[numbers[0]]
    x_shown = display_unit(along.values.tolist(), along.attrs["units"])
    x = along.values / x_shown.factor
    order, family = np.argsort(x, kind="stable"), mean[numbers[1]].values if len(numbers) > 1 else [None]
    labels = [f"{_read(n)}{f' / {s.text}' if s.text else ''}" for n, s in ((numbers[0], x_shown), (title, shown))]
    charts: dict[str, list[Series | Band]] = {}
    for group in np.ndindex(*(mean.sizes[name] for name in names)):
        own = dict(zip(names, group, strict=True))
        name = ", ".join(str(mean[n].values[i]) for n, i in own.items())
        series = charts.setdefault(name if len(numbers) > 1 else "", [])
        for place, number in enumerate(family):
            at = own | ({numbers[1]: place} if number is not None else {})
            y = mean.isel(at).values[order] / shown.factor
            level = None if number is None else place / max(len(family) - 1, 1)
            curve = (
                name or ("mean of the draws" if DRAW in values.dims else title)
                if number is None
                else _text(float(number), mean[numbers[1]].attrs["units"])
            )
            if deviation is not None and number is None:
                u = deviation.isel(at).values[order] / shown.factor
                series.append(Band(f"{name}: ± 1 sd of the draws".lstrip(": "), x[order], y - u, y + u))
            series.append(Series(curve, x[order], y, level=level))
    remarks += [f"curves: {_read(numbers[1])}"] if len(numbers) > 1 else []
    caption = "; ".join([*remarks, *(["mean of the draws"] if DRAW in values.dims else [])])
    steps = np.diff(np.log(x[order])) if x.min() > 0.0 else np.zeros(1)
    is_geometric = x.size > 2 and steps.min() > 0.0 and np.ptp(steps) < 1e-3 * steps.max()
    scale: Scale = "log" if is_geometric and x.max() > 3.0 * x.min() else "linear"
    for name, series in charts.items():
        heading = f"{title}{f', {name}' if name else ''}"
        yield LineChart(heading, labels[0], labels[1], series, x_scale=scale, caption=caption)


def _problems(dataset: "xr.Dataset") -> Table:
    problems = dataset["problem"]
    places = np.argwhere(problems.values != "")
    rows = []
    for place in places[:_SHOWN_PROBLEMS]:
        point = problems[tuple(place)]
        where = ", ".join(
            f"{d} = {point[d].item() if d in point.coords else place[i]}" for i, d in enumerate(problems.dims)
        )
        rows.append([where, str(point.item())])
    caption = f"The first {len(rows)} of {len(places)}." if len(places) > len(rows) else ""
    return Table((Column("point"), Column("reason")), rows, caption=caption)
