"""Decide which figures to draw, process the results that they need, draw, and write them.

A figure is up to date when its key is the one in ``figures.json`` in its folder and its files are as
they were written. The key is made of the figure's id, the content keys of the results it reads, and
a digest of the code that its function belongs to. Nothing numerical is imported before a
figure is drawn.
"""

import contextlib
import hashlib
import importlib
import json
import logging
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING, Any

from labpipe import files
from labpipe.errors import LabpipeError, UsageError
from labpipe.notebook import Shown, ShownAsTable
from labpipe.workflow.code import behind
from labpipe.workflow.session import Session
from pipelines.figures._list import FIGURES, Figure
from pipelines.figures.inputs import Inputs, matching, result_keys

if TYPE_CHECKING:
    from labpipe.workflow.plan import Plan
    from pipelines.figures.drawing import Drawing

RECORD = "figures.json"
"""Keys and digests of the drawn figures, in their folder."""

READY = "ready"
UP_TO_DATE = "up to date"
NEEDS_SESSION = "needs a session"
IMPOSSIBLE = "cannot be regenerated"
DRAWN = "drawn"
FAILED = "failed"

_IMPORTS = (
    "matplotlib.backends.backend_pdf",
    "matplotlib.backends.backend_svg",
    "scipy.optimize",
    "pipelines.session",
    *dict.fromkeys(figure.function.partition(":")[0] for figure in FIGURES if figure.function),
)
"""What drawing needs, for workers to share."""

_LONG = ("A.1", "2.6", "3.10", "3.11", "3.12")
"""Figures that take longest: begun last, they would be waited for alone."""


@dataclass(frozen=True, slots=True)
class State:
    """State of one figure, before or after it is drawn.

    ``state`` is one of the words above; ``detail`` names a missing result or the reason; ``experiments`` are those of
    the session that it shows; ``files`` are the digests of the written files, by name.
    """

    figure: Figure
    state: str
    detail: str = ""
    experiments: tuple[str, ...] = ()
    files: Mapping[str, str] = field(default_factory=dict)

    @property
    def id(self) -> str:
        """Number of the figure."""
        return self.figure.id


@dataclass(frozen=True, slots=True, repr=False)
class Made(ShownAsTable):
    """States of the wanted figures, and the folder that they are in."""

    folder: Path
    outcomes: tuple[State, ...]

    def __iter__(self) -> Iterator[State]:
        return iter(self.outcomes)

    def _shown(self) -> Shown:
        rows = [(o.id, o.state, o.detail) for o in self.outcomes]
        return Shown(f"{len(self.outcomes)} figures in {self.folder}", ("figure", "state", "detail"), rows)


def chosen(names: Iterable[str]) -> tuple[Figure, ...]:
    """Return the figures of the given numbers, all when there is none.

    Raises
    ------
    UsageError
        A number is unknown; the nearest is named.

    Examples
    --------
    >>> [figure.id for figure in chosen(["figure 1.2"])]
    ['1.2']
    """
    known = {figure.id.lower(): figure for figure in FIGURES}
    found = []
    for name in names:
        key = name.lower().strip().removeprefix("figure").removeprefix("fig.").strip()
        if key not in known:
            near = get_close_matches(key, known, n=1, cutoff=0.4)
            hint = f' Did you mean "{known[near[0]].id}"?' if near else ""
            raise UsageError(f'there is no figure "{name}".{hint} See `labpipe figures --list`.')
        found.append(known[key])
    return tuple(found) or FIGURES


@dataclass(frozen=True, slots=True)
class Shelf:
    """A folder of figures and the session they are drawn from, if any; ``with_data`` writes their numbers too."""

    folder: Path
    session: Session | None = None
    plan: "Plan | None" = None
    with_data: bool = False

    @classmethod
    def of(cls, folder: Path, session: Path | None) -> "Shelf":
        """Open a folder (which need not exist) and a session."""
        if session is None:
            return cls(folder)
        from pipelines import session as verbs

        made = verbs.plan(session.absolute(), keep=None)  # workers may stand in another folder
        return cls(folder, made.session, made)

    def record(self) -> dict[str, Any]:
        """Return the record of earlier drawings; a damaged one is empty."""
        try:
            found = json.loads((self.folder / RECORD).read_text(encoding="utf-8"))
            return dict(found["figures"])
        except (OSError, ValueError, KeyError, TypeError):
            return {}

    def state(self, figure: Figure, record: Mapping[str, Any]) -> State:
        """Say whether a figure can be drawn."""
        if not figure.function:
            return State(figure, IMPOSSIBLE, figure.reason)
        names: tuple[str, ...] = ()
        for need in figure.needs:
            found = tuple(matching(self.session, need))
            if not found and not need.is_optional:
                wanted = " and ".join(dict.fromkeys(map(str, figure.needs)))
                return State(figure, NEEDS_SESSION, f"with {wanted}")
            names += tuple(name for name in found if name not in names)
        known = record.get(figure.id, {})
        written = {self.folder / name: digest for name, digest in known.get("files", {}).items()}
        is_intact = all(path.is_file() and files.digest(path) == digest for path, digest in written.items())
        if written and is_intact and known["key"] == self.key(figure, names):
            return State(figure, UP_TO_DATE, "", names)
        return State(figure, READY, ", ".join(names), names)

    def key(self, figure: Figure, names: tuple[str, ...]) -> str:
        """Return the key of a figure: everything on which it depends, as one digest."""
        parts = {
            "figure": [figure.id, figure.arguments, self.with_data],
            "code": behind(figure.function, "pipelines.experiments", "pipelines.rig"),
            "results": result_keys(self.plan, self.session, figure.needs) if self.plan is not None and names else {},
        }
        return hashlib.sha256(files.canonical(parts).encode()).hexdigest()


