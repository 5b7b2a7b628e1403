"""A whole page: sections of blocks rendered as one self-contained HTML text."""

import math
import re
import unicodedata
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from labpipe.errors import InputError
from labpipe.report._blocks import (
    Bars,
    Details,
    Deviations,
    Gallery,
    KeyValues,
    Link,
    Notice,
    Paragraph,
    Picture,
    Section,
)
from labpipe.report._charts import LineChart, ScatterChart
from labpipe.report._index import IndexTable, index_view
from labpipe.report._media import mime_type
from labpipe.report._page import assemble, clean_all, data_address, fill
from labpipe.report._shrinking import shrunk
from labpipe.report._tables import MINUS, Table, number, table_view

if TYPE_CHECKING:
    from markupsafe import Markup

# A page above this is slow to open and refused by many mail servers.
MAX_PAGE_BYTES = 3_000_000
# More than this for one chart is finer than any screen, and slow to decode on a phone.
_MAX_CHART_BYTES = 600_000
# Even in a crowded page a chart keeps enough for its whole range.
_MIN_CHART_BYTES = 24_000

SURE = 1.96
"""Standard uncertainties within which 95 % of the differences lie."""
_LEAST_REACH, _MOST_REACH = 4, 12  # of the scale of deviations, in standard uncertainties

_NOTICE_WORDS = {"ok": "OK", "info": "Note", "warning": "Warning", "error": "Error"}


@dataclass(frozen=True)
class Document:
    """One page.

    Attributes
    ----------
    title, subtitle : str
        Head of the page.
    badge : str
        A short remark that nobody may miss ("synthetic data").
    sections : sequence of Section
        The page from top to bottom.
    home : str
        Address of the page of the whole session, relative to this one; empty for none.

    Examples
    --------
    >>> page = Document("Drop 1", sections=(Section("Notes", (Paragraph("a < b"),)),))
    >>> "a &lt; b" in page.render()
    True
    """

    title: str
    subtitle: str = ""
    badge: str = ""
    sections: Sequence[Section] = ()
    home: str = ""

    def render(self, max_bytes: int = MAX_PAGE_BYTES) -> str:
        """Write the page; the same document gives the same text.

        Parameters
        ----------
        max_bytes : int
            Size that the page should keep to. Pictures that are too large for it become JPEG, and
            the charts share what the rest leaves over.

        Warns
        -----
        UserWarning
            Pictures and texts alone are larger than that.
        """
        charts = tuple(_charts(block for section in self.sections for block in section.blocks))
        parts = [_ChartPart(chart, f"chart-{place}") for place, chart in enumerate(charts, start=1)]
        whole, room = self, max_bytes - len(self._html(parts).encode())
        least = len(parts) * _MIN_CHART_BYTES
        if room < least:
            whole = replace(self, sections=shrunk(self.sections, least - room))
            room = max_bytes - len(whole._html(parts).encode())
        for part, allowed in zip(parts, _shares(charts, room), strict=True):
            part.fill(allowed)
        page = whole._html(parts)
        size = len(page.encode())
        if size > max_bytes:
            warnings.warn(
                f'page "{self.title}" takes {size} bytes, more than {max_bytes}; show fewer or smaller pictures',
                UserWarning,
                stacklevel=2,
            )
        return page

    def _html(self, parts: "Sequence[_ChartPart]") -> str:
        remaining = iter(parts)
        anchors = _anchors(self.sections)
        sections = [
            {"title": section.title, "anchor": anchor, "blocks": [_block(block, remaining) for block in section.blocks]}
            for section, anchor in zip(self.sections, anchors, strict=True)
        ]
        body = fill(
            "document", title=self.title, subtitle=self.subtitle, badge=self.badge, sections=sections, home=self.home
        )
        return assemble(self.title, body, badge=self.badge)


