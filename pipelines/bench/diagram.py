"""The work–precision diagram: error against run time, both logarithmic."""

import math
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from labpipe.report import figure_bytes, figure_style
from pipelines.bench.measure import OURS, THESIS, Point, Suite

#: Colours after Okabe and Ito, told apart without colour by the markers: ours, thesis, peers.
_OURS, _THESIS, _BOUND = "#0066a6", "#cc4e00", "#404040"
_PEERS = (("#00795a", "^"), ("#8a3a6b", "D"), ("#8f6400", "v"), ("#2b2b2b", "P"), ("#7f97a8", "X"))
_MARKER, _DEFAULT_MARKER = 5.0, 8.0
#: An error of exactly 0 has no place on a logarithmic axis; it is drawn this far below the least.
_ZERO_BELOW = 10.0
_LEAST = 1e-17
#: What stands along the height of a diagram.
_LABEL_CHARACTERS = 42


@dataclass(frozen=True, slots=True)
class _Look:
    label: str
    colour: str
    marker: str


def draw(suite: Suite) -> bytes:
    """Draw the diagram of a suite as SVG; points carry their number in the table, and the default is filled.

    Points without a run time or an error are left out; the table has them.
    """
    shown = [(number, p) for number, p in enumerate(suite.points, 1) if _is_drawable(p)]
    floor = _floor(shown)
    looks = _looks(suite.points)
    with figure_style(columns=2, aspect=0.5):
        figure = Figure(layout="constrained")
        axes = figure.subplots()
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.xaxis.set_minor_locator(LogLocator(subs=(2.0, 5.0)))  # more labels would cover each other
        for group, look in looks.items():
            _draw_group(axes, [(n, p) for n, p in shown if p.group == group], look, floor)
        _draw_bounds(axes, suite)
        axes.margins(0.12, 0.15)
        axes.set_xlabel(suite.time_label)
        axes.set_ylabel(textwrap.fill(suite.error_label, _LABEL_CHARACTERS))
        figure.legend(loc="outside right upper")
        return figure_bytes(figure, "svg")


def is_drawable(suite: Suite) -> bool:
    """Tell whether a suite has a diagram with anything in it."""
    return suite.has_diagram and any(_is_drawable(point) for point in suite.points)


def _is_drawable(point: Point) -> bool:
    return point.seconds > 0 and math.isfinite(point.error)


def _floor(shown: Sequence[tuple[int, Point]]) -> float:
    """Return where errors of exactly 0 are drawn."""
    least = min((p.error for _, p in shown if p.error > 0), default=_LEAST * _ZERO_BELOW)
    return max(least / _ZERO_BELOW, _LEAST)


def _looks(points: Sequence[Point]) -> dict[str, _Look]:
    """Give every group its marker: ours circles, the thesis's method squares, peers others."""
    found: dict[str, _Look] = {}
    peers = 0
    for group in dict.fromkeys(point.group for point in points):
        if group == OURS:
            found[group] = _Look("labpipe", _OURS, "o")
        elif group.startswith(THESIS):
            found[group] = _Look(group, _THESIS, "s")
        else:
            found[group] = _Look(group, *_PEERS[peers % len(_PEERS)])
            peers += 1
    return found


def _draw_group(axes: Axes, points: Sequence[tuple[int, Point]], look: _Look, floor: float) -> None:
    label: str | None = look.label
    for number, point in points:
        where = (point.seconds, max(point.error, floor))
        axes.plot(
            *where,
            marker=look.marker,
            linestyle="none",
            color=look.colour,
            markerfacecolor=look.colour if point.is_default else "white",
            markersize=_DEFAULT_MARKER if point.is_default else _MARKER,
            label=f"{look.label}, default" if point.is_default else label,
        )
        label = label if point.is_default else None
        offset = (5, 3)
        axes.annotate(str(number), where, xytext=offset, textcoords="offset points", fontsize=6.0)


def _draw_bounds(axes: Axes, suite: Suite) -> None:
    # every limit has its own dashes, so that several stay apart in the legend
    dashes = ((5.0, 3.0), (2.0, 2.0), (8.0, 2.0, 2.0, 2.0), (1.0, 1.5))
    for place, bound in enumerate(suite.bounds):
        style = (0.0, dashes[place % len(dashes)])
        label: str | None = bound.label
        if bound.error is not None and bound.error > 0:
            axes.axhline(bound.error, color=_BOUND, linewidth=0.9, linestyle=style, label=label)
            label = None
        if bound.seconds is not None and bound.seconds > 0:
            axes.axvline(bound.seconds, color=_BOUND, linewidth=0.9, linestyle=style, label=label)
