"""Common parts of the figures: captions, panels, legends."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from textwrap import fill
from typing import Any, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from labpipe.arrays import Floats
from labpipe.report import figure_style

_ABBREVIATIONS = ("nbr", "peek", "ptfe")


@dataclass(frozen=True, slots=True)
class Drawing:
    """A drawn figure, or a table as text, with what a reader must know about it.

    Attributes
    ----------
    shows : str
        What is drawn.
    figure : Figure or None
    measured, synthetic, computed : str
        Which curves come from where; empty is "nothing".
    difference : str
        Ours against what the thesis prints of this figure.
    table : str
        Instead of a figure.
    """

    shows: str
    figure: Figure | None = None
    measured: str = ""
    synthetic: str = ""
    computed: str = ""
    difference: str = ""
    table: str = ""

    def caption(self, figure_id: str, title: str) -> str:
        """Return the caption file's content."""
        rows = (
            ("Measured", self.measured),
            ("Synthetic", self.synthetic),
            ("Computed", self.computed),
            ("Against the printed text", self.difference),
        )
        paragraphs = [f"{figure_id}  {title}", self.shows]
        paragraphs += [f"{name}: {text or 'nothing.'}" for name, text in rows]
        return "\n\n".join(fill(p, 100) for p in paragraphs) + "\n"

    def latex(self, figure_id: str, title: str) -> str:
        """Return the caption as LaTeX, with a label such as ``fig:3.10``."""
        text = " ".join(self.caption(figure_id, title).split()).removeprefix(f"{figure_id} ").strip()
        escaped = "".join(_LATEX.get(character, character) for character in text)
        return f"\\caption[{title}]{{{escaped}}}\n\\label{{fig:{figure_id}}}\n"

    def data(self) -> str:
        """Return the numbers that the figure draws as csv: panel, curve, axes with units, x and y of every point."""
        rows = ["panel,curve,x_axis,y_axis,x,y"]
        for number, axes in enumerate(self.figure.axes if self.figure is not None else (), 1):
            names = [_quoted(text) for text in (axes.get_xlabel(), axes.get_ylabel())]
            curves = [(line.get_label(), line.get_xydata()) for line in axes.lines]
            curves += [(band.get_label(), path.vertices) for band in axes.collections for path in band.get_paths()]
            for label, points in curves:
                head = ",".join([str(number), _quoted(str(label).removeprefix("_")), *names])
                rows += [f"{head},{x:.9g},{y:.9g}" for x, y in np.asarray(points, float).tolist()]
        return "\n".join(rows) + "\n"


_LATEX = {c: f"\\{c}" for c in "&%$#_{}"} | {"µ": "\\textmu{}", "°": "\\textdegree{}", "±": "$\\pm$"} | {
    "^": "\\textasciicircum{}", "~": "\\textasciitilde{}", "\\": "\\textbackslash{}", "−": "$-$", "×": "$\\times$"
}  # fmt: skip


def _quoted(text: str) -> str:
    """Return a cell of csv."""
    return '"' + text.replace('"', '""') + '"'


@contextmanager
def panels(
    rows: int = 1, columns: int = 1, *, width: Literal[1, 2] = 1, aspect: float = 0.68, **options: Any
) -> Iterator[tuple[Figure, Any]]:
    """Open a figure of one or two journal columns with its panels (rows, columns), in one style.

    ``aspect`` is the height of the figure over its width; options go to ``Figure.subplots``.
    """
    with figure_style(columns=width, aspect=aspect):
        figure = Figure(layout="constrained")
        yield figure, figure.subplots(rows, columns, squeeze=False, **options)


def letter(axes: Axes, name: str, text: str = "") -> None:
    """Name a panel above its frame, where it covers no data."""
    axes.set_title(f"({name}) {text}".rstrip(), loc="left", fontsize=8.0)


def label_outside(axes: NDArray[Any], x: str, y: str | None = None) -> None:
    """Name the horizontal axis below the lowest panels only, and the vertical one left of the first."""
    for place in axes[-1]:
        place.set_xlabel(x)
    for place in axes[:, 0] if y is not None else ():
        place.set_ylabel(y)


def legend_above(figure: Figure, axes: Axes | Sequence[Axes], columns: int = 4) -> None:
    """Put one legend above all panels, where it covers no data."""
    every = list(axes) if isinstance(axes, Sequence) else [axes]
    handles: dict[str, Any] = {}
    for one in every:
        for handle, label in zip(*one.get_legend_handles_labels(), strict=True):
            handles.setdefault(label, handle)
    figure.legend(list(handles.values()), list(handles), loc="outside upper center", ncols=columns, columnspacing=1.4)


def right_axis(axes: Axes, label: str = "") -> Axes:
    """Open a vertical axis on the right of a panel."""
    other = axes.twinx()
    other.set_ylabel(label)
    other.grid(visible=False)
    other.spines["right"].set_visible(True)
    return other


def spelled(material: str) -> str:
    """Return a material's name as text spells it.

    Examples
    --------
    >>> spelled("ptfe"), spelled("nylon")
    ('PTFE', 'nylon')
    """
    return material.upper() if material in _ABBREVIATIONS else material


def decades(low: float, high: float, per_decade: int = 40) -> Floats:
    """Return points that are equally spaced on a logarithmic axis, exponents given."""
    return np.logspace(low, high, int((high - low) * per_decade) + 1)
