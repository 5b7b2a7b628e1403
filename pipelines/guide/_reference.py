"""What the code says of itself: settings of session.toml, commands, objects of Python."""

import ast
import importlib
import inspect
import json
import re
import types
import typing
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click
import msgspec

from labpipe import files
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


def write(source: Path) -> None:
    """Write the three references into the folder of the site's sources."""
    files.write_text(source / "settings.md", settings())
    files.write_text(source / "commands.md", commands())
    (source / "python").mkdir()
    lines = ["Python", "======", "", "Shapes, units, errors raised and sources, as ``help`` shows them.", ""]
    lines += [".. toctree::", "   :maxdepth: 1", "", *(f"   python/{face}" for face in FACES), ""]
    known: set[Any] = set()
    for face in FACES:
        files.write_text(source / "python" / f"{face}.rst", _package(face, known))
    files.write_text(source / "python.rst", "\n".join(lines))


# --- session.toml ---


def settings() -> str:
    """Return the page of all settings, as Markdown."""
    parts = [
        "# Settings of session.toml\n\nEach experiment is a table `[experiments.NAME]` with a `kind`; a field without "
        'default must be there. Quantities are texts with unit, such as `"9.525 ± 0.005 mm"`: the number after ± '
        "is one standard uncertainty.\n\n"
    ]
    for kind in KINDS.values():
        parts.append(f'## {kind.title}: `kind = "{kind.name}"`\n\n{kind.summary[:1].upper()}{kind.summary[1:]}.\n\n')
        for path, table in _tables("", kind.settings):
            heading = f"### `{path}` in {kind.title.lower()}\n\n" if path else ""
            parts.append(f"{heading}{_prose(table)}\n\n{_fields(table)}\n")
    return "".join(parts)


def _tables(path: str, table: type[msgspec.Struct]) -> Iterator[tuple[str, type[msgspec.Struct]]]:
    """Yield a table of settings and those within it, each with its dotted place."""
    yield path, table
    for name, kind in typing.get_type_hints(table, include_extras=True).items():
        for inner in _structures(kind):
            yield from _tables(f"{path}.{name}".lstrip("."), inner)


def _structures(kind: Any) -> list[type[msgspec.Struct]]:
    bare, _ = split(kind)
    if isinstance(bare, type) and issubclass(bare, msgspec.Struct):
        return [bare]
    if typing.get_origin(bare) in (typing.Union, types.UnionType, list, tuple, dict):
        return [found for argument in typing.get_args(bare) for found in _structures(argument)]
    return []


def _fields(table: type[msgspec.Struct]) -> str:
    rows = ["| field | expects | default |", "|---|---|---|"]
    hints = typing.get_type_hints(table, include_extras=True)
    fields = [field for field in msgspec.structs.fields(table) if field.name != "kind"]
    rows += [f"| `{field.name}` | {describe(hints[field.name])} | {_default(field)} |" for field in fields]
    return "\n".join(rows) + "\n"


def _default(field: Any) -> str:
    if field.default is msgspec.NODEFAULT:
        return "required" if field.default_factory is msgspec.NODEFAULT else "none given"
    if field.default is None:
        return "not given"
    if isinstance(field.default, msgspec.Struct):
        return "its defaults"
    if isinstance(field.default, Quantity):
        return f'`"{show(field.default)}"`'
    return f"`{json.dumps(field.default)}`"


def _prose(table: type[msgspec.Struct]) -> str:
    # the marks of a docstring become those of Markdown
    return re.sub(r"``(.+?)``", r"`\1`", re.sub(r":\w+:`~?([^`]+)`", r"`\1`", inspect.getdoc(table) or ""))


# --- commands ---


def commands() -> str:
    """Return the page of all commands, as Markdown."""
    context = click.Context(cli, info_name="labpipe")
    parts = ["# Commands\n\nEvery command has `--help`; those that say so write one JSON document with `--json`.\n\n"]
    for name in COMMANDS:
        command = cli.get_command(context, name)
        if command is not None:
            parts += _command(command, name, context, 2)
    return "".join(parts)


def _command(command: click.Command, name: str, parent: click.Context, level: int) -> Iterator[str]:
    context = click.Context(command, info_name=name, parent=parent, max_content_width=100)
    yield f"{'#' * level} `{context.command_path}`\n\n```text\n{command.get_help(context)}\n```\n\n"
    if isinstance(command, click.Group):
        for inner in command.list_commands(context):
            found = command.get_command(context, inner)
            if found is not None:
                yield from _command(found, inner, context, level + 1)


# --- Python ---


def _package(face: str, known: set[Any]) -> str:
    """Return the page of a package; what the front door has shown is not shown again."""
    module = importlib.import_module(face)
    summary = (inspect.getdoc(module) or "").partition("\n\n")[0]
    lines = [face, "=" * len(face), "", f".. currentmodule:: {face}", "", summary, ""]
    for name in sorted(_given_away(module)):
        found = getattr(module, name)
        if not callable(found) or found in known:
            continue
        known.add(found)
        lines += (
            [f".. autoclass:: {name}", "   :members:", ""]
            if inspect.isclass(found)
            else [f".. autofunction:: {name}", ""]
        )
    return "\n".join(lines)


def _given_away(module: types.ModuleType) -> set[str]:
    """Return the public names of a face: what it imports as itself, or defines."""
    found: set[str] = set(vars(module).get("__all__", ()))
    body = [part for statement in ast.parse(inspect.getsource(module)).body for part in _parts(statement)]
    for part in body:
        if isinstance(part, ast.ImportFrom):
            found |= {alias.name for alias in part.names if alias.asname == alias.name}
        elif isinstance(part, ast.FunctionDef | ast.ClassDef) and not part.name.startswith("_"):
            found.add(part.name)
    return found


def _parts(statement: ast.stmt) -> list[ast.stmt]:
    return statement.body if isinstance(statement, ast.If) else [statement]
