"""Blocks of a page besides tables and charts: texts, notices, pictures, budgets."""

import base64
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from statistics import NormalDist
from typing import Any, Literal, TypeAlias

from labpipe.errors import InputError
from labpipe.report._charts import LineChart
from labpipe.report._tables import MINUS, CellBlock, Column, Table, number, quantity

Level = Literal["ok", "info", "warning", "error"]
SURE = NormalDist().inv_cdf(0.975)
"""Standard uncertainties within which 95 % of the differences lie."""
_SIGNATURES = ((b"\x89PNG\r\n\x1a\n", "image/png"), (b"\xff\xd8\xff", "image/jpeg"))
_SVG_HEAD = re.compile(rb"\s*(<\?xml[^>]*\?>\s*)?(<!--.*?-->\s*|<!DOCTYPE[^>]*>\s*)*<svg[\s>]", re.DOTALL)


@dataclass(frozen=True)
class Paragraph:
    """Running text; an empty line starts a new paragraph.

    Attributes
    ----------
    text : str
        Plain text, shown unchanged; it cannot hold markup.
    copyable : bool
        Offer a button that copies the text (methods paragraphs).
    """

    text: str
    copyable: bool = False


@dataclass(frozen=True)
class Link(CellBlock):
    """A way to another page of the same folder; the cell of a table too.

    Attributes
    ----------
    text : str
        Text of the link.
    href : str
        Path relative to this page, with ``/``; in a table it may be empty: a text with a remark.
    remark : str
        A short text behind it.

    Raises
    ------
    InputError
        `href` leaves the folder of the page.
    """

    text: str
    href: str
    remark: str = ""

    def __post_init__(self) -> None:
        """Refuse addresses outside the folder of the page."""
        parts = re.split(r"[/\\]", self.href)
        if self.href and (":" in parts[0] or ".." in parts or parts[0] == ""):
            raise InputError(
                f'link "{self.text}": the page "{self.href}" must be a path inside the folder of this page, '
                "such as drop_1.html"
            )


@dataclass(frozen=True)
class KeyValues:
    """A list of names with values and a unit or remark.

    Attributes
    ----------
    rows : sequence of (name, value, unit or remark)
        Texts; see :func:`labpipe.report.value_with_uncertainty` for numbers.
    caption : str
        Subject of the list.
    """

    rows: Sequence[tuple[str, str, str]]
    caption: str = ""


@dataclass(frozen=True)
class Notice(CellBlock):
    """One message that must not be overlooked; in a table the state of a row.

    Attributes
    ----------
    level : {"ok", "info", "warning", "error"}
        How grave it is; it is written out as a word too, not only as a colour.
    text : str
        The message; line ends are kept.
    anchor : str
        Name by which :func:`labpipe.report.amended` finds it in the finished page.
    """

    level: Level
    text: str
    anchor: str = ""


@dataclass(frozen=True)
class Details:
    """Something folded away until it is asked for (raw headers, provenance); printed only where it is unfolded.

    Attributes
    ----------
    summary : str
        The line that is always visible.
    blocks : sequence of blocks
        Blocks that unfold.
    text : str
        Preformatted text that unfolds after the blocks, in a typewriter face.
    """

    summary: str
    blocks: Sequence["Block"] = ()
    text: str = ""


