"""The stages of a session spelled out: one task per experiment, stage and recording."""

import graphlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from labpipe.errors import ConfigError, InputError
from labpipe.workflow import graph
from labpipe.workflow.fields import REFERENCE, suggest
from labpipe.workflow.graph import FILE, OTHER, Stage
from labpipe.workflow.session import FILE_NAME, Experiment, Session

Stages = Mapping[str, Sequence[Stage]]
"""The stages of every kind of experiment, by the name of the kind."""


class TaskId(NamedTuple):
    """Which experiment, stage and (for stages that run per recording) file."""

    experiment: str
    stage: str
    recording: str | None = None

    def __str__(self) -> str:
        """``acrylic/velocity`` or ``acrylic/velocity [laser/r1.csv]``."""
        suffix = f" [{self.recording}]" if self.recording is not None else ""
        return f"{self.experiment}/{self.stage}{suffix}"


Slot = TaskId | str | None
"""The result of a task, a file by its name, or nothing."""


@dataclass(frozen=True, slots=True)
class Argument:
    """One input of a task: a value, or a list of them; ``may_lack`` is one that may give no result."""

    name: str
    slots: tuple[Slot, ...] = ()
    is_list: bool = False
    may_lack: bool = False

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
        return tuple(task for argument in self.arguments if not argument.may_lack for task in argument.tasks)

    @property
    def files(self) -> tuple[str, ...]:
        """Names of the files it reads."""
        return tuple(name for argument in self.arguments for name in argument.files)


def stage_name(task: Task, other: TaskId) -> str:
    """Name a stage as the experiment of ``task`` does: that of another experiment with its name."""
    is_own = other.experiment == task.id.experiment
    return other.stage if is_own else f"{other.experiment}/{other.stage}"


def spell_out(session: Session, stages: Stages) -> dict[TaskId, Task]:
    """List the tasks of a session, each after its inputs.

    Raises
    ------
    InputError
        The stages of a kind do not fit together.
    ConfigError
        Experiments refer to each other in a circle, or to a stage that is not there.
    """
    plans = {}
    for experiment in session.experiments.values():
        if experiment.kind not in stages:
            raise InputError(f'no stages are known for the kind "{experiment.kind}"')
        if experiment.kind not in plans:
            plans[experiment.kind] = graph.ordered(stages[experiment.kind], type(experiment.settings))
    # a variant follows its base, which computes what both share
    needs = {
        e.name: references(e, plans[e.kind]) | ({e.base: "base"} if e.base else {})
        for e in session.experiments.values()
    }
    try:
        names = list(graphlib.TopologicalSorter(needs).static_order())
    except graphlib.CycleError as error:
        first, second = error.args[1][:2]
        where = needs[second][first]
        circle = f"experiments wait for each other in a circle: {' -> '.join(error.args[1])}"
        raise _mistake(session.experiments[second], where, circle) from None
    tasks: dict[TaskId, Task] = {}
    for name in names:
        experiment = session.experiments[name]
        for stage in plans[experiment.kind]:
            for recording in recordings(experiment, stage):
                found = (_argument(session, plans, experiment, text, recording, stage.over) for text in stage.inputs)
                own = tuple(replace(one, may_lack=one.name in stage.may_lack) for one in found)
                task_id = TaskId(name, stage.name, recording)
                tasks[task_id] = Task(task_id, stage, own)
    return tasks


def _mistake(experiment: Experiment, place: str, message: str) -> ConfigError:
    """Make the error for a field of an experiment, at its line."""
    line = experiment.lines.get(place, 1)
    return ConfigError([f"{FILE_NAME}:{line}: experiments.{experiment.name}.{place}: {message}"])


def recordings(experiment: Experiment, stage: Stage) -> tuple[str | None, ...]:
    """List the files that a stage runs over, or just None when it runs once."""
    if stage.over is None:
        return (None,)
    return _names(field_value(experiment.settings, stage.over))


