"""Stages, and the check that those of one kind of experiment fit together.

A stage is a pure function from Datasets and files to one Dataset (or one page). It is declared
here by name; its code is imported only where it runs, so a plan needs none of it.
"""

import graphlib
import typing
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import msgspec

from labpipe.errors import InputError
from labpipe.workflow.fields import fields_of, options_of, split, suggest

FILE = "file:"
OTHER = "other:"
_IMPORTS = ("numpy", "xarray", "netCDF4", "labpipe.netcdf", "labpipe.workflow._worker")
_IMPORTS_TO_DRAW = ("jinja2", "labpipe.report._document", "labpipe.report._pictures")
"""Modules of every worker, and of those that write pages: loaded once, not once for every experiment."""


@dataclass(frozen=True, slots=True)
class Stage:
    """One step of a kind of experiment, by a name such as ``velocity`` that is unique in its kind.

    The function is called as ``function(*inputs, settings=settings)`` with the inputs in the
    declared order. A stage that runs once per experiment gets, for an input that runs once per
    recording, the list of its Datasets in the order of the files.

    Parameters
    ----------
    function : str
        ``package.module:function``, imported only when it runs.
    inputs : tuple of str
        ``"displacement"``: another stage of the same experiment. ``"file:laser"``: the file or
        files that the settings field ``laser`` names, passed as Path or list of Path; in a stage
        that runs per recording over that very field, the one Path of the recording.
        ``"other:material/master_curve"``: the result of the stage ``master_curve`` of the
        experiment that the settings field ``material`` names as ``"experiment:NAME"``; None when
        the field names none. Of stages that run per recording, the list of all results. Through
        a list of tables (``"other:drops.material_from/master_curve"``), the list of one result or
        None for every item.
    parameters : tuple of str
        Settings fields that the result depends on, dotted (``"sphere.radius"``), or ``"*"``.
    may_lack : tuple of str
        Inputs that help it but that it does without: None where they gave no result. Only the recording
        may be at fault for that; where the run was, the stage waits for it.
    per, over : {"experiment", "recording"}, str
        Whether it runs once, or once for every file of the settings field ``over``.
    schema : str, optional
        Name of the :class:`labpipe.schema.Schema` that the result must satisfy, out of those
        that the run is given; without it, units and long names are checked all the same.
    output : {"dataset", "page"}
        Whether it returns a Dataset, or the HTML text of the experiment's report.
    context : bool
        Whether the function takes the keyword ``context``, a
        :class:`labpipe.workflow.context.Context`; the result then depends on the session's title,
        operator and notes too, and a page is called even when something before it failed (an
        input that is missing for that reason is None).
    tolerant : bool
        Whether it is called like that without being a page. A result that rests on failures is handed on to
        the page of the same run and not kept.
    shortcuts : bool
        Whether the function takes the keyword ``full`` (bool) and gives a different result by it.
    imports : tuple of str
        Modules that the function imports only when it is called and that take long to load, such
        as compiled loops; the processes of a run find them loaded.
    """

    name: str
    function: str
    inputs: tuple[str, ...]
    parameters: tuple[str, ...] = ()
    may_lack: tuple[str, ...] = ()
    per: Literal["experiment", "recording"] = "experiment"
    over: str | None = None
    schema: str | None = None
    output: Literal["dataset", "page"] = "dataset"
    summary: str = ""
    context: bool = False
    tolerant: bool = False
    shortcuts: bool = False
    imports: tuple[str, ...] = ()


def ordered(stages: Sequence[Stage], settings: type[msgspec.Struct] | None = None) -> tuple[Stage, ...]:
    """Check all stages of one kind, and the fields of its settings that they name; return them inputs first.

    Raises InputError: an input or field is unknown, or the stages form a circle; every problem is listed except that a
    circle is only looked for when there is no other.
    """
    by_name = {stage.name: stage for stage in stages}
    problems = []
    for stage in stages:
        fields = [name for name in stage.parameters if name != "*"] + ([stage.over] if stage.over is not None else [])
        wrong = []
        for name in stage.inputs:
            other = by_name.get(name)
            if name.startswith(FILE):
                fields.append(name.removeprefix(FILE))
            elif name.startswith(OTHER):
                fields.append(name.removeprefix(OTHER).split("/")[0])
                wrong += [] if name.count("/") == 1 else [f'input "{name}" must read "other:FIELD/STAGE"']
            elif other is None:
                wrong.append(f'unknown input "{name}"{suggest(name, by_name)}')
            elif other.output == "page":
                wrong.append(f'input "{name}" is a page; pages are for people')
            elif stage.per == other.per == "recording" and stage.over != other.over:
                wrong.append(f'input "{name}" runs over "{other.over}", this one over "{stage.over}"')
        absent = [name for name in fields if settings is not None and not _has_field(settings, name)]
        wrong += [f'the settings have no field "{name}"' for name in absent]
        problems += [f'stage "{stage.name}": {text}' for text in wrong]
    if problems:
        raise InputError("; ".join(problems))
    own = {s.name: [name for name in s.inputs if not name.startswith((FILE, OTHER))] for s in stages}
    try:
        return tuple(by_name[name] for name in graphlib.TopologicalSorter(own).static_order())
    except graphlib.CycleError as error:
        circle = " -> ".join(error.args[1])
        raise InputError(f"the stages wait for each other in a circle: {circle}; remove one input") from None


def _has_field(kind: Any, dotted: str) -> bool:
    """Whether a dotted name leads to a field, through optional structures, unions and lists."""
    first, _, rest = dotted.partition(".")
    bare, _ = split(kind)
    if typing.get_origin(bare) is list:
        return _has_field(typing.get_args(bare)[0], dotted)
    tables = [one for one, _ in options_of(kind) if isinstance(one, type) and issubclass(one, msgspec.Struct)]
    types = [info.type for table in tables for info in fields_of(table) if info.name == first]
    return bool(types) and (not rest or _has_field(types[0], rest))


def imports_of(stages: Iterable[Stage]) -> tuple[str, ...]:
    """Modules that local processes load once for all before they run stages."""
    stages = tuple(stages)
    own = {stage.function.partition(":")[0] for stage in stages}
    own |= {name for stage in stages for name in stage.imports}
    is_drawn = any(stage.output == "page" for stage in stages)
    return (*_IMPORTS, *sorted(own), *(_IMPORTS_TO_DRAW if is_drawn else ()))
