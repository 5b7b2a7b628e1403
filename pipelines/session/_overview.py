"""The page of a whole session: every experiment with its state, key numbers and a small picture."""

import hashlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from labpipe import files
from labpipe.workflow.code import Identity, behind
from labpipe.workflow.plan import KEPT, READY, Plan, make_plan, page_name
from labpipe.workflow.results import Results
from labpipe.workflow.session import Session
from labpipe.workflow.store import Store
from labpipe.workflow.tasks import Stages, spell_out
from pipelines import experiments
from pipelines.experiments import KeyNumber, Kind, Picture
from pipelines.session._amended_pages import amend_pages
from pipelines.session._unused import unused_files
from pipelines.session._verdicts import Verdict, stored_verdicts

if TYPE_CHECKING:
    import xarray as xr

    from labpipe.report import Block, Cell, IndexRow, IndexTable, LineChart, Link, Notice, ScatterChart, Table

PAGE = "index.html"
"""Below ``SESSION/labpipe``; an experiment cannot have a page of that name there."""
COMPARISON_PAGE = "compare.html"
"""Beside it, once ``labpipe compare`` has written it."""
MATERIAL, BESIDE, AND = "material-", "beside-", "--"
"""How the names of the other pages of several experiments begin, and what is between two names."""


_REPORT, _DONE, _WAITING = "report", "done", "waits"
_FEW_KINDS = 3  # that share one table
_REASONS = 5  # what is wrong with more experiments stands in their rows
_LEAST_STRETCH = 2  # points; fewer show no course
_SORT = "Select a heading to sort. "
_ERROR = (
    "The error is the root mean square of measurement minus model (or film minus laser) over the range of the model "
    "(or of the laser), for the worst repeat, impact or frequency."
)
_COMPARISON = "comparison"
"""The stage whose result holds the error of a kind."""


_Read = Callable[[str], "xr.Dataset | None"]
"""Gives what a stage of an experiment gave, for its first recording; each is read once."""


def write_overview(session: Session, stages: Stages, plan: Plan | None = None) -> Path:
    """Write the page of a session, unless it is up to date; return where it is.

    A plan of the whole session is made unless there is one that still holds.
    """
    store = Store(session.folder)
    if plan is None:
        tasks = spell_out(session, stages)
        plan = make_plan(session, tasks, frozenset(tasks), store, keep=None)
    results = Results(plan)
    verdicts = stored_verdicts(results)
    amend_pages(results, verdicts)
    path = session.folder / PAGE
    code = behind(f"{__name__}:{_page.__name__}", "pipelines.experiments", is_page=True)
    notes = [f"{f.message}: {f.cause}" for f in unused_files(session)]
    told = [verdict.document() for verdict in verdicts.values()]
    mark = f"<!-- {_state_digest(plan, code, [notes, told])} -->\n"
    if not (path.is_file() and path.read_text("utf-8").endswith(mark)):
        files.write_text(path, _page(results, verdicts, notes) + mark)
    return path


def _state_digest(plan: Plan, code: Identity, told: Sequence[Any]) -> str:
    """Digest of all that the page depends on."""
    session = plan.session
    pages = {row.experiment: (session.folder / page_name(row.experiment)).is_file() for row in plan.rows}
    keys = {row.task: plan.keys[row.task].value for row in plan.rows}
    rows = [[r.experiment, r.stage, r.recording, r.state, keys[r.task], pages[r.experiment]] for r in plan.rows]
    together = [(session.folder / COMPARISON_PAGE).is_file(), pages_together(session.folder)]
    head = [code, session.title, session.operator, session.notes, session.synthetic, together, session.waiting, told]
    return hashlib.sha256(files.canonical([head, rows]).encode("utf-8", "replace")).hexdigest()


def _page(results: Results, verdicts: Mapping[str, Verdict], notes: Sequence[str]) -> str:
    from labpipe.report import Document, IndexTable, Notice, Paragraph, Section
    from pipelines.session._verdict_notices import as_sentence

    session = results.plan.session
    sort, error = _SORT, _ERROR  # each is said once
    unfinished = {row.experiment for row in results.plan.rows if row.state not in READY}
    sections, done = [], 0
    told = (Notice("info", as_sentence(note)) for note in notes)
    answer: list[Block] = [*_answer(session, verdicts), *told, *_links(session)]
    if answer:
        sections.append(Section("Answer", answer))
    for title, names in _groups(session):
        table, pictures = _numbers(results, names)
        rows = tuple(
            _row(results, n, cells, pictures[n], verdicts.get(n), title)
            for n, cells in zip(names, table.rows, strict=True)
        )
        can_sort, has_error = len(rows) > 1, any(column.title == "error" for column in table.columns)
        caption = (sort if can_sort else "") + (error if has_error else "")
        sections.append(Section(title, (IndexTable(table.columns, rows, caption.strip()),)))
        done += sum(row.name not in unfinished for row in rows)
        sort, error = "" if can_sort else sort, "" if has_error else error
    if session.waiting:
        sections.append(Section("Waiting", (_those_that_wait(session),)))
    if session.notes:
        sections.append(Section("Session", (Paragraph(session.notes),)))
    about = [f"{done} of {len(session.experiments) + len(session.waiting)} experiments done"]
    if session.operator:
        about.insert(0, f"recorded by {session.operator}")
    return Document(
        session.title, " · ".join(about), "synthetic data" if session.synthetic else "", tuple(sections)
    ).render()


