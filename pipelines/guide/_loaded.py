"""Addresses on other hosts that a page, a style or a script would load by itself."""

import re
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path

_ELSEWHERE = re.compile(r"\s*(?:(?:https?|wss?|ftp):)?//", re.IGNORECASE)
_STYLE = re.compile(r"""(?:url\(\s*["']?|@import\s+(?:url\()?\s*["'])((?:https?:)?//[^"')\s]+)""", re.IGNORECASE)
#: What fetches; an address that a script only shows, compares or names a namespace by is none.
_SCRIPT = re.compile(
    r"""(?:\b(?:fetch|import|importScripts|Request|Worker|WebSocket|EventSource|sendBeacon)\s*\(\s*"""
    r"""|\.open\(\s*["']\w+["']\s*,\s*|\bfrom\s*|\.(?:src|srcset)\s*=\s*|["'](?:src|srcset)["']\s*,\s*)"""
    r"""["'`]((?:https?:|wss?:)?//[^"'`\s]+)""",
    re.IGNORECASE,
)
_LOADING = {"src", "srcset", "poster", "data", "background", "xlink:href"}
_FOLLOWED = {"a", "area", "blockquote", "q", "ins", "del", "form"}
"""Elements whose addresses nothing loads until a person follows them."""
_SAID = {"canonical", "license", "author", "help", "next", "prev", "search", "index", "genindex"}
"""Relations of a link that tell something and load nothing."""


def loaded(path: Path) -> Iterator[str]:
    """Yield addresses on other hosts that a file would load without a person following them.

    Of a file that is no HTML, SVG, CSS or JavaScript nothing is yielded.
    """
    suffix = path.suffix.lower()
    if suffix in (".html", ".svg", ".css", ".js", ".mjs"):
        text = path.read_text("utf-8", errors="replace")
        if suffix == ".css":
            yield from _STYLE.findall(text)
        elif suffix in (".js", ".mjs"):
            yield from _SCRIPT.findall(text)
        else:
            yield from in_page(text)


def in_page(text: str) -> list[str]:
    """Return what a page would load from other hosts, its own styles and scripts included."""
    page = _Page()
    page.feed(text)
    page.close()
    return page.found


class _Page(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []
        self.within = ""

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Look at the addresses of an element."""
        self.within = tag if tag in ("style", "script") else self.within
        given = {name: value or "" for name, value in attrs}
        said = set(given.get("rel", "").lower().split())
        for name, value in given.items():
            loads = name in _LOADING or (
                name == "href" and tag not in _FOLLOWED and not (tag == "link" and said & _SAID)
            )
            addresses = value.split(",") if name == "srcset" else [value]
            self.found += [part.strip() for part in addresses if loads and _ELSEWHERE.match(part)]
            if name == "style":
                self.found += _STYLE.findall(value)
        if tag == "meta" and given.get("http-equiv", "").lower() == "refresh":
            self.found += re.findall(r"url=\s*((?:https?:)?//\S+)", given.get("content", ""), re.IGNORECASE)

    def handle_endtag(self, tag: str) -> None:
        """Leave a style or a script."""
        self.within = "" if tag == self.within else self.within

    def handle_data(self, data: str) -> None:
        """Look into a style or a script."""
        if self.within:
            self.found += (_STYLE if self.within == "style" else _SCRIPT).findall(data)
