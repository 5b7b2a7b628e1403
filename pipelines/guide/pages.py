"""The guide as plain pages from the installed package: no network, nothing to build."""

import inspect
import itertools
import json
import re
import typing
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click
import msgspec
from jinja2 import Environment, PackageLoader, select_autoescape
from markdown_it import MarkdownIt

from labpipe import files
from labpipe.units import Quantity
from labpipe.workflow.fields import describe, meanings, split
from pipelines.cli import cli
from pipelines.experiments import KINDS

GUIDES = Path(files.__file__).parent / "documentation"
PICTURES = GUIDES / "pictures"
SOURCE = Path(__file__).parent / "source"
FIRST = "tutorial"
_TEMPLATES = Environment(loader=PackageLoader("pipelines.guide", "source"), autoescape=select_autoescape())  # of HTML


def texts() -> dict[str, str]:
    """Return every text of the guide as Markdown, by its name; two are references made from the code."""
    made = {path.stem: path.read_text("utf-8") for path in GUIDES.glob("*.md")}
    made["architecture"] = (GUIDES.parent / "ARCHITECTURE.md").read_text("utf-8")
    given = {"kinds": KINDS.values(), "tables": tables, "fields": fields, "commands": commands}
    return made | {name: _TEMPLATES.get_template(f"{name}.md.jinja").render(given) for name in ("settings", "commands")}


def tables(path: str, table: type[msgspec.Struct]) -> Iterator[tuple[str, type[msgspec.Struct]]]:
    """Yield a table of settings and those within it, each with its dotted place."""
    yield path, table
    for name, kind in typing.get_type_hints(table, include_extras=True).items():
        within = [kind]
        for each in within:  # grows: tables in lists and mappings
            bare, _ = split(each)
            within += typing.get_args(bare)
            if isinstance(bare, type) and issubclass(bare, msgspec.Struct):
                yield from tables(f"{path}.{name}".lstrip("."), bare)


def fields(table: type[msgspec.Struct]) -> tuple[str, list[tuple[str, ...]]]:
    """Return the text of a table, and of each field name, meaning (sentences of the text), expected value, default."""
    hints = typing.get_type_hints(table, include_extras=True)
    # the marks of a docstring become those of Markdown
    text = re.sub(r"``(.+?)``", r"`\1`", re.sub(r":\w+:`~?([^`]+)`", r"`\1`", inspect.getdoc(table) or ""))
    sentences = rest = re.split(r"(?<=[.;]) (?=[A-Z`])", " ".join(text.split()))
    rows: list[tuple[str, ...]] = []
    for field in msgspec.structs.fields(table):
        given, own = field.default, [sentence for sentence in sentences if f"`{field.name}`" in sentence]
        if given is msgspec.NODEFAULT:
            default = "required" if field.default_factory is msgspec.NODEFAULT else "none given"
        elif given is None or isinstance(given, msgspec.Struct):
            default = "not given" if given is None else "its defaults"
        else:
            default = f'`"{given}"`' if isinstance(given, Quantity) else f"`{json.dumps(given)}`"
        if field.name != "kind":
            rest = [sentence for sentence in rest if sentence not in own]
            meaning = (" ".join(own) or meanings(table).get(field.name, "")).replace("|", "\\|")
            rows.append((f"`{field.name}`", meaning, describe(hints[field.name]), default))
    return " ".join(rest), rows


def commands() -> Iterator[tuple[int, str, str]]:
    """Yield depth, path and help of every command."""
    pending = [click.Context(cli, info_name="labpipe")]
    while pending:
        context = pending.pop()
        command: Any = context.command
        if context.parent is not None:
            yield len(context.command_path.split()), context.command_path, command.get_help(context)
        for name in reversed(command.list_commands(context) if isinstance(command, click.Group) else []):
            inner = command.get_command(context, name)
            pending.append(click.Context(inner, info_name=name, parent=context, max_content_width=100))


def linked(text: str, ending: str, known: frozenset[str]) -> str:
    """Let links to other files lead to the pages of the guide, with their ending; of other files the words remain."""

    def link(found: re.Match[str]) -> str:
        words, target = found.groups()
        file, _, anchor = target.partition("#")
        page = Path(file).stem.lower()
        return f"[{words}]({page}{ending}{'#' + anchor if anchor else ''})" if page in known else words

    return re.sub(r"(?<!!)\[([^\]]+)\]\((?!https?:|#)([^)\s]+)\)", link, text)


def _render(name: str, written: dict[str, str], parts: dict[str, list[str]]) -> str:
    parser = MarkdownIt("commonmark", {"html": False}).enable("table")
    tokens = parser.parse(linked(written[name], ".html", frozenset(written) if parts else frozenset()))
    for token, inline in itertools.pairwise(tokens):
        if token.type == "heading_open":  # headings get the names that links to them use
            token.attrSet("id", re.sub(r"[^\w\- ]", "", inline.content.lower()).replace(" ", "-"))
    text = parser.renderer.render(tokens, parser.options, {})
    titles = {each: words.partition("\n")[0].lstrip("# ").replace("`", "") for each, words in written.items()}
    return _TEMPLATES.get_template("page.html").render(name=name, titles=titles, parts=parts, text=text)


def standalone(name: str) -> str:
    """Return one page of the guide without links, to lie next to the reports of a session."""
    return _render(name, {name: (GUIDES / f"{name}.md").read_text("utf-8")}, {})


def pages() -> dict[str, str]:
    """Return every page of the guide as HTML, by its name, in the order of the site; the last one holds all texts."""
    tree, written = (SOURCE / "index.md").read_text("utf-8"), texts()
    parts = {part: names.split() for part, names in re.findall(r"^:caption: (.+)\n([^`]+)```", tree, re.MULTILINE)}
    order = [name for names in parts.values() for name in names if name in written]
    written["all"] = "# All of the guide\n\n" + "\n\n".join(written[name] for name in order)
    return {name: _render(name, written, parts) for name in (*order, "all")}
