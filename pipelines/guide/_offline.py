"""The guide as plain pages from the installed package: no network, nothing to build.

The tutorial and the pictures were kept when the site was built; what the site has beyond these is the
reference of Python, and the reports of the gallery as whole pages.
"""

import html
import itertools
import re
from pathlib import Path

from markdown_it import MarkdownIt

from pipelines.guide import _gallery, _reference
from pipelines.guide._texts import GUIDES, PARTS, linked

FIRST = "tutorial"
_PAGE = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{title} – labpipe</title>
<link rel="icon" href="data:,">
<link rel="stylesheet" href="app.css">
</head>
<body class="guide">
<nav id="contents" aria-label="Guide">{contents}</nav>
<main><p class="to-contents"><a href="#contents">All pages of the guide</a></p>
{text}</main>
</body>
</html>
"""


def pages() -> dict[str, str]:
    """Return every page of the guide as HTML, by its name.

    Examples
    --------
    >>> sorted(pages())[:3]
    ['analyst', 'architecture', 'developer']
    """
    texts = _texts()
    titles = {name: _title(name, texts[name]) for name in texts}
    parser = MarkdownIt("commonmark", {"html": False}).enable("table")
    made = {}
    for name, text in texts.items():
        tokens = parser.parse(linked(text, lambda file: f"{n}.html" if (n := Path(file).stem.lower()) in texts else ""))
        # headings get the names that links to them use
        for token, inline in itertools.pairwise(tokens):
            if token.type == "heading_open":
                words = re.sub(r"[^\w\- ]", "", inline.content.lower())
                token.attrSet("id", words.replace(" ", "-"))
        shown = parser.renderer.render(tokens, parser.options, {})
        made[name] = _PAGE.format(title=html.escape(titles[name]), contents=_contents(titles, name), text=shown)
    return made


def _texts() -> dict[str, str]:
    written = {path.stem: path for path in sorted(GUIDES.glob("*.md"))}
    written["architecture"] = GUIDES.parent / "ARCHITECTURE.md"
    made = {"settings": _reference.settings(), "commands": _reference.commands(), "gallery": _gallery.text()}
    order = [name for part in PARTS.values() for name in part if name in written or name in made]
    return {name: made[name] if name in made else written[name].read_text("utf-8") for name in order}


def _title(name: str, text: str) -> str:
    return next((line[2:].replace("`", "").strip() for line in text.splitlines() if line.startswith("# ")), name)


def _contents(titles: dict[str, str], shown: str) -> str:
    items = []
    for part, names in PARTS.items():
        known = [name for name in names if name in titles]
        marks = {name: " aria-current=page" if name == shown else "" for name in known}
        links = (f'<li><a href="{name}.html"{marks[name]}>{html.escape(titles[name])}</a></li>' for name in known)
        items.append(f"<h2>{html.escape(part)}</h2><ul>{''.join(links)}</ul>")
    return "".join(items)
