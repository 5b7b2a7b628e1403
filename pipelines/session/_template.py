"""A session.toml without files: the tables of a kind of experiment, every value still to come."""

from __future__ import annotations

import types
import typing
from collections.abc import Iterable, Iterator
from typing import Any, Literal

import msgspec

from labpipe.errors import UsageError
from labpipe.workflow.fields import GAP, Dimension, FileMark, describe, mark, split, suggest
from pipelines.experiments import KINDS
from pipelines.experiments.shared.proposals import material_line
from pipelines.experiments.shared.settings import MaterialChoice

_RECORDS = ("calibration", "camera", "record")
"""Fields that name a calibration record."""


def template(kinds: Iterable[str]) -> tuple[list[str], list[str]]:
    """Return the sections of session.toml for some kinds, and the names of the experiments.

    Raises
    ------
    UsageError
        There is no such kind.
    """
    sections, names = [], []
    for name in dict.fromkeys(kinds):
        if name not in KINDS:
            raise UsageError(f'there is no kind of experiment "{name}"{suggest(name, KINDS)}')
        names.append(name)
        lines = [f"[experiments.{name}]", f'kind = "{name}"  # {KINDS[name].summary}']
        sections.append("\n".join([*lines, *_fields(KINDS[name].settings, f"experiments.{name}")]))
    return sections, names


def gap_for(kind: Any) -> str:
    """Return what stands for a value of a field that is still to come."""
    bare, marks = split(bare_type(kind))
    if typing.get_origin(bare) is list:
        return gap_for(typing.get_args(bare)[0])
    dimension = mark(marks, Dimension)
    unit = dimension.example.rpartition(" ")[2] if dimension is not None and dimension.si != "1" else ""
    return f"{GAP} {unit}".strip()


def bare_type(kind: Any) -> Any:
    """Leave the None of an optional field away."""
    options = [option for option in typing.get_args(kind) if option is not type(None)]
    is_union = typing.get_origin(kind) in (typing.Union, types.UnionType)
    return options[0] if is_union and len(options) == 1 else kind


def _fields(kind: type[msgspec.Struct], place: str) -> Iterator[str]:
    """Yield the lines of a structure: what must be there, then, as remarks, what may."""
    tables, further = [], []
    for info in msgspec.structs.fields(kind):
        name = info.encode_name
        bare, _ = split(bare_type(info.type))
        inner = typing.get_args(bare)[0] if typing.get_origin(bare) is list else None
        if isinstance(bare, type) and issubclass(bare, msgspec.Struct):
            tables += ["", f"[{place}.{name}]", *_fields(bare, f"{place}.{name}")] if info.required else []
        elif isinstance(inner, type) and issubclass(inner, msgspec.Struct):
            tables += ["", f"[[{place}.{name}]]", *_fields(inner, f"{place}.{name}")] if info.required else []
        elif name == "material" and issubclass(kind, MaterialChoice):
            yield material_line("")
        elif info.required and name != "kind":
            yield _line(name, info.type)
        elif name != "kind":
            further.append(f"# {name} = …  # {describe(info.type)}")
    yield from further
    yield from tables


def _line(name: str, kind: Any) -> str:
    bare, marks = split(bare_type(kind))
    gap = f"calibration/{GAP}.toml" if name in _RECORDS and mark(marks, FileMark) is not None else gap_for(kind)
    if typing.get_origin(bare) is list:
        return f'{name} = ["{gap}"]  # {describe(kind)}'
    if typing.get_origin(bare) is Literal and len(typing.get_args(bare)) == 1:
        return f"{name} = {typing.get_args(bare)[0]!r}"
    return f'{name} = "{gap}"  # {describe(kind)}'
