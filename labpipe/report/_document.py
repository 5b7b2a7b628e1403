"""A whole page: sections of blocks rendered as one self-contained HTML text, no larger than asked for."""

import re
import unicodedata
import warnings
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from labpipe.errors import InputError
from labpipe.report._blocks import (
    Block,
    Details,
    Deviations,
    Gallery,
    IndexTable,
    Notice,
    Picture,
    Section,
    data_address,
)
from labpipe.report._charts import LineChart, ScatterChart
from labpipe.report._page import assemble, clean_all, fill
from labpipe.report._tables import HeadingView, Table, table_view

if TYPE_CHECKING:
    from markupsafe import Markup

# A page above this is slow to open and refused by many mail servers.
MAX_PAGE_BYTES = 3_000_000
# More than this for one chart is finer than any screen, and slow to decode on a phone; the least keeps its whole range.
_MAX_CHART_BYTES, _MIN_CHART_BYTES = 600_000, 24_000
_QUALITIES = (90, 80, 65)
"""JPEG qualities, tried in turn; at 90 no loss is seen, at 65 edges begin to show it."""


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
            the charts share the remaining bytes.

        Warns
        -----
        UserWarning
            Pictures and texts alone are larger than that.
        """
        from labpipe.report._packing import pack, thin
        from labpipe.report._pictures import static_picture

        charts = list(_found(self.sections, (LineChart, ScatterChart)))
        thinned = [thin(chart, _MAX_CHART_BYTES) for chart in charts]
        stills = [data_address(static_picture(one)) for one in thinned]
        islands: list[dict[str, Any]] = [{} for _ in charts]

        def written(sections: Sequence[Section]) -> str:
            parts = iter(zip(charts, thinned, stills, islands, range(1, len(charts) + 1), strict=True))
            shown = [
                {"title": s.title, "anchor": anchor, "blocks": [_shown(block, parts) for block in s.blocks]}
                for s, anchor in zip(sections, _anchors(sections), strict=True)
            ]
            return assemble(self.title, fill("document", page=self, sections=shown), badge=self.badge)

        sections, least = self.sections, len(charts) * _MIN_CHART_BYTES
        room = max_bytes - len(written(sections).encode())
        if room < least:
            sections = _with_jpeg(sections, least - room)
            room = max_bytes - len(written(sections).encode())
        for place, allowed in enumerate(_shares(charts, room)):
            thinned[place] = thin(charts[place], allowed)
            islands[place] = clean_all(pack(thinned[place]))
        page = written(sections)
        if (size := len(page.encode())) > max_bytes:
            warnings.warn(
                f'page "{self.title}" takes {size} bytes, more than {max_bytes}; show fewer or smaller pictures',
                UserWarning,
                stacklevel=2,
            )
        return page


def _found(blocks: Iterable[Any], kinds: tuple[type, ...]) -> Iterator[Any]:
    """Yield all blocks of some kinds in reading order, in sections, folds and galleries too."""
    for block in blocks:
        if isinstance(block, kinds):
            yield block
        elif isinstance(block, Section | Details):
            yield from _found(block.blocks, kinds)
        elif isinstance(block, Gallery):
            yield from _found(block.frames, kinds)


def _shares(charts: "Sequence[LineChart | ScatterChart]", room: int) -> list[int]:
    """Share bytes out: a chart that needs less than an equal share leaves the rest to the others."""
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


def _shown(block: Any, charts: Iterator[Any]) -> "Markup":
    """Turn one block into HTML by its macro; charts are taken in reading order."""
    more: dict[str, Any] = {}
    match block:
        case LineChart() | ScatterChart():
            _, thinned, still, island, number = next(charts)
            views = [name for name, _, _ in getattr(block, "views", ())]
            alt = f"{block.title}: {block.y_label} against {block.x_label}; {', '.join(s.name for s in block.series)}"
            more = {"anchor": f"chart-{number}", "views": views, "notes": thinned.notes, "still": still}
            more |= {"alt": alt, "island": island}
        case Details():
            more = {"blocks": [_shown(inside, charts) for inside in block.blocks]}
        case Deviations():
            more = block.view()
        case Table():
            more = {"view": table_view(block)}
        case IndexTable():
            view = table_view(Table(tuple(block.columns), [row.metrics for row in block.rows], block.caption))
            heads = (HeadingView("Experiment", "", False), HeadingView("State", "", False), *view.headings)
            more = {"headings": heads, "rows": list(zip(block.rows, view.rows, strict=True))}
    kind = type(block).__name__
    if not isinstance(block, Block):
        raise InputError(f"a section holds blocks of the report kit, found {kind}")
    return _markup("Chart" if kind.endswith("Chart") else kind, block=block, **more)


def _markup(macro: str, **values: Any) -> "Markup":
    from markupsafe import Markup

    return Markup(fill(macro, **values))  # noqa: S704 - made by the kit's escaping templates


def amended(page: str, anchor: str, notices: Iterable[Notice], *, aside: str = "") -> str:
    """Add notices to a finished page, after the one that has an anchor.

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
    >>> changed = amended(page, "verdict", [Notice("error", "broken")], aside="By itself: ")
    >>> changed.index("broken") < changed.index("By itself: fine")
    True
    """
    from markupsafe import Markup, escape

    added = "\n".join(_markup("Notice", block=notice) for notice in notices)

    def beside(found: re.Match[str]) -> str:
        if not aside:
            return f"{found[0]}\n{added}"
        text = escape(aside) + Markup(found[1])  # noqa: S704 - out of a page of the kit, escaped there
        return f"{added}\n{_markup('Notice', block=Notice('info', text, anchor))}"

    pattern = rf'<div class="notice notice-\w+" id="{re.escape(anchor)}".*?<span class="notice-text">(.*?)</span></div>'
    return re.sub(pattern, beside, page, count=1, flags=re.DOTALL)


def _anchors(sections: Sequence[Section]) -> list[str]:
    """Name every section once, with letters, digits and hyphens only."""
    taken: list[str] = []
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
        taken.append(name)
    return taken


def _with_jpeg(sections: Sequence[Section], excess: int) -> tuple[Section, ...]:
    """Return sections with their PNG pictures as JPEG: noise is expensive in lossless formats.

    The quality is the best that saves ``excess`` bytes. Pictures that JPEG does not make smaller, and those with
    transparency, stay as they are.
    """
    pictures: list[Picture] = list(_found(sections, (Picture,)))
    made: dict[int, Picture] = {}
    for quality in _QUALITIES:
        made = {id(picture): _as_jpeg(picture, quality) for picture in pictures}
        if sum(len(p.address) - len(made[id(p)].address) for p in pictures) >= excess:
            break

    def changed(block: Any) -> Any:
        if isinstance(block, Picture):
            return made[id(block)]
        if isinstance(block, Gallery):
            return replace(block, frames=tuple(map(changed, block.frames)))
        return (
            replace(block, blocks=tuple(map(changed, block.blocks))) if isinstance(block, Section | Details) else block
        )

    return tuple(map(changed, sections))


def _as_jpeg(picture: Picture, quality: int) -> Picture:
    import cv2
    import numpy as np

    image = cv2.imdecode(np.frombuffer(picture.data, np.uint8), cv2.IMREAD_UNCHANGED)
    is_png = picture.address.startswith("data:image/png")
    if (
        not is_png
        or image is None
        or image.dtype != np.uint8
        or (image.ndim == 3 and image[..., 3:].min(initial=255) < 255)
    ):
        return picture
    # Half the colour resolution would blur a thin coloured circle.
    sampling = (cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444)
    options = [cv2.IMWRITE_JPEG_QUALITY, quality, *sampling]
    data = cv2.imencode(".jpg", image[..., :3] if image.ndim == 3 else image, options)[1].tobytes()
    return replace(picture, data=data) if len(data) < len(picture.data) else picture
