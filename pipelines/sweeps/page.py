"""The page of a sweep: its parameters, a map or a curve of every output, failed points."""

from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np

from labpipe.report import (
    Block,
    Column,
    Details,
    Document,
    KeyValues,
    Notice,
    Paragraph,
    Picture,
    Section,
    Table,
    display_unit,
    figure_bytes,
    figure_style,
    value_with_uncertainty,
)
from pipelines.sweeps.grid import DRAW, Design
from pipelines.sweeps.parameters import Value
from pipelines.sweeps.run import Swept
from pipelines.sweeps.simulators import SIMULATORS

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes

_SHOWN_PROBLEMS = 20
_PANEL = 3.35  # in, the width of a journal's column
_WIDTH = 560  # px on the page, of one panel
_LABEL = 26  # characters in a line beside an axis
_BESIDE = 2  # maps in a row
_MARKS = ("o", "s", "^", "D", "v", "P", "X", "*")


def render(plan: Design, swept: Swept) -> str:
    """Return the page of what was swept as HTML text."""
    outputs = [name for name in SIMULATORS[plan.simulator].outputs if name != "solver_steps"]
    sections = [
        Section("Sweep", _summary(plan, swept)),
        *(Section(_title(swept.dataset, name), _output(swept.dataset, name)) for name in outputs),
    ]
    if swept.failed:
        sections.append(Section("Points without result", (_problems(swept.dataset),)))
    size = " × ".join(map(str, plan.shape)) or "1"
    return Document(
        title=f"Sweep of the simulator: {plan.simulator}",
        subtitle=f"{size} points over {', '.join(plan.dims) or 'nothing'}",
        badge="simulated",
        sections=sections,
    ).render()


def _title(dataset: "xr.Dataset", name: str) -> str:
    return str(dataset[name].attrs["long_name"])


def _summary(plan: Design, swept: Swept) -> tuple[Block, ...]:
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
    if swept.failed:
        text = f"{swept.failed} points have no result; run the sweep again to retry them."
        blocks.append(Notice("warning", text))
    if fixed:
        blocks.append(Details("Held fixed", blocks=(KeyValues(fixed),)))
    blocks.append(Paragraph(f"The numbers stand in {swept.path.name}, in SI units."))
    return tuple(blocks)


def _read(name: str) -> str:
    return name.replace("_", " ")


def _text(value: Value, unit: str) -> str:
    if not isinstance(value, float):
        return str(value)
    shown = display_unit([value], unit)
    return f"{value / shown.factor:.6g} {'' if shown.text == '1' else shown.text}".strip()


def _output(dataset: "xr.Dataset", name: str) -> tuple[Block, ...]:
    """One output over the swept numbers; one curve per name, further numbers held fixed."""
    values, remark = dataset[name], ""
    numbers = [d for d in values.dims if d != DRAW and values[d].dtype.kind == "f"]
    for dim in numbers[2:]:
        middle = values.sizes[dim] // 2
        remark += f" {_read(str(dim))} = {_text(float(values[dim][middle]), values[dim].attrs['units'])}."
        values = values.isel({dim: middle})
    numbers = numbers[:2]
    names = [d for d in values.dims if d not in (*numbers, DRAW)]
    if not numbers:
        return (_table(values, [str(n) for n in names]),)
    groups = values.stack(group=names) if names else values.expand_dims("group")
    labels = [_label(groups, i, bool(names)) for i in range(groups.sizes["group"])]
    parts = [groups.isel(group=i) for i in range(groups.sizes["group"])]
    is_map = len(numbers) == 2
    picture = (_maps if is_map else _curves)(parts, labels, [str(n) for n in numbers])
    spread = " Bands: ± 1 standard deviation of the draws." if DRAW in values.dims else ""
    mean = " Mean of the draws." if DRAW in values.dims and len(numbers) == 2 else ""
    alt = f"{_title(dataset, name)} over {' and '.join(_read(str(n)) for n in numbers)}"
    caption = f"{alt}.{mean or spread}{remark}"
    return (Picture(picture, alt, caption=caption, width_px=_WIDTH * min(_BESIDE, len(parts)) if is_map else _WIDTH),)


def _label(groups: "xr.DataArray", i: int, is_named: bool) -> str:
    if not is_named:
        return ""
    value = groups["group"].values[i]
    return ", ".join(map(str, value)) if isinstance(value, tuple) else str(value)


def _statistics(values: "xr.DataArray") -> "tuple[xr.DataArray, xr.DataArray | None]":
    if DRAW not in values.dims:
        return values, None
    return values.mean(DRAW), values.std(DRAW, ddof=1)


