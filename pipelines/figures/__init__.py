"""The figures of the thesis by number: titles, inputs and drawing functions.

One explicit list, ``figures.toml``; a figure names its function as text, so that listing imports
no numerical library. :mod:`pipelines.figures.make` decides which figures to draw and writes them,
:mod:`pipelines.figures.inputs` finds the experiments of a session that a figure shows,
:mod:`pipelines.figures.drawing` holds the parts that all figures share, and one or more modules per chapter
draw. :mod:`pipelines.figures.check` compares the thesis's printed numbers with ours.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from pipelines.figures._list import FIGURES, Figure, Need

if TYPE_CHECKING:
    from pipelines.figures.make import Made, State

__all__ = ["FIGURES", "Figure", "Need", "figures"]


def figures(
    ids: str | Iterable[str] = (),
    *,
    session: str | Path | None = None,
    out: str | Path = "figures",
    data: bool = False,
    jobs: int = 1,
    progress: Callable[[State], None] | None = None,
) -> Made:
    """Draw the figures of the thesis by number: PDF, SVG, PNG and a caption each, as text and as LaTeX.

    Parameters
    ----------
    ids : str or iterable of str
        Numbers, ``"2.6"``; all by default.
    session : path-like, optional
        Session folder for the figures that show experiments; the results that they need are processed
        first. Without it only computed figures are drawn.
    out : path-like
        Folder to write into; figures that are up to date there are not drawn again.
    data : bool
        Write the numbers that each figure draws too, as ``ID-data.csv``.
    jobs : int
        Experiments processed, and figures drawn, side by side; 0 does all in this process.
    progress : callable, optional
        Called with the outcome of every figure.

    Returns
    -------
    Made
        The state of every figure, and its files.

    Raises
    ------
    UsageError
        There is no figure of that number.

    Examples
    --------
    >>> figures("2.6", out="figures")  # doctest: +SKIP
    """
    from pipelines.figures import make

    wanted = make.chosen([ids] if isinstance(ids, str) else ids)
    shelf = replace(make.Shelf.of(Path(out), None if session is None else Path(session)), with_data=data)
    show = progress or (lambda outcome: None)
    return make.Made(shelf.folder, make.make(shelf, wanted, show, jobs=jobs))