class _ChartPart:
    """What one chart contributes: its still picture, and its data once the room is known."""

    def __init__(self, chart: LineChart | ScatterChart, anchor: str) -> None:
        from labpipe.report._packing import thin
        from labpipe.report._pictures import static_picture

        self.chart = chart
        self.anchor = anchor
        thinned = thin(chart, _MAX_CHART_BYTES)
        self.still = static_picture(thinned)
        self.notes = thinned.notes
        self.island: dict[str, Any] = {}

    def fill(self, max_bytes: int) -> None:
        """Pack the chart's data into the given bytes."""
        from labpipe.report._packing import pack, thin

        thinned = thin(self.chart, max_bytes)
        self.notes = thinned.notes
        self.island = clean_all(pack(thinned))

    def html(self) -> "Markup":
        """Return the chart as HTML."""
        chart = self.chart
        names = ", ".join(series.name for series in chart.series)
        return _markup(
            "chart",
            anchor=self.anchor,
            title=chart.title,
            views=[] if isinstance(chart, ScatterChart) else [name for name, _, _ in chart.views],
            caption=chart.caption,
            notes=self.notes,
            address=data_address(self.still, mime_type(self.still)),
            alt=f"{chart.title}: {chart.y_label} against {chart.x_label}; {names}",
            island=self.island,
        )


def _charts(blocks: Iterable[Any]) -> Iterator[LineChart | ScatterChart]:
    """Yield all charts in reading order, folded ones too."""
    for block in blocks:
        if isinstance(block, LineChart | ScatterChart):
            yield block
        elif isinstance(block, Details):
            yield from _charts(block.blocks)


def _shares(charts: Sequence[LineChart | ScatterChart], room: int) -> list[int]:
    """Share bytes out: who needs less than an equal share leaves the rest to the others."""
    from labpipe.report._packing import wanted_bytes

    # Descriptions of the series and the rounding up of buckets take their part too.
    left = int(room * 0.9)
    wants = [min(wanted_bytes(chart), _MAX_CHART_BYTES) for chart in charts]
    shares = [0] * len(charts)
    for position, place in enumerate(sorted(range(len(charts)), key=wants.__getitem__)):
        equal = left // (len(charts) - position)
        shares[place] = max(min(wants[place], equal), min(_MIN_CHART_BYTES, wants[place]))
        left -= shares[place]
    return shares


def _block(block: Any, charts: Iterator[_ChartPart]) -> "Markup":
    """Turn one block into HTML; charts are taken in reading order."""
    if isinstance(block, LineChart | ScatterChart):
        return next(charts).html()
    if isinstance(block, Details):
        inner = [_block(inside, charts) for inside in block.blocks]
        return _markup("details", summary=block.summary, blocks=inner, text=block.text)
    describe = _DESCRIPTIONS.get(type(block))
    if describe is None:
        raise InputError(f"a section holds blocks of the report kit, found {type(block).__name__}")
    macro, values = describe(block)
    return _markup(macro, **values)


_Description = tuple[str, dict[str, Any]]


def _paragraph(block: Paragraph) -> _Description:
    parts = [part for part in re.split(r"\n[ \t]*\n", block.text.strip()) if part]
    return "paragraph", {"parts": parts, "copyable": block.copyable}


def _link(block: Link) -> _Description:
    return "link", {"text": block.text, "address": quote(block.href), "remark": block.remark}


def _key_values(block: KeyValues) -> _Description:
    return "key_values", {"caption": block.caption, "rows": block.rows}


def _notice(block: Notice) -> _Description:
    word = _NOTICE_WORDS[block.level]
    return "notice", {"level": block.level, "word": word, "text": block.text, "anchor": block.anchor}


def amended(page: str, anchor: str, notices: Iterable[Notice], *, aside: str = "") -> str:
    """Add notices to a finished page, beside the one that has an anchor.

    Parameters
    ----------
    page : str
    anchor : str
    notices : iterable of Notice
        They follow it.
    aside : str
        Where it is given, they come before it instead, and it becomes a remark that begins with these words.

    Examples
    --------
    >>> page = Document("A", sections=(Section("B", (Notice("ok", "fine", "verdict"),)),)).render()
    >>> told = amended(page, "verdict", [Notice("error", "broken")], aside="By itself: ")
    >>> told.index("broken") < told.index("By itself: fine")
    True
    """
    from markupsafe import Markup, escape

    added = "\n".join(_block(notice, iter(())) for notice in notices)

    def beside(found: re.Match[str]) -> str:
        if not aside:
            return f"{found[0]}\n{added}"
        text = escape(aside) + Markup(found[1])  # noqa: S704 - out of a page of the kit, escaped there
        _, values = _notice(Notice("info", "", anchor))
        return f"{added}\n{_markup('notice', **values | {'text': text})}"

    pattern = rf'<div class="notice notice-\w+" id="{re.escape(anchor)}".*?<span class="notice-text">(.*?)</span></div>'
    return re.sub(pattern, beside, page, count=1, flags=re.DOTALL)