@dataclass(frozen=True)
class Picture(CellBlock):
    """A picture with its caption.

    Attributes
    ----------
    data : bytes
        A whole PNG, JPEG or SVG file.
    alt : str
        Description of the picture, for those who cannot see it.
    caption : str
        Text below it.
    at : float, optional
        Position of a frame of a gallery along x of the charts of the gallery's group.
    """

    data: bytes
    alt: str
    caption: str = ""
    at: float | None = None
    address: str = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Refuse bytes that are no picture."""
        mime = next((name for signature, name in _SIGNATURES if self.data.startswith(signature)), "")
        if not mime and not _SVG_HEAD.match(self.data[:4096]):
            start = f"{len(self.data)} bytes that start with {self.data[:8]!r}"
            raise InputError(f"a picture must be a PNG, JPEG or SVG file, found {start}")
        data = base64.b64encode(self.data).decode("ascii")
        object.__setattr__(self, "address", f"data:{mime or 'image/svg+xml'};base64,{data}")


@dataclass(frozen=True)
class Gallery:
    """Frames of one film under a slider; a contact sheet in print and without scripts.

    Attributes
    ----------
    title : str
        Subject of the frames.
    frames : sequence of Picture
        At least one; the caption of each names its time or frame number.
    start : int
        Which frame is shown first.
    caption : str
        Text below the frames.
    group : str
        The charts of this group mark the place of the shown frame (:attr:`Picture.at`).
    """

    title: str
    frames: Sequence[Picture]
    start: int = 0
    caption: str = ""
    group: str = ""

    def __post_init__(self) -> None:
        """Refuse an empty gallery and a start outside it."""
        if not 0 <= self.start < len(self.frames):
            raise InputError(
                f'gallery "{self.title}": start frame {self.start} of {len(self.frames)} frames; '
                "expected at least one frame and a start among them"
            )


@dataclass(frozen=True)
class Deviations:
    """Differences in units of their uncertainty, a row for each quantity (a forest plot).

    Attributes
    ----------
    title : str
        Subject of the comparison.
    rows : sequence of (name, points)
        Points as (deviation, whose); a finite number and a text that shows on hovering.
    caption : str
        Text below.
    """

    title: str
    rows: Sequence[tuple[str, Sequence[tuple[float, str]]]]
    caption: str = ""

    def view(self) -> dict[str, Any]:
        """Return places in per cent of a scale that ends at 4 to 12 standard uncertainties: ticks, band and rows."""
        most = max((abs(value) for _, points in self.rows for value, _ in points), default=0.0)
        reach = float(min(max(math.ceil(most), 4), 12))

        def place(value: float) -> float:
            return round(50 + 50 * min(max(value / reach, -1.0), 1.0), 2)

        def state(value: float) -> str:
            return "beyond" if abs(value) > reach else "outside" if abs(value) > SURE else "inside"

        rows = [
            (name, [(place(v), state(v), f"{whose}: {number(v, 2)} u") for v, whose in points])
            for name, points in self.rows
        ]
        ticks = [(place(value), f"{value:.3g}".replace("-", MINUS)) for value in (-reach, -SURE, 0.0, SURE, reach)]
        return {"rows": rows, "ticks": ticks, "band": (place(-SURE), round(100 * SURE / reach, 2))}


Block: TypeAlias = Paragraph | Link | KeyValues | Notice | Details | Picture | Gallery | Deviations | Table | LineChart


@dataclass(frozen=True)
class Section:
    """A heading with blocks below it.

    Attributes
    ----------
    title : str
        Heading, also of the page's contents.
    blocks : sequence of blocks
        Paragraph, Link, KeyValues, Notice, Details, Picture, Gallery, Table, LineChart or
        ScatterChart.
    anchor : str, optional
        Name for links (``#name``); made from the title unless given.
    """

    title: str
    blocks: Sequence[Block] = ()
    anchor: str | None = None


def budget_table(rows: Sequence[Mapping[str, Any]], caption: str, unit: str) -> tuple[Block, ...]:
    """Show the rows of a budget, with their shares of the variance, as a table; nothing without a row.

    ``rows``: as :func:`labpipe.uncertainty.budget_rows` makes them; ``unit``: SI unit of the result.
    """
    if not rows:
        return ()
    kind = [Column("kind")] * any(r["kind"] for r in rows)
    cells = [
        (
            shown_source(r["source"]),
            quantity(r["value"], r["unit"], 5) if r["value"] else "0",
            quantity(r["u"], difference_unit(r["unit"]), 2) if r["u"] else "0",
            r["sensitivity"],
            r["contribution"],
            100.0 * r["share"],
            *([r["kind"]] * len(kind)),
        )
        for r in rows
        if not 0.0 < r["share"] < 1e-8  # as good as exact
    ]
    names = map(Column, ("source", "value", "standard uncertainty"))
    contribution = Column("contribution", unit=difference_unit(unit), digits=2)
    numbers = (Column("sensitivity, SI", digits=3), contribution, Column("share of the variance", "%", digits=2))
    return (Table((*names, *numbers, *kind), cells, caption=caption, sortable=False),)


def difference_unit(unit: str) -> str:
    """Return the unit in which two values of a unit differ: kelvin for degrees Celsius."""
    return "K" if unit == "degC" else unit


def shown_source(source: str) -> str:
    """Return the name of an input for a reader: the quantity, and in brackets its owner."""
    what, _, of = source.partition(", ")  # behind it may stand the name of an experiment, as it is
    what = what.replace("_", " ")
    return f"{what} ({of})" if of else what
