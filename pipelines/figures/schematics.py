"""Figures 1.6, 1.8, 1.10: models of springs and dashpots; B.1b: the ringing plate."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from labpipe.report import line_arguments
from pipelines.figures.drawing import Drawing, panels

_LINE: dict[str, Any] = {"color": "black", "linewidth": 1.1, "linestyle": "-"}


def _spring(axes: Any, x: float, y: float, label: str) -> None:
    """Draw a spring of length 2 from (x, y) to the right."""
    zigzag = np.array([0.0, 0.4, 0.5, 0.7, 0.9, 1.1, 1.3, 1.5, 1.6, 2.0])
    height = 0.22 * np.array([0, 0, 1, -1, 1, -1, 1, -1, 0, 0])
    axes.plot(x + zigzag, y + height, **_LINE)
    axes.text(x + 1.0, y + 0.34, label, ha="center", va="bottom")


def _dashpot(axes: Any, x: float, y: float, label: str) -> None:
    """Draw a dashpot of length 2 from (x, y) to the right."""
    axes.plot([x, x + 1.1], [y, y], **_LINE)
    axes.plot([x + 1.1, x + 1.1], [y - 0.2, y + 0.2], **_LINE)
    axes.plot([x + 1.45, x + 0.65, x + 0.65], [y + 0.27, y + 0.27, y + 0.27], **_LINE)
    axes.plot([x + 1.45, x + 0.65], [y - 0.27, y - 0.27], **_LINE)
    axes.plot([x + 1.45, x + 1.45], [y - 0.27, y + 0.27], **_LINE)
    axes.plot([x + 1.45, x + 2.0], [y, y], **_LINE)
    axes.text(x + 1.05, y + 0.34, label, ha="center", va="bottom")


def _branch(axes: Any, y: float, suffix: str) -> None:
    _spring(axes, 0.0, y, f"$E{suffix}$")
    _dashpot(axes, 2.0, y, f"$\\mu{suffix}$")


def _frame(axes: Any, levels: list[float]) -> None:
    """Join the branches at both ends and draw the stress that pulls."""
    low, high = min(levels), max(levels)
    middle = (low + high) / 2
    for x, tip in ((0.0, -0.9), (4.0, 4.9)):
        axes.plot([x, x], [low, high], **_LINE)
        axes.annotate("", (tip, middle), (x, middle), arrowprops={"arrowstyle": "->"})
    axes.text(-0.95, middle, "$\\sigma$", ha="right", va="center")
    axes.text(4.95, middle, "$\\sigma$", ha="left", va="center")
    axes.set(xlim=(-1.3, 5.3), ylim=(low - 0.6, high + 0.9), aspect="equal")
    axes.axis("off")


def maxwell_element() -> Drawing:
    """Figure 1.6."""
    with panels(aspect=0.26) as (figure, grid):
        _branch(grid[0, 0], 0.0, "")
        _frame(grid[0, 0], [0.0])
    return _drawn("Maxwell element: spring E and dashpot mu in series, tau = mu/E.", figure)


def standard_linear_solid() -> Drawing:
    """Figure 1.8."""
    with panels(aspect=0.45) as (figure, grid):
        axes = grid[0, 0]
        _equilibrium(axes, 1.1)
        _branch(axes, 0.0, "_1")
        _frame(axes, [0.0, 1.1])
    return _drawn("Standard linear solid: spring E_0 in parallel with a Maxwell element E_1, mu_1.", figure)


def generalised_maxwell() -> Drawing:
    """Figure 1.10."""
    with panels(aspect=0.85) as (figure, grid):
        axes = grid[0, 0]
        _equilibrium(axes, 4.4)
        for y, suffix in ((3.3, "_1"), (2.2, "_2"), (0.0, "_n")):
            _branch(axes, y, suffix)
        axes.text(2.0, 1.2, "$\\vdots$", ha="center", va="center", fontsize=12)
        _frame(axes, [0.0, 4.4])
    return _drawn(
        "Generalised Maxwell (Wiechert) model: spring E_0 and n Maxwell elements side by side, tau_j = mu_j/E_j.",
        figure,
    )


def _equilibrium(axes: Any, y: float) -> None:
    """Draw the lone spring across the whole width."""
    axes.plot([0.0, 1.0], [y, y], **_LINE)
    _spring(axes, 1.0, y, "$E_0$")
    axes.plot([3.0, 4.0], [y, y], **_LINE)


def _drawn(shows: str, figure: Figure) -> Drawing:
    words = {"computed": "a drawing; nothing is computed.", "difference": "none; the symbols are those of the text."}
    return Drawing(shows, figure, **words)


def ringing_plate() -> Drawing:
    """Figure B.1b: what a plate does after an impact, in units of its own."""
    t = np.linspace(0.0, 10.0, 1001)
    damping = 0.05
    envelope = np.exp(-damping * 2 * np.pi * t)
    motion = envelope * np.sin(2 * np.pi * np.sqrt(1 - damping**2) * t)
    with panels(aspect=0.6) as (figure, grid):
        axes = grid[0, 0]
        axes.plot(t, motion, label="plate", **line_arguments("measured"))
        for sign in (1, -1):
            axes.plot(t, sign * envelope, label="envelope", **line_arguments("reference"))
        axes.set(xlabel="time since impact $t f_0$ (1)", ylabel="displacement (1)")
        axes.legend(loc="upper right")
        handles, labels = axes.get_legend_handles_labels()
        axes.legend(handles[:2], labels[:2], loc="upper right")
    return Drawing(
        "Motion of a plate after an impact over its first amplitude, qualitatively: a decaying oscillation about "
        "its position at rest, with its envelope.",
        figure,
        computed="a damped oscillator with a damping ratio of 0.05, an illustrative value.",
        difference="the printed figure is a sketch without numbers.",
    )
