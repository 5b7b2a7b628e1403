"""The verb identify: the materials of a session, each with its page and its file."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from labpipe import files
from labpipe.notebook import html_table
from pipelines.identify._identify import Identified, Wish, identify_materials
from pipelines.identify._page import relaxed_text, render, statements
from pipelines.identify._result import dataset, document
from pipelines.session import reopen_session

STEM = "identify_"


@dataclass(frozen=True, eq=False)
class Identification:
    """The identified materials of a session, with the page and the netCDF file of each."""

    materials: tuple[Identified, ...]
    pages: tuple[Path, ...]
    paths: tuple[Path, ...]

    def __iter__(self) -> Iterator[Identified]:
        return iter(self.materials)

    def lines(self) -> list[str]:
        """Say the main results as lines of text."""
        return [
            line
            for found, page in zip(self.materials, self.pages, strict=True)
            for line in (
                f"{found.material}: {relaxed_text(found)}",
                *(f"  {statement}" for statement in statements(found)),
                f"page: {page}",
            )
        ]

    def __repr__(self) -> str:
        return "\n".join(self.lines())

    def _repr_html_(self) -> str:
        rows = [(m.material, relaxed_text(m), " ".join(statements(m))) for m in self.materials]
        caption = f"pages: {', '.join(map(str, self.pages))}"
        return html_table(caption, ("material", "long-time modulus", "what the data say"), rows)

    def documents(self) -> list[dict[str, Any]]:
        """Return plain values of every material, for JSON."""
        return [
            document(found) | {"page": str(page), "result": str(path)}
            for found, page, path in zip(self.materials, self.pages, self.paths, strict=True)
        ]


def identify(
    folder: str | Path,
    experiments: Iterable[str] = (),
    *,
    prior: str | None = None,
    impacts: int = 6,
    jobs: int = 1,
    say: Callable[[str], None] | None = None,
) -> Identification:
    """Identify the viscoelastic materials of a session's experiments, with credible intervals.

    Drops, contact films, relaxations and harmonic indentations of one material are fitted
    together. One page and one netCDF file per material: ``FOLDER/labpipe/identify_MATERIAL``.

    Parameters
    ----------
    folder : path-like
        The session folder; missing results are computed first.
    experiments : str or iterable of str
        Only these; by default all that can identify a material.
    prior : str, optional
        ``"dma"`` for the moduli of the session's rheometer experiment, or the name of one.
    impacts : int
        Bounces of a drop that are evaluated.
    jobs : int
        Experiments processed side by side; 0 processes in this process.
    say : callable, optional
        Called with a line of text now and then.

    Returns
    -------
    Identification

    Raises
    ------
    UsageError
        An experiment is unknown, or none of them can identify a material.
    InputError
        A step before failed.

    Examples
    --------
    >>> identify("my-session", ["acrylic_5mm", "acrylic_10mm"])  # doctest: +SKIP
    """
    names = (experiments,) if isinstance(experiments, str) else tuple(experiments)
    wish = Wish(names, prior, impacts)
    found = identify_materials(folder, wish, say=say, jobs=jobs)
    session = reopen_session(folder)
    pages, paths = [], []
    for one in found:
        stem = STEM + "".join(c if c.isalnum() or c in "-_" else "_" for c in one.material.replace("°", "deg"))
        paths.append(session.folder / f"{stem}.nc")
        pages.append(session.folder / f"{stem}.html")
        files.write_dataset(paths[-1], dataset(one))
        files.write_text(pages[-1], render(session, one))
    return Identification(tuple(found), tuple(pages), tuple(paths))
