"""Common parts of the figures: captions, panels, legends."""

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from textwrap import fill
from typing import Any, Literal

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import StepPatch
from numpy.typing import NDArray

from labpipe.arrays import Floats
from labpipe.report import figure_style


@dataclass(frozen=True, slots=True)
class Drawing:
    """A drawn figure, or a table as text, with the notes that its caption needs.

    Attributes
    ----------
    shows : str
        Contents of the panels.
    figure : Figure or None
    measured, synthetic, computed : str
        Which curves come from where; empty is "nothing".
    difference : str
        Ours against the thesis's printed figure; by default it prints no numbers.
    table : str
        Instead of a figure.
    """

    shows: str
    figure: Figure | None = None
    measured: str = ""
    synthetic: str = ""
    computed: str = ""
    difference: str = "the thesis prints no numbers of it."
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
        """Return title, contents and origin of the data as a caption of LaTeX, with a label such as ``fig:3.10``."""
        data = self.measured or self.synthetic
        word = "Measured" if self.measured else "Synthetic"
        text = f"{title}. {self.shows}" + (f" {word}: {data}" if data else "")
        escaped = "".join(_LATEX.get(character, character) for character in text)
        # h_0 and tau_0 are symbols, names of experiments are not
        symbols = re.sub(r"\b(tau|[A-Za-z])\\_(\w+)", r"$\1_{\2}$", escaped).replace("$tau", "$\\tau")
        return f"\\caption[{title}]{{{symbols}}}\n\\label{{fig:{figure_id}}}\n"

    def data(self) -> str:
        """Return the numbers that the figure draws as csv: panel, curve, axes with units, x and y of every point."""
        tables: list[pd.DataFrame] = []
        outer: list[Any] = [] if self.figure is None else self.figure.axes
        for number, axes in enumerate(
            (panel for one in outer if one.get_label() != "<colorbar>" for panel in (one, *one.child_axes)), 1
        ):
            names = {"panel": f"{number} {axes.get_title(loc='left')}".rstrip()}
            for label, points in _curves(axes):
                names |= {
                    "curve": re.sub(r"^_(child\d+|nolegend_)?", "", str(label)),
                    "x_axis": axes.get_xlabel(),
                    "y_axis": axes.get_ylabel(),
                }
                tables.append(pd.DataFrame(names | dict(zip("xy", np.asarray(points, float).T, strict=True))))
        return pd.concat(tables).to_csv(index=False, float_format="%.9g") if tables else ""


def _curves(axes: Axes) -> Iterator[tuple[object, Any]]:
    """Yield label and points (n, 2) of everything that a panel draws from numbers, of a map its levels' outlines."""
    for line in (line for line in axes.lines if line.get_transform() == axes.transData):  # no marks across the panel
        yield line.get_label(), line.get_xydata()
    for band in axes.collections:
        levels = getattr(band, "levels", None)
        for number, path in enumerate(band.get_paths()):
            label = str(band.get_label()) if levels is None else f"from {levels[number]:g}"
            yield label, path.vertices
    for steps in axes.patches:
        if isinstance(steps, StepPatch):
            yield steps.get_label(), steps.get_path().vertices


_LATEX = {c: f"\\{c}" for c in "&%$#_{}"} | {"µ": "\\textmu{}", "°": "\\textdegree{}", "±": "$\\pm$"} | {
    "^": "\\textasciicircum{}", "~": "\\textasciitilde{}", "\\": "\\textbackslash{}", "−": "$-$", "×": "$\\times$"
}  # fmt: skip


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


def label_outside(axes: NDArray[Any], x: str, y: str = "") -> None:
    """Name the axes of all panels, in print the horizontal one below the lowest and the vertical one left of the first.

    The others keep their names for :meth:`Drawing.data`.
    """
    for (row, column), place in np.ndenumerate(axes):
        place.set_xlabel(x, visible=row == len(axes) - 1)
        if y:
            place.set_ylabel(y, visible=column == 0)


def legend_above(figure: Figure, axes: Axes | Sequence[Axes], columns: int = 4) -> None:
    """Put one legend above all panels, where it covers no data."""
    handles: dict[str, Any] = {}
    for one in axes if isinstance(axes, Sequence) else [axes]:
        for handle, label in zip(*one.get_legend_handles_labels(), strict=True):
            handles.setdefault(label, handle)
    figure.legend(list(handles.values()), list(handles), loc="outside upper center", ncols=columns, columnspacing=1.4)


def right_axis(axes: Axes, label: str, *, is_named: bool = True) -> Axes:
    """Open a vertical axis on the right of a panel; in a row of panels only the last one is named in print."""
    other = axes.twinx()
    other.set_ylabel(label, visible=is_named)
    other.tick_params(labelright=is_named)
    other.grid(visible=False)
    other.spines["right"].set_visible(True)
    return other


def decades(low: float, high: float, per_decade: int = 40) -> Floats:
    """Return points that are equally spaced on a logarithmic axis, exponents given."""
    return np.logspace(low, high, int((high - low) * per_decade) + 1)