def _table(values: "xr.DataArray", names: list[str]) -> Table:
    mean, deviation = _statistics(values)
    title, unit = str(values.attrs["long_name"]), str(values.attrs["units"])
    rows: list[list[Any]] = []
    for index in np.ndindex(mean.shape):
        own = [str(mean[name].values[i]) for name, i in zip(mean.dims, index, strict=True)]
        number = float(mean.values[index])
        u = None if deviation is None else float(deviation.values[index])
        rows.append([*own, number, u])
    place = len(names)
    columns = [Column(name) for name in names]
    columns += [Column(title, unit, u=place + 1), Column("standard deviation of the draws", unit)]
    return Table(tuple(columns), rows)


def _curves(parts: "list[xr.DataArray]", labels: list[str], numbers: list[str]) -> bytes:
    from matplotlib.figure import Figure

    (x_factor, x_text), (factor, text) = _in(parts[0][numbers[0]]), _in(*parts)
    with figure_style(columns=1):
        figure = Figure(figsize=(_PANEL, 2.3), layout="constrained")
        axes = figure.add_subplot()
        for i, (part, label) in enumerate(zip(parts, labels, strict=True)):
            mean, deviation = _statistics(part / factor)
            x = mean[numbers[0]].values / x_factor
            line = axes.plot(x, mean.values, marker=_MARKS[i % len(_MARKS)], markersize=3, label=label)[0]
            if deviation is not None:
                low, high = mean - deviation, mean + deviation
                axes.fill_between(x, low.values, high.values, color=line.get_color(), alpha=0.25, linewidth=0)
        _scale(axes.set_xscale, parts[0][numbers[0]].values)
        axes.set(xlabel=x_text, ylabel=text)
        if any(labels):
            axes.legend()
        return figure_bytes(figure, "svg")


def _maps(parts: "list[xr.DataArray]", labels: list[str], numbers: list[str]) -> bytes:
    from matplotlib.figure import Figure

    factor, text = _in(*parts)
    shown = [_in(parts[0][number]) for number in numbers]
    means = [_statistics(part / factor)[0].transpose(*reversed(numbers)) for part in parts]
    finite = np.concatenate([m.values[np.isfinite(m.values)] for m in means])
    ends = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 1.0)
    columns = min(_BESIDE, len(means))
    rows = -(-len(means) // columns)
    with figure_style(columns=1):
        figure = Figure(figsize=(_PANEL * columns, 2.4 * rows), layout="constrained")
        panels: list[Axes] = []
        for i, (mean, label) in enumerate(zip(means, labels, strict=True)):
            axes = figure.add_subplot(rows, columns, i + 1)
            x, y = (mean[number].values / own for number, (own, _) in zip(numbers, shown, strict=True))
            # One colour scale for all, so that the panels can be compared.
            drawn = axes.pcolormesh(
                _edges(x), _edges(y), mean.values, vmin=ends[0], vmax=ends[1], cmap="viridis", rasterized=True
            )
            _scale(axes.set_xscale, x)
            _scale(axes.set_yscale, y)
            axes.set(title=label, xlabel=shown[0][1], ylabel=shown[1][1])
            panels.append(axes)
        figure.colorbar(drawn, ax=panels, label=text)
        return figure_bytes(figure, "png")


def _in(*parts: "xr.DataArray") -> tuple[float, str]:
    """Return the factor and the axis label of the unit in which curves are read."""
    attributes = parts[0].attrs
    values = np.concatenate([np.ravel(part.values) for part in parts])
    unit = display_unit(values[np.isfinite(values)].tolist(), attributes["units"])
    return unit.factor, fill(attributes["long_name"] + (f" / {unit.text}" if unit.text else ""), _LABEL)


def _scale(set_scale: Any, values: Any) -> None:
    if _is_geometric(values):
        set_scale("log")


def _is_geometric(values: Any) -> bool:
    """Tell whether values are spaced by equal ratios."""
    if values.size < 3 or values.min() <= 0.0:
        return False
    ratios = values[1:] / values[:-1]
    return bool(np.allclose(ratios, ratios[0], rtol=1e-3) and abs(ratios[0] - 1.0) > 1e-3)


def _edges(values: Any) -> Any:
    """Return where the cells of a map end: half way between the values, as the axis shows them."""
    if _is_geometric(values):
        return np.exp(_edges(np.log(values)))
    if values.size < 2:
        return np.array([values[0] - 0.5, values[0] + 0.5])
    middle = 0.5 * (values[1:] + values[:-1])
    return np.concatenate([[2 * values[0] - middle[0]], middle, [2 * values[-1] - middle[-1]]])


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
