"""The stages of a session spelled out: one task per experiment, stage and recording."""

import graphlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
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


@dataclass(frozen=True, slots=True)
class Argument:
    """One input of a task: results of other tasks, or files, or nothing."""

    name: str
    tasks: tuple[TaskId, ...] = ()
    files: tuple[str, ...] = ()
    is_list: bool = False


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
    def files(self) -> tuple[str, ...]:
        """Names of the files it reads."""
        return tuple(name for argument in self.arguments for name in argument.files)


def spell_out(session: Session, stages: Stages) -> dict[TaskId, Task]:
    """List the tasks of a session, inputs before what takes them.

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
            message = f'no stages are known for the kind "{experiment.kind}"'
            raise InputError(message)
        if experiment.kind not in plans:
            plans[experiment.kind] = graph.ordered(stages[experiment.kind], type(experiment.settings))
    tasks: dict[TaskId, Task] = {}
    for name in _experiment_order(session, plans):
        experiment = session.experiments[name]
        for stage in plans[experiment.kind]:
            for recording in recordings(experiment, stage):
                task_id = TaskId(name, stage.name, recording)
                arguments = tuple(
                    _argument(session, plans, experiment, text, recording, stage.over) for text in stage.inputs
                )
                tasks[task_id] = Task(task_id, stage, arguments)
    return tasks


def recordings(experiment: Experiment, stage: Stage) -> tuple[str | None, ...]:
    """List the files that a stage runs over, or just None when it runs once."""
    if stage.over is None:
        return (None,)
    return _names(field_value(experiment.settings, stage.over))


def references(experiment: Experiment, stages: Iterable[Stage]) -> dict[str, str]:
    """Other experiments whose results the stages take, with the field that names each."""
    found = {}
    for stage in stages:
        for text in stage.inputs:
            if text.startswith(OTHER):
                field = text.removeprefix(OTHER).split("/")[0]
                other = _reference(experiment, field)
                if other is not None:
                    found[other] = field
    return found


def field_value(settings: Any, dotted: str) -> Any:
    """Follow a dotted field; None when an optional structure on the way is absent.

    Through a list of structures it leads to all their values, joined: ``drops.laser``.
    """
    for name in dotted.split("."):
        if isinstance(settings, list | tuple):
            values = [getattr(item, name, None) for item in settings]
            settings = [part for value in values for part in _names(value)]
        else:
            settings = getattr(settings, name, None)
    return settings


def _reference(experiment: Experiment, field: str) -> str | None:
    value = field_value(experiment.settings, field)
    is_reference = isinstance(value, str) and value.startswith(REFERENCE)
    return value.removeprefix(REFERENCE) if is_reference else None


def _names(value: Any) -> tuple[str, ...]:
    if value is None:
        return ()
    return (value,) if isinstance(value, str) else tuple(value)


def _experiment_order(session: Session, plans: Mapping[str, tuple[Stage, ...]]) -> list[str]:
    needs = {e.name: references(e, plans[e.kind]) for e in session.experiments.values()}
    try:
        return list(graphlib.TopologicalSorter(needs).static_order())
    except graphlib.CycleError as error:
        first, second = error.args[1][:2]
        where = needs[second][first]
        line = session.experiments[second].lines.get(where, 1)
        circle = " -> ".join(error.args[1])
        message = f"{where}: experiments wait for each other in a circle: {circle}"
        raise ConfigError([f"{FILE_NAME}:{line}: experiments.{second}.{message}"]) from None


def arguments(session: Session, stages: Stages, experiment: Experiment, inputs: Iterable[str]) -> tuple[Argument, ...]:
    """Resolve inputs, written like those of a stage, for what runs once per experiment.

    Raises
    ------
    ConfigError
        The experiment refers to one that has no such stage.
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
        value = field_value(experiment.settings, field)
        if recording is not None and field == over:
            return Argument(text, files=(recording,))
        return Argument(text, files=_names(value), is_list=isinstance(value, list | tuple))
    source, name = experiment, text
    if text.startswith(OTHER):
        field, name = text.removeprefix(OTHER).split("/")
        other = _reference(experiment, field)
        if other is None:
            return Argument(text)
        source = session.experiments[other]
    known = {s.name: s for s in plans[source.kind]}
    if name not in known:
        line = experiment.lines.get(field, 1)
        near = suggest(name, known)
        message = f'"{source.name}" is of kind "{source.kind}", which has no stage "{name}"{near}'
        raise ConfigError([f"{FILE_NAME}:{line}: experiments.{experiment.name}.{field}: {message}"])
    taken = known[name]
    if source is experiment and recording is not None and taken.per == "recording":
        return Argument(text, tasks=(TaskId(source.name, name, recording),))
    ids = tuple(TaskId(source.name, name, r) for r in recordings(source, taken))
    return Argument(text, tasks=ids, is_list=taken.per == "recording")


def ancestors(tasks: Mapping[TaskId, Task], *task_ids: TaskId) -> list[TaskId]:
    """List all tasks behind some, in the order of the session."""
    found: set[TaskId] = set()
    waiting = list(task_ids)
    while waiting:
        new = [b for b in tasks[waiting.pop()].before if b not in found]
        found.update(new)
        waiting += new
    return [name for name in tasks if name in found]