def _answer(session: Session, verdicts: Mapping[str, Verdict]) -> "Iterator[Notice]":
    """Say what the session came to, and of what cannot be believed or differs each with its reason.

    Those on which others rest come first.
    """
    from pipelines.session._verdict_notices import agreement, belief, each

    if not verdicts:
        return
    yield belief(verdicts, session.experiments, session.waiting)
    if said := agreement({name: one.model for name, one in verdicts.items()}):
        yield said
    bad = [name for name, one in verdicts.items() if one.believable != "yes" or one.model == "differs"]
    bad.sort(key=lambda name: -sum(name in other.refers_to for other in session.experiments.values()))
    yield from each(bad[:_REASONS], verdicts, {})


def _those_that_wait(session: Session) -> "IndexTable":
    """List the experiments whose settings are open or mistaken, each with the first of them."""
    from labpipe.report import IndexRow, IndexTable

    rows = [
        IndexRow(name, _WAITING, "info", remark=lines[0] + (f"; and {len(lines) - 1} more" if lines[1:] else ""))
        for name, lines in session.waiting.items()
    ]
    return IndexTable((), tuple(rows), "Not processed until what is named here is filled in or corrected.")


def _groups(session: Session) -> list[tuple[str, list[str]]]:
    """Put all experiments into one table, or those of each kind where kinds are many.

    Every kind has key numbers of its own; a table of all would be wide and mostly empty.
    """
    by_kind: dict[str, list[str]] = {}
    for name, experiment in session.experiments.items():
        by_kind.setdefault(experiment.kind, []).append(name)
    if len(by_kind) <= _FEW_KINDS:
        return [("Experiments", list(session.experiments))]
    return [(experiments.KINDS[kind].title, names) for kind, names in by_kind.items()]


def _links(session: Session) -> "tuple[Link, ...]":
    """Lead to the pages of several experiments, the comparison of all of them first."""
    from labpipe.report import Link

    found = []
    if (session.folder / COMPARISON_PAGE).is_file():
        remark = "all experiments in one table, as of the last labpipe compare"
        found.append(Link("Measurement against model", COMPARISON_PAGE, remark))
    return (*found, *(Link(text, name) for text, name in pages_together(session.folder)))


def pages_together(folder: Path) -> list[tuple[str, str]]:
    """Return what every page of one material, or of two experiments, in ``SESSION/labpipe`` is called, and its file."""
    forms = ((MATERIAL, "material {}"), (BESIDE, "side by side: {}"))
    return [
        (form.format(path.stem.removeprefix(before).replace(AND, " and ")), path.name)
        for before, form in forms
        for path in sorted(folder.glob(f"{before}*.html"))
    ]


def _numbers(results: Results, names: Sequence[str]) -> "tuple[Table, dict[str, bytes | None]]":
    """Return the numbers of experiments, under headings that at least one of them has, and their pictures."""
    from labpipe.report import Listed, listed

    session = results.plan.session
    kinds = {name: experiments.KINDS[session.experiments[name].kind] for name in names}
    numbers = _key_numbers(kinds.values())
    headings = [("error", "1", 2), *((title, unit, 4) for title, unit in numbers), ("warnings", "", 4)]
    found: list[list[tuple[Cell, float | None]]] = []
    pictures: dict[str, bytes | None] = {}
    for name, kind in kinds.items():
        own = {(n.title, n.unit): n for n in kind.key_numbers}
        read = cache(partial(results.first, name))  # one result holds several numbers
        error = _worst(read, kind.error)
        found.append(
            [(error, None), *(_number(read, own.get(n)) for n in numbers), (_warnings(results.plan, name), None)]
        )
        pictures[name] = _picture(read, kind)
    columns = []
    for (title, unit, digits), column in zip(headings, zip(*found, strict=True), strict=True):
        cells, u = zip(*column, strict=True)
        if any(cell is not None for cell in cells):
            columns.append(Listed(title, cells, unit, u if any(u) else None, digits))
    return listed(columns), pictures


def _key_numbers(shown: Iterable[Kind]) -> list[tuple[str, str]]:
    """Return title and unit of the kinds' key numbers; kinds with the same one share it."""
    names = {kind.name for kind in shown}
    every = (n for kind in experiments.KINDS.values() if kind.name in names for n in kind.key_numbers)
    return list(dict.fromkeys((number.title, number.unit) for number in every))