def _picture(block: Picture) -> _Description:
    return "picture", {
        "address": data_address(block.data, mime_type(block.data)),
        "alt": block.alt,
        "caption": block.caption,
        "width_px": block.width_px,
        "at": block.at,
    }


def _gallery(block: Gallery) -> _Description:
    frames = [_picture(frame)[1] for frame in block.frames]
    return "gallery", {
        "title": block.title,
        "frames": frames,
        "start": block.start,
        "caption": block.caption,
        "group": block.group,
    }


def _deviations(block: Deviations) -> _Description:
    most = max((abs(value) for _, points in block.rows for value, _ in points), default=0.0)
    reach = float(min(max(math.ceil(most), _LEAST_REACH), _MOST_REACH))
    rows = [
        (
            name,
            [
                {
                    "place": round(50 + 50 * min(max(value / reach, -1.0), 1.0), 2),
                    "state": "beyond" if abs(value) > reach else "outside" if abs(value) > SURE else "inside",
                    "text": f"{whose}: {number(value, 2)} u",
                }
                for value, whose in points
            ],
        )
        for name, points in block.rows
    ]
    ticks = [(round(50 + 50 * v / reach, 2), f"{v:g}".replace("-", MINUS)) for v in (-reach, -SURE, 0, SURE, reach)]
    band = (round(50 - 50 * SURE / reach, 2), round(100 * SURE / reach, 2))
    return "deviations", {"title": block.title, "rows": rows, "ticks": ticks, "band": band, "caption": block.caption}


def _bars(block: Bars) -> _Description:
    per_cent = [min(share * 100.0, 100.0) for _, share, _ in block.rows]
    rows = [
        (name, f"{part:.2f}", text or f"{part:.1f} %")
        for (name, _, text), part in zip(block.rows, per_cent, strict=True)
    ]
    return "bars", {"title": block.title, "rows": rows, "caption": block.caption}


def _table(block: Table) -> _Description:
    return "table", {"table": table_view(block)}


def _index(block: IndexTable) -> _Description:
    headings, rows = index_view(block)
    for row in rows:
        picture = row.pop("picture")
        row["address"] = data_address(picture, mime_type(picture)) if picture else ""
    return "index", {"caption": block.caption, "headings": headings, "rows": rows}


_DESCRIPTIONS: dict[type, Callable[[Any], _Description]] = {
    Paragraph: _paragraph,
    Link: _link,
    KeyValues: _key_values,
    Notice: _notice,
    Picture: _picture,
    Gallery: _gallery,
    Bars: _bars,
    Deviations: _deviations,
    Table: _table,
    IndexTable: _index,
}


def _markup(macro: str, **values: Any) -> "Markup":
    from markupsafe import Markup

    return Markup(fill(macro, **values))  # noqa: S704 - made by the kit's escaping templates


def _anchors(sections: Sequence[Section]) -> list[str]:
    """Name every section once, with letters, digits and hyphens only."""
    taken: set[str] = set()
    found = []
    for section in sections:
        apart = unicodedata.normalize("NFKD", section.anchor or section.title)
        text = apart.encode("ascii", "ignore").decode().lower()
        stem = re.sub(r"[^a-z0-9]+", "-", text).strip("-") or "section"
        # "chart-1" and the like are the charts' own names.
        stem = f"section-{stem}" if stem.startswith("chart-") else stem
        name, count = stem, 1
        while name in taken:
            count += 1
            name = f"{stem}-{count}"
        taken.add(name)
        found.append(name)
    return found