def states(shelf: Shelf, figures: Iterable[Figure]) -> tuple[State, ...]:
    """Say of every figure whether it can be drawn."""
    record = shelf.record()
    return tuple(shelf.state(figure, record) for figure in figures)


def make(
    shelf: Shelf, figures: Iterable[Figure], progress: Callable[[State], None] = lambda outcome: None, *, jobs: int = 0
) -> tuple[State, ...]:
    """Draw the figures that are not up to date; the results that they need are processed first.

    Experiments are processed, and figures drawn, side by side in ``jobs`` processes; 0 does all in this one. Every
    outcome is given to ``progress`` as it comes: drawn, up to date, needs a session, cannot be regenerated, failed.
    """
    from labpipe.workflow.engines import Died, choose, side_by_side

    found = {state.id: state for state in states(shelf, figures)}
    for state in found.values():
        if state.state != READY:
            progress(state)
    ready = [state for state in found.values() if state.state == READY]
    needs = [need for state in ready for need in state.figure.needs]
    targets = {(name, stage) for need in needs for name in matching(shelf.session, need) for stage in need.stages}
    to_run, failures = () if shelf.plan is None else shelf.plan.to_run, dict[str, str]()
    if shelf.session is not None and not targets.isdisjoint((row.experiment, row.stage) for row in to_run):
        from pipelines import session as verbs

        root, names = shelf.session.root, sorted({name for name, _ in targets})
        run = verbs.process(root, sorted(f"{n}/{stage}" for n, stage in targets), names, jobs=jobs, keep=None)
        failures = {o.task.experiment: f"{o.task}: {o.message}" for o in run.failures}
        shelf = replace(Shelf.of(shelf.folder, root), with_data=shelf.with_data)
    sent = replace(shelf, folder=shelf.folder.absolute())
    tasks = {s.id: (sent, s, failures) for s in sorted(ready, key=lambda s: s.id not in _LONG)}
    engine = choose(workers if (workers := min(jobs, len(tasks))) > 1 else 0)
    with contextlib.closing(side_by_side(engine, drawn, tasks, imports=_IMPORTS)) as answers:
        for i, answer in answers:
            lost = replace(found[i], state=FAILED, detail=f"{answer}; too little memory?")
            found[i] = lost if isinstance(answer, Died) else answer
            if found[i].files:
                entry = {"key": shelf.key(found[i].figure, found[i].experiments), "files": found[i].files}
                kept = {"labpipe_figures": 1, "figures": shelf.record() | {i: entry}}
                files.write_text(shelf.folder / RECORD, json.dumps(kept, indent=1, sort_keys=True) + "\n")
            progress(found[i])
    return tuple(found.values())


def drawn(shelf: Shelf, state: State, failures: Mapping[str, str]) -> State:
    """Draw one figure and write it; return its new state.

    The shelf has a plan made after processing, in which experiments may have failed.
    """
    from labpipe.report import save_figure

    # It remarks on the missing time stamps that make the same figure the same bytes.
    logging.getLogger("fontTools").setLevel(logging.ERROR)
    name, title = state.id, state.figure.title
    try:
        drawing = draw(shelf, state.figure, state.experiments)
        paths = [] if drawing.figure is None else save_figure(drawing.figure, shelf.folder / name)
        texts = {".txt": drawing.caption(name, title), ".tex": drawing.latex(name, title)}
        if drawing.table:
            texts[".csv"] = drawing.table
        elif shelf.with_data:
            texts["-data.csv"] = drawing.data()
        written = [*paths, *(shelf.folder / f"{name}{ending}" for ending in texts)]
        for path, text in zip(written[len(paths) :], texts.values(), strict=True):
            files.write_text(path, text)
    except LabpipeError as error:
        why = next((failures[n] for n in state.experiments if n in failures), str(error))
        return replace(state, state=FAILED, detail=why)
    return replace(state, state=DRAWN, detail="", files={path.name: files.digest(path) for path in written})


def draw(shelf: Shelf, figure: Figure, names: tuple[str, ...]) -> "Drawing":
    """Return a figure of some experiments with its caption, written nowhere; errors are those of its results."""
    module, name = figure.function.split(":")
    function = getattr(importlib.import_module(module), name)
    if not figure.needs:
        return function(*figure.arguments)
    if shelf.session is None or shelf.plan is None or not names:
        return function(None, *figure.arguments)
    experiments = {n: shelf.session.experiments[n].settings for n in names}
    return function(Inputs(shelf.plan, experiments), *figure.arguments)