def _worst(read: _Read, variable: str) -> float | None:
    import numpy as np

    dataset = read(_COMPARISON)
    if dataset is None or variable not in dataset:
        return None
    values = np.asarray(dataset[variable].values, float)
    return float(np.nanmax(values)) if np.isfinite(values).any() else None


def _number(read: _Read, number: KeyNumber | None) -> tuple[float | None, float | None]:
    dataset = read(number.stage) if number else None
    return (None if dataset is None or number is None else number.within(dataset)) or (None, None)


def _warnings(plan: Plan, name: str) -> int:
    store = Store(plan.session.folder)
    keys = [plan.keys[row.task].value for row in plan.rows if row.experiment == name]
    records = [store.record(key) for key in keys if key is not None]
    return sum(len(record.warnings) for record in records if record is not None)


def _row(
    results: Results, name: str, cells: Sequence[Any], picture: bytes | None, verdict: Verdict | None, heading: str
) -> "IndexRow":
    from labpipe.report import IndexRow

    plan = results.plan
    rows = [row for row in plan.rows if row.experiment == name]
    has_page = (plan.session.folder / page_name(name)).is_file()
    waiting = [row for row in rows if row.state not in READY]
    kept = [row for row in rows if row.state == KEPT]
    kind = experiments.KINDS[plan.session.experiments[name].kind].title
    unreadable = next((plan.keys[r.task].problem for r in rows if plan.keys[r.task].problem), "")
    state, level = _DONE, "ok"
    if unreadable:
        state, level = "waiting for files", "warning"
    elif has_page and {row.stage for row in waiting} == {_REPORT}:
        state, level = "page out of date", "warning"
    elif waiting and has_page:
        known = "" if verdict is None else f"{_judged(verdict.believable, verdict.model)[0]}, "
        has_failed = verdict is not None and verdict.state == "failed"
        state, level = f"{known}{len(waiting)} of {len(rows)} steps to do", "warning"
        if has_failed:
            state, level = f"{state} or failed", "error"
    elif waiting:
        state, level = "not processed", "info"
    elif verdict is not None:
        state, level = _judged(verdict.believable, verdict.model)
    if kept and not (unreadable or waiting):
        state, level = f"{state}, {len(kept)} results of earlier code", "warning" if level == "ok" else level
    return IndexRow(
        name,
        state,
        level,  # type: ignore[arg-type]
        href=page_name(name) if has_page else "",
        metrics=tuple(cells),
        thumbnail=picture,
        remark="; ".join(text for text in ("" if kind == heading else kind, unreadable) if text),
    )


def _judged(believable: str, model: str) -> tuple[str, str]:
    """Say in a few words what a judgement came to, and in which colour."""
    if believable != "yes":
        return believable, "error" if believable == "impossible" else "warning"
    if model == "none":
        return "believable", "ok"
    return f"believable, model {model}", "warning" if model == "differs" else "ok"


def _picture(read: _Read, kind: Kind) -> bytes | None:
    from labpipe.report import thumbnail

    source = kind.picture
    dataset = read(source.stage) if source else None
    if source is None or dataset is None or not {source.x, source.y} <= set(dataset.variables):
        return None
    chart = _chart(dataset, source)
    return None if chart is None else thumbnail(chart)


def _chart(dataset: "xr.Dataset", source: Picture) -> "LineChart | ScatterChart | None":
    import numpy as np

    from labpipe.report import LineChart, ScatterChart, Series

    x, y = (np.asarray(dataset[name].values, float) for name in (source.x, source.y))
    if x.ndim > 1:  # one loop per frequency
        loops = [(a[np.isfinite(a + b)], b[np.isfinite(a + b)]) for a, b in zip(x, y, strict=True)]
        series = [Series(str(i), a, b) for i, (a, b) in enumerate(loops) if a.size]
        return ScatterChart("", source.x, source.y, series) if series else None
    known = np.flatnonzero(np.isfinite(x))
    order = known[np.argsort(x[known], kind="stable")]
    x, y = x[order], np.where(np.isinf(y), np.nan, y)[order]  # a missing value is a gap, not a line across it
    if source.is_first:
        edges = np.flatnonzero(np.diff(np.isfinite(y), prepend=False, append=False)).reshape(-1, 2)
        first = next((slice(a, b) for a, b in edges if b - a > _LEAST_STRETCH), slice(None))
        x, y = x[first], y[first]
    if np.count_nonzero(np.isfinite(y)) < 2:
        return None
    series, scale = [Series(source.y, x, y)], source.scale
    return LineChart("", source.x, source.y, series, x_scale=scale, y_scale=scale)  # type: ignore[arg-type]