def references(experiment: Experiment, stages: Iterable[Stage]) -> dict[str, str]:
    """Other experiments whose results the stages take, with the field that names each."""
    found: dict[str, str] = {}
    for stage in stages:
        for text in stage.inputs:
            if text.startswith(OTHER):
                field = text.removeprefix(OTHER).split("/")[0]
                found |= {other: place for place, other in _named(experiment, field) if other is not None}
    return found


def field_value(settings: Any, dotted: str) -> Any:
    """Follow a dotted field; None when an optional structure on the way is absent.

    Through a list of structures it leads to all their values, joined: ``drops.laser``.
    """
    found = list(_ends(settings, dotted.split(".")))
    if len(found) == 1 and "[" not in found[0][0]:
        return found[0][1]
    return [part for _, value in found for part in _names(value)]


def _ends(node: Any, names: Sequence[str], place: str = "") -> Iterator[tuple[str, Any]]:
    """Yield place (``drops[1].material_from``) and value of a field, in every item of the lists on the way."""
    if names and isinstance(node, list | tuple):
        for number, item in enumerate(node):
            yield from _ends(item, names, f"{place}[{number}]")
    elif names:
        yield from _ends(getattr(node, names[0], None), names[1:], f"{place}.{names[0]}".removeprefix("."))
    else:
        yield place, node


def _named(experiment: Experiment, field: str) -> list[tuple[str, str | None]]:
    """List the experiments that a field names, each with its place; None where a table or a name is absent."""
    ends = _ends(experiment.settings, field.split("."))
    return [(place, name.removeprefix(REFERENCE) if isinstance(name, str) else None) for place, name in ends]


def _names(value: Any) -> tuple[str, ...]:
    if value is None:
        return ()
    return (value,) if isinstance(value, str) else tuple(value)


def arguments(session: Session, stages: Stages, experiment: Experiment, inputs: Iterable[str]) -> tuple[Argument, ...]:
    """Resolve inputs, written like those of a stage, for a function that runs once per experiment.

    Raises ConfigError where the experiment refers to one that has no such stage.
    """
    return tuple(_argument(session, stages, experiment, text) for text in inputs)


def _argument(
    session: Session,
    plans: Stages,
    experiment: Experiment,
    text: str,
    recording: str | None = None,
    over: str | None = None,
) -> Argument:
    if text.startswith(FILE):
        field = text.removeprefix(FILE)
        value = recording if recording is not None and field == over else field_value(experiment.settings, field)
        return Argument(text, _names(value), is_list=isinstance(value, list | tuple))
    if not text.startswith(OTHER):
        taken = next(s for s in plans[experiment.kind] if s.name == text)
        is_same = recording is not None and taken.per == "recording"
        ids = [TaskId(experiment.name, text, r) for r in ([recording] if is_same else recordings(experiment, taken))]
        return Argument(text, tuple(ids), is_list=taken.per == "recording" and not is_same)
    field, name = text.removeprefix(OTHER).split("/")
    named = _named(experiment, field)
    is_list = is_through_list = not named or any("[" in place for place, _ in named)
    slots: list[Slot] = []
    for place, other in named:
        if other is None:
            slots += [None] * is_through_list
            continue
        source = session.experiments[other]
        known = {s.name: s for s in plans[source.kind]}
        problem = "" if name in known else f', which has no stage "{name}"{suggest(name, known)}'
        if not problem and is_through_list and known[name].per == "recording":
            problem = f', whose stage "{name}" gives one result for each recording; a list of tables takes single ones'
        if problem:
            raise _mistake(experiment, place, f'"{source.name}" is of kind "{source.kind}"{problem}')
        slots += [TaskId(other, name, r) for r in recordings(source, known[name])]
        is_list |= known[name].per == "recording"
    return Argument(text, tuple(slots), is_list)


def ancestors(tasks: Mapping[TaskId, Task], *task_ids: TaskId) -> list[TaskId]:
    """List all tasks behind some, in the order of the session."""
    found: set[TaskId] = set()
    waiting = list(task_ids)
    while waiting:
        new = [b for b in tasks[waiting.pop()].before if b not in found]
        found.update(new)
        waiting += new
    return [name for name in tasks if name in found]
