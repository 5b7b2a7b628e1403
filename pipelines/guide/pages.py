"""The guide as plain pages from the installed package: no network, nothing to build."""

import html
import itertools
import re
from pathlib import Path

from markdown_it import MarkdownIt

from labpipe import files
from pipelines.guide import reference

GUIDES = Path(files.__file__).parent / "documentation"
PICTURES = GUIDES / "pictures"
FIRST = "tutorial"
PARTS = {
    "First steps": (FIRST, "page", "experimenter", "files", "analyst", "rheology", "films", "gallery"),
    "Methods and their errors": ("simulator", "limits", "evidence", "scale"),
    "Reference": ("settings", "commands", "python", "changelog"),
    "For developers": ("developer", "architecture"),
}
"""Pages in the order in which they are read; that of Python is in the site only."""
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


def texts() -> dict[str, str]:
    """Return every text of the guide as Markdown, by its name in the order of :data:`PARTS`."""
    made = {path.stem: path.read_text("utf-8") for path in GUIDES.glob("*.md")}
    made["architecture"] = (GUIDES.parent / "ARCHITECTURE.md").read_text("utf-8")
    made |= {"settings": reference.settings(), "commands": reference.commands()}
    return {name: made[name] for part in PARTS.values() for name in part if name in made}


def linked(text: str, ending: str, known: frozenset[str]) -> str:
    """Let links to other files lead to the pages of the guide, with their ending; of other files the words remain."""

    def link(found: re.Match[str]) -> str:
        words, target = found.groups()
        file, _, anchor = target.partition("#")
        page = Path(file).stem.lower()
        return f"[{words}]({page}{ending}{'#' + anchor if anchor else ''})" if page in known else words

    return re.sub(r"(?<!!)\[([^\]]+)\]\((?!https?:|#)([^)\s]+)\)", link, text)


def standalone(name: str) -> str:
    """Return one page of the guide without links, to lie beside the reports of a session."""
    text = linked((GUIDES / f"{name}.md").read_text("utf-8"), ".html", frozenset())
    shown = MarkdownIt("commonmark", {"html": False}).render(text)
    style = "body { max-width: 42rem; margin: 2rem auto; padding: 0 1rem; font: 1rem/1.5 system-ui, sans-serif }"
    return (
        f'<!doctype html>\n<html lang="en">\n<meta charset="utf-8">\n<title>{name.capitalize()} – labpipe</title>\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<style>{style}</style>\n{shown}</html>\n"
    )


def pages() -> dict[str, str]:
    """Return every page of the guide as HTML, by its name.

    Examples
    --------
    >>> sorted(pages())[:3]
    ['analyst', 'architecture', 'developer']
    """
    written = texts()
    first_lines = {name: re.search(r"^# (.+)$", text, re.MULTILINE) for name, text in written.items()}
    titles = {name: html.escape(line[1].replace("`", "") if line else name) for name, line in first_lines.items()}
    parser = MarkdownIt("commonmark", {"html": False}).enable("table")
    made = {}
    for name, text in written.items():
        tokens = parser.parse(linked(text, ".html", frozenset(written)))
        for token, inline in itertools.pairwise(tokens):
            if token.type == "heading_open":  # headings get the names that links to them use
                token.attrSet("id", re.sub(r"[^\w\- ]", "", inline.content.lower()).replace(" ", "-"))
        contents = ""
        for part, names in PARTS.items():
            marks = {other: " aria-current=page" if other == name else "" for other in names if other in titles}
            links = (f'<li><a href="{other}.html"{mark}>{titles[other]}</a></li>' for other, mark in marks.items())
            contents += f"<h2>{part}</h2><ul>{''.join(links)}</ul>"
        shown = parser.renderer.render(tokens, parser.options, {})
        made[name] = _PAGE.format(title=titles[name], contents=contents, text=shown)
    return made
