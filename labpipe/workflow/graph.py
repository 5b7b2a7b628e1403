"""Stages of a kind of experiment, and the tasks of a session: one for each experiment, stage and recording.

A stage is a pure function from Datasets and files to one Dataset (or one page). It is declared
here by name; its code is imported only where it runs, so a plan needs none of it.
"""

import graphlib
import typing
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import msgspec

from labpipe.errors import ConfigError, InputError
from labpipe.workflow.fields import REFERENCE, every_setting, fields_of, split, suggest, tables_of
from labpipe.workflow.session import FILE_NAME, Experiment, Session

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
        ``"displacement"``: another stage of the same experiment. ``"file:laser"``: the file or files that the settings
        field ``laser`` names, as Path or list of Path; for a stage that runs over that very field the one Path of the
        recording. ``"other:material/curve"``: the result of the stage ``curve`` of the experiment that the field
        ``material`` names, or None; of a stage that runs per recording the list of all results; through a list of
        tables (``"other:drops.material/curve"``) the list of one result or None for every item.
    parameters : tuple of str
        Settings fields that the result depends on, dotted (``"sphere.radius"``), or ``"*"``.
    may_lack : tuple of str
        Inputs that it does without: None where a recording gave no result; where the run was at fault, it waits.
    per, over : {"experiment", "recording"}, str
        Whether it runs once, or once for every file of the settings field ``over``.
    schema : str, optional
        Name of the :class:`labpipe.schema.Schema` that the result must satisfy.
    output : {"dataset", "page"}
        Whether it returns a Dataset, or the HTML text of the experiment's report.
    context : bool
        Whether the function takes the keyword ``context``, a :class:`labpipe.workflow.context.Context`. It is then
        called even when something before it failed, and a Dataset that rests on failures is handed on to the page of
        the same run and not kept.
    shortcuts : bool
        Whether the function takes the keyword ``full`` (bool) and gives a different result by it.
    imports : tuple of str
        Modules, imported by the function when it is called, that the processes of a run load once for all.
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
    shortcuts: bool = False
    imports: tuple[str, ...] = ()


Stages = Mapping[str, Sequence[Stage]]
"""The stages of every kind of experiment, by the name of the kind."""


def ordered(stages: Sequence[Stage], settings: type[msgspec.Struct]) -> tuple[Stage, ...]:
    """Check all stages of one kind, and the fields of its settings that they name; return them inputs first.

    Raises InputError with every unknown input or field, or the circle in which stages wait for each other.
    """
    by_name = {stage.name: stage for stage in stages}
    problems = []
    for stage in stages:
        fields = [name for name in (*stage.parameters, stage.over) if name not in (None, "*")]
        for name in stage.inputs:
            if name.startswith((FILE, OTHER)):
                fields.append(name.partition(":")[2].partition("/")[0])
            elif name not in by_name:
                problems.append(f'stage "{stage.name}": unknown input "{name}"{suggest(name, by_name)}')
        absent = [name for name in fields if not _has_field(settings, name)]
        problems += [f'stage "{stage.name}": the settings have no field "{name}"' for name in absent]
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
    types = [info.type for table in tables_of(kind) for info in fields_of(table) if info.name == first]
    return bool(types) and (not rest or _has_field(types[0], rest))


def imports_of(stages: Iterable[Stage]) -> tuple[str, ...]:
    """Modules that local processes load once for all before they run stages."""
    stages = tuple(stages)
    own = {name for stage in stages for name in (stage.function.partition(":")[0], *stage.imports)}
    return (*_IMPORTS, *sorted(own), *(_IMPORTS_TO_DRAW if any(stage.output == "page" for stage in stages) else ()))


# --- tasks ---------------------------------------------------------------------------------------


class TaskId(NamedTuple):
    """Which experiment, stage and (for stages that run per recording) file."""

    experiment: str
    stage: str
    recording: str | None = None

    def __str__(self) -> str:
        """``acrylic/velocity`` or ``acrylic/velocity [laser/r1.csv]``."""
        suffix = f" [{self.recording}]" if self.recording is not None else ""
        return f"{self.experiment}/{self.stage}{suffix}"

    def seen_from(self, other: "TaskId") -> str:
        """Name the stage as another task does: that of another experiment with its name."""
        return self.stage if self.experiment == other.experiment else f"{self.experiment}/{self.stage}"


@dataclass(frozen=True, slots=True)
class Argument:
    """One input of a task: a value, or a list of them; each slot is the result of a task, a file's name, or nothing."""

    name: str
    slots: tuple[TaskId | str | None, ...] = ()
    is_list: bool = False

    @property
    def tasks(self) -> tuple[TaskId, ...]:
        """Tasks whose results it takes, each once."""
        return tuple(dict.fromkeys(slot for slot in self.slots if isinstance(slot, TaskId)))

    @property
    def files(self) -> tuple[str, ...]:
        """Names of the files that it is."""
        return tuple(slot for slot in self.slots if isinstance(slot, str))

    def arranged(self, value: Callable[[TaskId | str], Any]) -> Any:
        """Arrange the values of its slots for a function: a list, one value, or None."""
        values = [None if slot is None else value(slot) for slot in self.slots]
        return values if self.is_list else next(iter(values), None)


@dataclass(frozen=True, slots=True)
class Task:
    """One call of one stage."""

    id: TaskId
    stage: Stage
    arguments: tuple[Argument, ...]

    @property
    def before(self) -> tuple[TaskId, ...]:
        """Tasks whose results it takes."""
        return tuple(task for argument in self.arguments for task in argument.tasks)

    @property
    def required(self) -> tuple[TaskId, ...]:
        """Tasks without whose results it cannot be."""
        needed = (argument for argument in self.arguments if argument.name not in self.stage.may_lack)
        return tuple(task for argument in needed for task in argument.tasks)

    @property
    def files(self) -> tuple[str, ...]:
        """Names of the files it reads."""
        return tuple(name for argument in self.arguments for name in argument.files)


