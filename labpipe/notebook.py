"""How an object shows itself: a table for a notebook, and the same as text for a terminal."""

import html
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from labpipe.files import printable


class Shown(NamedTuple):
    """A table that an object shows of itself."""

    caption: str
    titles: Sequence[str]
    rows: Sequence[Sequence[object]]


class ShownAsTable:
    """An object that shows itself as one table, both in a terminal and in a notebook."""

    __slots__ = ()

    def _shown(self) -> Shown:
        raise NotImplementedError

    def __repr__(self) -> str:
        caption, _, rows = self._shown()
        return text_table(caption, rows)

    def _repr_html_(self) -> str:
        return html_table(*self._shown())


def html_table(caption: str, titles: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Write a small table for a notebook; every text is escaped.

    Examples
    --------
    >>> html_table("a < b", ("x",), [(1,)])
    '<table><caption>a &lt; b</caption><thead><tr><th>x</th></tr></thead><tbody><tr><td>1</td>\
</tr></tbody></table>'
    """
    head = "".join(f"<th>{html.escape(title)}</th>" for title in titles)
    body = "".join("<tr>" + "".join(f"<td>{html.escape(str(cell))}</td>" for cell in row) + "</tr>" for row in rows)
    return (
        f"<table><caption>{html.escape(caption)}</caption><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"
    )


def text_table(caption: str, rows: Iterable[Sequence[object]], *, most: int | None = 30) -> str:
    """Write a caption and aligned columns, without control characters; of more than ``most`` rows the rest is counted.

    Examples
    --------
    >>> print(text_table("two files", [("a.csv", 1), ("long.csv", 2)]))
    two files
      a.csv     1
      long.csv  2
    """
    cells = [[printable(str(cell)) for cell in row] for row in rows]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    lines = ["  " + "  ".join(c.ljust(w) for c, w in zip(row, widths, strict=True)).rstrip() for row in cells[:most]]
    more = [] if most is None or len(cells) <= most else [f"  and {len(cells) - most} more"]
    return "\n".join([printable(caption), *lines, *more])
