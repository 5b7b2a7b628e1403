"""References made from the code: settings of session.toml, commands, objects of Python."""

import importlib
import inspect
import json
import re
import types
import typing
from collections.abc import Iterator
from typing import Any

import click
import msgspec

from labpipe.units import Quantity
from labpipe.workflow.fields import describe, show, split
from pipelines.cli import COMMANDS, cli
from pipelines.experiments import KINDS

FACES = (
    "labpipe",
    "instruments",
    "calibration",
    "labpipe.signals",
    "labpipe.materials",
    "labpipe.contact",
    "labpipe.imaging.dic",
    "labpipe.imaging.fringes",
    "labpipe.uncertainty",
    "labpipe.judging",
)
"""Packages whose public names the reference lists."""


def settings() -> str:
    """Return the page of all settings, as Markdown."""
    parts = [
        "# Settings of session.toml\n\nEach experiment is a table `[experiments.NAME]` with a `kind`; a field without "
        'default must be there. Quantities are texts with unit, such as `"9.525 ± 0.005 mm"`: the number after ± '
        "is one standard uncertainty. `[session]` holds `title`, `operator`, `notes`, `synthetic`, `stated` "
        '(values from a workbook) and `licence` (such as `"CC-BY-4.0"`), `[[creators]]` a `name`, `orcid` and '
        "`affiliation`, for a data package.\n\n"
    ]
    for kind in KINDS.values():
        parts.append(f'## {kind.title}: `kind = "{kind.name}"`\n\n{kind.summary[:1].upper()}{kind.summary[1:]}.\n\n')
        for path, table in tables("", kind.settings):
            parts.append((f"### `{path}` in {kind.title.lower()}\n\n" if path else "") + _table(table))
    return "".join(parts)


def tables(path: str, table: type[msgspec.Struct]) -> Iterator[tuple[str, type[msgspec.Struct]]]:
    """Yield a table of settings and those within it, each with its dotted place."""
    yield path, table
    for name, kind in typing.get_type_hints(table, include_extras=True).items():
        for inner in _structures(kind):
            yield from tables(f"{path}.{name}".lstrip("."), inner)


def _structures(kind: Any) -> list[type[msgspec.Struct]]:
    bare, _ = split(kind)
    if isinstance(bare, type) and issubclass(bare, msgspec.Struct):
        return [bare]
    if typing.get_origin(bare) in (typing.Union, types.UnionType, list, tuple, dict):
        return [found for argument in typing.get_args(bare) for found in _structures(argument)]
    return []


def _table(table: type[msgspec.Struct]) -> str:
    """Return the fields of a table; the sentences of its docstring that name a field are the field's meaning."""
    hints = typing.get_type_hints(table, include_extras=True)
    # the marks of a docstring become those of Markdown
    text = re.sub(r"``(.+?)``", r"`\1`", re.sub(r":\w+:`~?([^`]+)`", r"`\1`", inspect.getdoc(table) or ""))
    sentences = re.split(r"(?<=[.;]) (?=[A-Z`])", " ".join(text.split()))
    fields = [field for field in msgspec.structs.fields(table) if field.name != "kind"]
    meant = {field.name: [s for s in sentences if f"`{field.name}`" in s] for field in fields}
    rest = [s for s in sentences if not any(s in own for own in meant.values())]
    rows = ["| field | meaning | expects | default |", "|---|---|---|---|"]
    for field in fields:
        meaning = " ".join(meant[field.name]).replace("|", "\\|")
        rows.append(f"| `{field.name}` | {meaning} | {describe(hints[field.name])} | {_default(field)} |")
    return " ".join(rest) + "\n\n" + "\n".join(rows) + "\n\n"


def _default(field: Any) -> str:
    if field.default is msgspec.NODEFAULT:
        return "required" if field.default_factory is msgspec.NODEFAULT else "none given"
    if field.default is None:
        return "not given"
    if isinstance(field.default, msgspec.Struct):
        return "its defaults"
    return f'`"{show(field.default)}"`' if isinstance(field.default, Quantity) else f"`{json.dumps(field.default)}`"


def commands() -> str:
    """Return the page of all commands, as Markdown."""
    context = click.Context(cli, info_name="labpipe")
    parts = ["# Commands\n\nEvery command has `--help`; those that say so write one JSON document with `--json`.\n\n"]
    for name in COMMANDS:
        parts += _command(cli.get_command(context, name), name, context, 2)
    return "".join(parts)


def _command(command: click.Command | None, name: str, parent: click.Context, level: int) -> Iterator[str]:
    if command is None:
        return
    context = click.Context(command, info_name=name, parent=parent, max_content_width=100)
    yield f"{'#' * level} `{context.command_path}`\n\n```text\n{command.get_help(context)}\n```\n\n"
    if isinstance(command, click.Group):
        for inner in command.list_commands(context):
            yield from _command(command.get_command(context, inner), inner, context, level + 1)


def python() -> dict[str, str]:
    """Return the pages of Python's objects as reStructuredText, by their file names.

    An object that the front door shows is not shown again by its package.
    """
    known: set[Any] = set()
    made = {}
    for face in FACES:
        module = importlib.import_module(face)
        summary = (inspect.getdoc(module) or "").partition("\n\n")[0]
        lines = [face, "=" * len(face), "", f".. currentmodule:: {face}", "", summary, ""]
        source = inspect.getsource(module)
        given = {*re.findall(r"\b(\w+) as \1\b", source), *re.findall(r"^(?:def|class) ([A-Za-z]\w*)", source, re.M)}
        for name in sorted(given | set(getattr(module, "__all__", ()))):
            found = getattr(module, name)
            if callable(found) and found not in known:
                known.add(found)
                directive = [f".. autoclass:: {name}", "   :members:"] if inspect.isclass(found) else []
                lines += [*(directive or [f".. autofunction:: {name}"]), ""]
        made[f"python/{face}.rst"] = "\n".join(lines)
    head = ["Python", "======", "", "Shapes, units, errors raised and sources, as ``help`` shows them.", ""]
    tree = [".. toctree::", "   :maxdepth: 1", "", *(f"   python/{face}" for face in FACES), ""]
    return made | {"python.rst": "\n".join([*head, *tree])}
