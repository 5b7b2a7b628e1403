"""A whole page: sections of blocks rendered as one self-contained HTML text, no larger than asked for.

Every text of a page passes through jinja2's escaping and through :func:`.clean`; data for scripts travel as JSON that
cannot end its element. The policy names the digests of the three scripts that may run, so that nothing else can, even
if a text were not escaped.
"""

import base64
import hashlib
import html
import itertools
import re
import unicodedata
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from labpipe.errors import InputError
from labpipe.report._blocks import Block, Details, Deviations, Notice, Paragraph, Picture, Section
from labpipe.report._charts import LineChart
from labpipe.report._tables import Table, clean, table_view
from labpipe.report._templates import asset, environment, fill

if TYPE_CHECKING:
    from markupsafe import Markup

_SCRIPTS, _STYLES = ("uplot.min.js", "page.js", "charts.js"), ("uplot.min.css", "page.css")
# A page above this is slow to open and refused by many mail servers.
MAX_PAGE_BYTES = 3_000_000
# More than this for one chart is finer than any screen, and slow to decode on a phone; the least keeps its whole range.
_MAX_CHART_BYTES, _MIN_CHART_BYTES = 600_000, 24_000


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
            Size that the page should keep to: the charts share what pictures and texts leave.

        Warns
        -----
        UserWarning
            Pictures and texts alone are larger than that.
        """
        from markupsafe import Markup

        from labpipe.report._packing import pack, thin
        from labpipe.report._pictures import static_picture

        charts = list(_charts(self.sections))
        thinned = [thin(chart, _MAX_CHART_BYTES) for chart in charts]
        stills = [Picture(static_picture(one), "").address for one in thinned]
        islands: list[dict[str, Any]] = [{} for _ in charts]
        page, scripts = environment().get_template("page.html"), [asset(name) for name in _SCRIPTS]
        hashes = (base64.b64encode(hashlib.sha256(script.encode()).digest()).decode() for script in scripts)
        digests = " ".join(f"'sha256-{one}'" for one in hashes)

        def written() -> str:
            parts = iter(zip(charts, thinned, stills, islands, range(1, len(charts) + 1), strict=True))
            shown = [
                {"title": s.title, "anchor": anchor, "blocks": [_shown(block, parts) for block in s.blocks]}
                for s, anchor in zip(self.sections, _anchors(self.sections), strict=True)
            ]
            return page.render(
                title=self.title,
                badge=self.badge,
                body=fill("document", page=self, sections=shown),
                policy=f"default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src {digests}; "
                "base-uri 'none'; form-action 'none'",
                styles=[Markup(asset(name)) for name in _STYLES],  # noqa: S704
                scripts=[Markup(script) for script in scripts],  # noqa: S704
            )

        room = max_bytes - len(written().encode())
        for place, allowed in enumerate(_shares(charts, room)):
            thinned[place] = thin(charts[place], allowed)
            islands[place] = clean_all(pack(thinned[place]))
        text = written()
        if (size := len(text.encode())) > max_bytes:
            warnings.warn(
                f'page "{self.title}" takes {size} bytes, more than {max_bytes}; show fewer or smaller pictures',
                UserWarning,
                stacklevel=2,
            )
        return text


def _charts(blocks: Iterable[Any]) -> Iterator[LineChart]:
    """Yield all charts in reading order, in sections and folds too."""
    for block in blocks:
        if isinstance(block, LineChart):
            yield block
        elif isinstance(block, Section | Details):
            yield from _charts(block.blocks)


def _shares(charts: "Sequence[LineChart]", room: int) -> list[int]:
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
        case LineChart():
            _, thinned, still, island, number = next(charts)
            views = [name for name, _, _ in block.views]
            alt = f"{block.title}: {block.y_label} against {block.x_label}; {', '.join(s.name for s in block.series)}"
            more = {"anchor": f"chart-{number}", "views": views, "notes": thinned.notes, "still": still}
            more |= {"alt": alt, "island": island}
        case Paragraph():
            more = {"parts": [part for part in re.split(r"\n[ \t]*\n", block.text.strip()) if part]}
        case Details():
            more = {"blocks": [_shown(inside, charts) for inside in block.blocks]}
        case Deviations():
            more = block.view()
        case Table():
            headings, rows = table_view(block)
            more = {"headings": headings, "rows": rows}
    kind = type(block).__name__
    if not isinstance(block, Block):
        raise InputError(f"a section holds blocks of the report kit, found {kind}")
    return fill("Chart" if kind.endswith("Chart") else kind, block=block, **more)


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

    added = "\n".join(fill("Notice", block=notice) for notice in notices)

    def beside(found: re.Match[str]) -> str:
        if not aside:
            return f"{found[0]}\n{added}"
        text = escape(aside) + Markup(found[1])  # noqa: S704 - out of a page of the kit, escaped there
        return f"{added}\n{fill('Notice', block=Notice('info', text, anchor))}"

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
        names = itertools.chain([stem], (f"{stem}-{count}" for count in itertools.count(2)))
        taken.append(next(name for name in names if name not in taken))
    return taken


def clean_all(data: Any) -> Any:
    """Apply :func:`clean` to every text in nested lists and dicts."""
    if isinstance(data, Mapping):
        return {key: clean_all(value) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return [clean_all(value) for value in data]
    return clean(data) if isinstance(data, str) else data


@dataclass(frozen=True, slots=True)
class Report:
    """One report; a notebook shows it in a frame of its own, where its scripts reach nothing else.

    Attributes
    ----------
    experiment : str
        Name of its experiment.
    path : Path
        The HTML file.
    """

    experiment: str
    path: Path

    @property
    def html(self) -> str:
        """The page as it was written."""
        return self.path.read_text("utf-8")

    def _repr_html_(self) -> str:
        page = html.escape(self.html, quote=True)
        name = html.escape(self.experiment, quote=True)
        return (
            f'<iframe title="{name}" sandbox="allow-scripts" srcdoc="{page}" '
            f'style="width:100%;height:640px;border:1px solid #9aa"></iframe>'
        )
