"""The page of a whole session: every experiment with its state, key numbers and a small picture."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import zip_longest
from pathlib import Path
from typing import TYPE_CHECKING, Any

from labpipe import files
from labpipe.workflow.code import behind
from labpipe.workflow.graph import Stages
from labpipe.workflow.plan import KEPT, READY, Plan, page_name, plan as make_plan
from labpipe.workflow.results import Results
from labpipe.workflow.session import Session
from labpipe.workflow.store import AMENDED, Store, key_of
from pipelines import experiments
from pipelines.experiments import Picture
from pipelines.session._results import key_numbers
from pipelines.session._session_checks import NAMED, unused_files
from pipelines.session._verdicts import Verdict, stored_verdicts

if TYPE_CHECKING:
    import xarray as xr

    from labpipe.arrays import Floats
    from labpipe.report import Block, Link, Listed, Notice, Picture as Image, Table

PAGE = "index.html"
"""Below ``SESSION/labpipe``; an experiment cannot have a page of that name there."""
COMPARISON_PAGE = "compare.html"
"""Beside it, once ``labpipe compare`` has written it."""
BESIDE, AND = "beside-", "--"
"""The beginning of the names of pages of two experiments, and the sign between these."""
_LEAST_STRETCH = 2  # points; fewer show no course
_BY_ITSELF = "By what it records alone: "


def write_overview(session: Session, stages: Stages, plan: Plan | None = None) -> Path:
    """Write the page of a session, unless it is up to date; return where it is.

    A plan of the whole session is made unless there is one that still holds.
    """
    store = Store(session.folder)
    if plan is None:
        plan = make_plan(session, stages, keep=None, store=store)
    results = Results(plan)
    verdicts = stored_verdicts(results)
    amend_pages(results, verdicts)
    path = session.folder / PAGE
    code = behind(f"{__name__}:{_page.__name__}", "pipelines.experiments")
    notes = [f"{f.message}: {f.cause}" for f in unused_files(session)]
    pages = {row.experiment: (session.folder / page_name(row.experiment)).is_file() for row in plan.rows}
    rows = [[*row.task, row.state, plan.keys[row.task].value, pages[row.experiment]] for row in plan.rows]
    state = [code, session.title, session.operator, session.notes, session.synthetic, session.waiting, rows, notes]
    state += [(session.folder / COMPARISON_PAGE).is_file(), pages_together(session.folder)]
    state += [one.document() for one in verdicts.values()]
    mark = f"<!-- {hashlib.sha256(files.canonical(state).encode('utf-8', 'replace')).hexdigest()} -->\n"
    if not (path.is_file() and path.read_text("utf-8").endswith(mark)):
        from pipelines.experiments.shared.pages import LIMITS
        from pipelines.guide import standalone

        files.write_text(session.folder / f"reports/{LIMITS}", standalone("limits"))
        files.write_text(path, _page(results, verdicts, notes) + mark)
    return path


def pages_together(folder: Path) -> list[tuple[str, str]]:
    """Return title and file of every page of two experiments in ``SESSION/labpipe``."""
    paths = sorted(folder.glob(f"{BESIDE}*.html"))
    return [(f"side by side: {p.stem.removeprefix(BESIDE).replace(AND, ' and ')}", p.name) for p in paths]


def _page(results: Results, verdicts: Mapping[str, Verdict], notes: Sequence[str]) -> str:
    from labpipe.report import Document, Link, Listed, Notice, Paragraph, Section
    from pipelines.session._verdict_notices import agreement, as_sentence, belief, each

    session = results.plan.session
    answer: list[Block] = []
    if own := {name: one for name, one in verdicts.items() if name not in session.variants}:  # a record counts once
        answer.append(belief(own, session.without_variants().experiments, session.waiting))
        said = agreement({name: one.model for name, one in own.items()})
        answer += [said] if said else []
        bad = [name for name, one in own.items() if one.believable != "yes" or one.model == "differs"]
        # those on which others rest come first
        bad.sort(key=lambda name: -sum(name in other.refers_to for other in session.experiments.values()))
        answer += each(bad[:NAMED], own)  # of more the rows say it
    answer += [Notice("info", as_sentence(note)) for note in notes]
    if (session.folder / COMPARISON_PAGE).is_file():
        remark = "all experiments in one table, as of the last labpipe compare"
        answer.append(Link("Measurement against model", COMPARISON_PAGE, remark))
    answer += [Link(text, name) for text, name in pages_together(session.folder)]
    sections = [Section("Answer", answer)] if answer else []
    by_kind: dict[str, list[str]] = {}  # each has key numbers of its own
    for name, experiment in session.experiments.items():
        by_kind.setdefault(experiment.kind, []).append(name)
    caption = "Select a heading to sort."  # is said once
    for kind, names in by_kind.items():
        rows = [_row(results, name, verdicts.get(name)) for name in names]
        numbers = [key_numbers(results, name) for name in names]
        columns = []
        for title, unit in dict.fromkeys((title, one[title][2]) for one in numbers for title in one):
            # why there is none although the result is there; else the state says it
            of_title = [number for number in experiments.KINDS[kind].key_numbers if number.title == title]
            there = ([n.absent for n in of_title if results.first(name, n.stage) is not None] for name in names)
            gaps = [next(iter(absent), None) for absent in there]
            found = [one.get(title, (gap, None, "")) for one, gap in zip(numbers, gaps, strict=True)]
            values, us, _ = zip(*found, strict=True)
            columns.append(Listed(title, values, unit, us if any(us) else None))
        table = experiments_table(rows, columns, caption if len(rows) > 1 else "")
        sections.append(Section(experiments.KINDS[kind].title, (table,)))
        caption = "" if len(rows) > 1 else caption
    if session.waiting:
        waits = []
        for name, lines in session.waiting.items():
            more = f"; and {len(lines) - 1} more" if lines[1:] else ""
            waits.append((None, Link(name, "", lines[0] + more), Notice("info", "waits")))
        caption = "Not processed until the lines that are named here are filled in or corrected."
        sections.append(Section("Waiting", (experiments_table(waits, (), caption),)))
    if session.notes:
        sections.append(Section("Session", (Paragraph(session.notes),)))
    unfinished = {row.experiment for row in results.plan.rows if row.state not in READY}
    done, n = len(session.experiments.keys() - unfinished), len(session.experiments) + len(session.waiting)
    about = f"{done} of {n} experiments done"
    about = f"recorded by {session.operator} · {about}" if session.operator else about
    return Document(session.title, about, "synthetic data" if session.synthetic else "", tuple(sections)).render()


def experiments_table(
    entries: "Sequence[tuple[Any, Link, Notice]]", columns: "Sequence[Listed]", caption: str
) -> "Table":
    """Make a table of experiments: picture, link and state of each, then columns of its numbers."""
    from labpipe.report import Column, Table, listed

    table = listed(columns)
    rows = [(*entry, *cells) for entry, cells in zip_longest(entries, table.rows, fillvalue=())]
    return Table((*map(Column, ("", "Experiment", "State")), *table.columns), rows, caption, sortable=len(rows) > 1)


def _row(results: Results, name: str, verdict: Verdict | None) -> "tuple[Image | None, Link, Notice]":
    import numpy as np

    from labpipe.report import Level, LineChart, Link, Notice, Picture, ScatterChart, Series, thumbnail
    from pipelines.session._verdict_notices import judgement

    plan, experiment = results.plan, results.experiments[name]
    rows = [row for row in plan.rows if row.experiment == name]
    has_page = (plan.session.folder / page_name(name)).is_file()
    waiting, kept = [row for row in rows if row.state not in READY], sum(row.state == KEPT for row in rows)
    unreadable = next((plan.keys[r.task].problem for r in rows if plan.keys[r.task].problem), "")
    level: Level
    state, level = judgement(verdict.believable, verdict.model) if verdict else ("done", "ok")
    if unreadable:
        state, level = "waiting for files", "warning"
    elif has_page and {row.stage for row in waiting} == {"report"}:
        state, level = "page out of date", "warning"
    elif waiting and has_page:
        has_failed = verdict is not None and verdict.state == "failed"
        to_do = f"{len(waiting)} of {len(rows)} steps to do{' or failed' * has_failed}"
        state, level = f"{state}, {to_do}" if verdict else to_do, "error" if has_failed else "warning"
    elif waiting:
        state, level = "not processed", "info"
    elif kept:
        state, level = f"{state}, {kept} results of earlier code", "warning" if level == "ok" else level
    remark = "; ".join(filter(None, (experiment.base and f"variant of {experiment.base}", unreadable)))
    link = Link(name, page_name(name) if has_page else "", remark)
    source = experiments.KINDS[experiment.kind].picture
    dataset = None if source is None else results.first(name, source.stage)
    chart: LineChart | ScatterChart | None = None  # the main curve, or a loop for each frequency
    if source is not None and (found := curve(dataset, source)) is not None:
        scale: Any = source.scale
        chart = LineChart("", source.x, source.y, [Series(source.y, *found)], x_scale=scale, y_scale=scale)
    elif source is not None and dataset is not None and source.x in dataset.variables and dataset[source.x].ndim > 1:
        both = np.stack([dataset[source.x], dataset[source.y]], 1)
        loops = [values[:, np.isfinite(values.sum(0))] for values in both]
        series = [Series(str(i), *one) for i, one in enumerate(loops) if one.size]
        chart = ScatterChart("", source.x, source.y, series)
    return None if chart is None else Picture(thumbnail(chart), ""), link, Notice(level, state)


def curve(dataset: "xr.Dataset | None", source: Picture) -> "tuple[Floats, Floats] | None":
    """Return the main curve of an experiment, by x; None where its result is not there or holds too few points.

    A missing value is a gap, not a line across it.
    """
    import numpy as np

    if dataset is None or not {source.x, source.y} <= set(dataset.variables) or dataset[source.x].ndim != 1:
        return None
    x, y = (np.asarray(dataset[name].values, float) for name in (source.x, source.y))
    known = np.flatnonzero(np.isfinite(x))
    order = known[np.argsort(x[known], kind="stable")]
    x, y = x[order], np.where(np.isinf(y), np.nan, y)[order]
    if source.is_first:
        edges = np.flatnonzero(np.diff(np.isfinite(y), prepend=False, append=False)).reshape(-1, 2)
        first = next((slice(a, b) for a, b in edges if b - a > _LEAST_STRETCH), slice(None))
        x, y = x[first], y[first]
    return (x, y) if np.count_nonzero(np.isfinite(y)) > 1 else None


def amend_pages(results: Results, verdicts: Mapping[str, Verdict]) -> None:
    """Add findings and suspects of the session as a whole to the pages of the experiments that they concern.

    A page is a result of its experiment and knows no other. It is amended where it is shown, so that it agrees
    with the command, the catalogue and JSON; the stored page stays, and comes back when the finding goes.
    """
    store = Store(results.plan.session.folder)
    known = store.amended()
    if not known and not any(one.findings or one.suspects for one in verdicts.values()):
        return
    code = key_of(behind(f"{__name__}:{_amended.__name__}"))
    kept = {name: entry for name, entry in known.items() if name not in verdicts and name in results.experiments}
    for name, one in verdicts.items():
        path = store.folder / page_name(name)
        if not path.is_file() or not (one.findings or one.suspects or name in known):
            continue
        rows = (r for r in results.plan.rows if r.experiment == name)
        pages = (r for r in rows if results.plan.tasks[r.task].stage.output == "page" and r.state in READY)
        # the page of an experiment that failed is no result: it is made again in every run
        key = next((results.plan.keys[r.task].value for r in pages), None)
        before = known.get(name, {})
        told = [*one.suspects, *([f.level, f.message, f.cause, f.place] for f in one.findings)]
        mark = [key, code, told]
        if before.get("mark") != mark or before["digest"] != store.index.digest(path):
            page = path.read_text("utf-8") if key is None else str(store.read(key))
            files.write_text(path, _amended(page, one))
            before = {"key": key, "mark": mark, "digest": files.digest(path)}
        if told:
            kept[name] = before
    if kept != known:
        files.write_bytes(store.root / AMENDED, files.seal(kept))


def _amended(page: str, one: Verdict) -> str:
    from markupsafe import escape

    from labpipe.report import Notice, amended
    from pipelines.experiments.shared.judgements import VERDICT, capitalised, with_minus, written_place
    from pipelines.session._verdict_notices import LEVELS, as_sentence

    own = [f for f in one.findings if str(escape(with_minus(f.message))) in page]
    for finding in own:
        if finding.setting and finding.place:
            for stored in {written_place(replace(finding, line=None, value="", file=f)) for f in (finding.file, "")}:
                page = page.replace(f">{escape(stored)}</td>", f">{escape(finding.place)}</td>")
    notices = []
    if one.model == "differs" and one.suspects and str(escape(one.suspects[0].partition(" (")[0])) not in page:
        notices.append(Notice("info", with_minus(f"Compared with the whole session: {one.suspects[0]}.")))
    for found in (f for f in one.findings if f not in own):
        level: Any = LEVELS.get(found.level, "info")
        place = f" ({found.place})" if found.place else ""
        cause = f" {as_sentence(found.cause)}" if found.cause else ""
        text = f"{found.message.rstrip('.')}{place}.{cause}"  # a notice that is one is called so
        told = text if found.level == "note" else f"{capitalised(found.level)}: {text}"
        notices.append(Notice(level, with_minus(told)))
    if not notices:
        return page
    is_by_session = one.believable != "yes" and not any(f.level == one.believable for f in own)
    return amended(page, VERDICT, notices, aside=_BY_ITSELF if is_by_session else "")