def spell_out(session: Session, stages: Stages) -> dict[TaskId, Task]:
    """List the tasks of a session, each after its inputs.

    Raises InputError: the stages of a kind do not fit together; ConfigError: experiments refer to each other in a
    circle, or to a stage that is not there.
    """
    plans: dict[str, tuple[Stage, ...]] = {}
    for experiment in session.experiments.values():
        if experiment.kind not in stages:
            raise InputError(f'no stages are known for the kind "{experiment.kind}"')
        if experiment.kind not in plans:
            plans[experiment.kind] = ordered(stages[experiment.kind], type(experiment.settings))
    tasks: dict[str, list[Task]] = {name: [] for name in session.experiments}
    needs: dict[str, list[str]] = {}
    for name, experiment in session.experiments.items():
        for stage in plans[experiment.kind]:
            for recording in recordings(experiment, stage):
                inputs = arguments(session, plans, experiment, stage.inputs, stage.over, recording)
                tasks[name].append(Task(TaskId(name, stage.name, recording), stage, inputs))
        # a variant follows its base, which computes what both share
        others = ({other.experiment for task in tasks[name] for other in task.before} | {experiment.base}) - {name}
        needs[name] = [other for other in session.experiments if other in others]  # in one order in every run
    try:
        names = list(graphlib.TopologicalSorter(needs).static_order())
    except graphlib.CycleError as error:
        needed, needing = error.args[1][:2]
        experiment = session.experiments[needing]
        settings = every_setting(experiment.settings)
        place = next((place for place, value, _ in settings if value == REFERENCE + needed), "base")
        circle = f"experiments wait for each other in a circle: {' -> '.join(error.args[1])}"
        raise _mistake(experiment, place, circle) from None
    return {task.id: task for name in names for task in tasks[name]}


def _mistake(experiment: Experiment, place: str, message: str) -> ConfigError:
    """Make the error for a field of an experiment, at its line."""
    line = experiment.lines.get(place, 1)
    return ConfigError([f"{FILE_NAME}:{line}: experiments.{experiment.name}.{place}: {message}"])


def recordings(experiment: Experiment, stage: Stage) -> tuple[str | None, ...]:
    """List the files that a stage runs over, or just None when it runs once."""
    return (None,) if stage.over is None else _names(field_value(experiment.settings, stage.over))


def field_value(settings: Any, dotted: str) -> Any:
    """Follow a dotted field; None when an optional structure on the way is absent.

    Through a list of structures it leads to all their values, joined: ``drops.laser``.
    """
    found = list(ends(settings, dotted.split(".")))
    if len(found) == 1 and "[" not in found[0][0]:
        return found[0][1]
    return [part for _, value in found for part in _names(value)]


def ends(node: Any, names: Sequence[str], place: str = "") -> Iterator[tuple[str, Any]]:
    """Yield place (``drops[1].material_from``) and value of a field, in every item of the lists on the way."""
    if names and isinstance(node, list | tuple):
        for number, item in enumerate(node):
            yield from ends(item, names, f"{place}[{number}]")
    elif names:
        value = node.get(names[0]) if isinstance(node, dict) else getattr(node, names[0], None)
        yield from ends(value, names[1:], f"{place}.{names[0]}".removeprefix("."))
    else:
        yield place, node


def _names(value: Any) -> tuple[str, ...]:
    if value is None:
        return ()
    return (value,) if isinstance(value, str) else tuple(value)


def arguments(
    session: Session,
    stages: Stages,
    experiment: Experiment,
    inputs: Iterable[str],
    over: str | None = None,
    recording: str | None = None,
) -> tuple[Argument, ...]:
    """Resolve inputs of a function that runs once per experiment, or for one recording out of the field ``over``.

    Raises ConfigError where the experiment refers to one that has no such stage.
    """
    made = []
    for text in inputs:
        if text.startswith(FILE):
            field = text.removeprefix(FILE)
            is_own = recording is not None and field == over
            value = recording if is_own else field_value(experiment.settings, field)
            made.append(Argument(text, _names(value), isinstance(value, list | tuple)))
            continue
        field, _, name = text.removeprefix(OTHER).rpartition("/")
        # a stage of the same experiment, or of those that a field names
        named = list(ends(experiment.settings, field.split("."))) if field else [("", experiment.name)]
        is_list = is_through_list = not named or any("[" in place for place, _ in named)
        slots: list[TaskId | str | None] = []
        for place, other in named:
            if not isinstance(other, str):  # a table or a name is absent
                slots += [None] * is_through_list
                continue
            source = session.experiments[other.removeprefix(REFERENCE)]
            known = {s.name: s for s in stages[source.kind]}
            if name not in known:
                problem = f'"{source.name}" of kind "{source.kind}" has no stage "{name}"{suggest(name, known)}'
                raise _mistake(experiment, place, problem)
            is_each = known[name].per == "recording"
            is_own = is_each and recording is not None and not field
            each = (recording,) if is_own else recordings(source, known[name])
            slots += [TaskId(source.name, name, one) for one in each]
            is_list |= is_each and not is_own
        made.append(Argument(text, tuple(slots), is_list))
    return tuple(made)


def lineage(tasks: Mapping[TaskId, Task], *task_ids: TaskId) -> list[TaskId]:
    """List some tasks and all behind them, in the order of the session."""
    found, waiting = set(task_ids), list(task_ids)
    while waiting:
        new = [b for b in tasks[waiting.pop()].before if b not in found]
        found.update(new)
        waiting += new
    return [name for name in tasks if name in found]
