"""Many session folders as one table of experiments, parameters and results.

The rows of a session are kept among its results, and made again only when its plan says that something changed. The
table of all is an SQLite database, made in memory and written whole: it is never half there, and can be thrown away.
Conditions are asked of the database in memory.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import os
import re
import sqlite3
from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from labpipe import files
from labpipe.errors import InputError, LabpipeError, SourceError, StorageError, UsageError
from labpipe.notebook import html_table
from labpipe.report import Block, Document, Link, Listed, Notice, Section, Table
from labpipe.units import Quantity
from labpipe.workflow.fields import REFERENCE, suggest
from labpipe.workflow.plan import KEPT, READY, Plan, page_name
from labpipe.workflow.results import Results
from labpipe.workflow.session import FILE_NAME
from labpipe.workflow.store import Store
from pipelines.experiments import JUDGEMENT, KINDS
from pipelines.experiments.shared.pages import SYNTHETIC, counted
from pipelines.experiments.shared.proposals import material_word
from pipelines.session._overview import PAGE as SESSION_PAGE, experiments_table
from pipelines.session._processing import plan as plan_session
from pipelines.session._results import key_numbers
from pipelines.session._verdict_notices import judgement
from pipelines.session._verdicts import Verdict, stored_verdicts, waiting_verdicts

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

TABLES = {
    "experiments": (
        "session", "experiment", "kind", "state", "believable", "model", "checks", "findings", "cause",
        "operator", "recorded", "record", "sensor",
    ),
    "results": ("session", "experiment", "stage", "recording", "variable", "item", "value", "u", "unit"),
    "sessions": ("session", "title", "operator", "synthetic", "problem"),
    "columns": ("name", "unit"),
}  # fmt: skip
"""Tables and the columns that they always have; experiments have one more for each setting and key number.

``recorded`` is the first day of the recordings, ``record`` the calibration record by its ``id``, ``sensor`` what it
calibrates: instrument and serial number or, without a number, the name of the record's file without its date.
"""

CHECKS, KEYS = "checks", "key numbers"
"""Stages of results that are checks, observed over expected under the name of the check, and of key numbers."""
CATALOGUE = "labpipe/catalogue.sqlite"
PAGE, TREND_PAGE = "catalogue.html", "trend.html"
"""In the folder that holds the sessions, or in the ``labpipe`` folder of a session itself."""
_APPLICATION = 0x6C706361  # "lpca": marks our databases
_LAYOUT = 7
"""Raised when the tables change; rows of another layout are made anew."""
_KEPT = "catalogue.json"
"""Among the results of a session: its rows, under a digest of all that they come from."""
_LONGEST_RESULT = 64
"""Values of one variable that are listed; longer ones are curves, which ``export`` writes."""
_BODIES = ("sphere", "punch", "substrate")
"""Their fields have no name of a table before them: ``radius``, not ``sphere_radius``."""
_DATE = re.compile(r"[ _.-]*(19|20)\d\d([-_.]?\d\d){0,2}$")


@dataclass(frozen=True, eq=False, repr=False, slots=True)
class Catalogued:
    """The table after an update, its database and its page; sessions are named relative to the database's folder.

    ``renewed`` are sessions read again, ``unchanged`` those whose rows were kept, ``problems`` those that cannot be
    read, with the reason; their rows of before are kept.
    """

    path: Path
    page: Path
    renewed: tuple[str, ...]
    unchanged: tuple[str, ...]
    problems: dict[str, str]
    table: pd.DataFrame = field(repr=False)

    def __repr__(self) -> str:
        return f"{self._caption}\n{self.table}"

    def _repr_html_(self) -> str:
        table: Any = self.table  # as pandas shows it
        return f"{html_table(self._caption, (), ())}{table._repr_html_()}"

    @property
    def _caption(self) -> str:
        counts = f"{len(self.renewed)} sessions read, {len(self.unchanged)} unchanged"
        problems = f", {len(self.problems)} with problems" if self.problems else ""
        return f"{self.path}: {len(self.table)} rows; {counts}{problems}"


def catalogue(
    folders: str | Path | Iterable[str | Path],
    database: str | Path | None = None,
    *,
    where: str = "",
    columns: Sequence[str] = (),
    table: str = "experiments",
) -> Catalogued:
    """List the experiments of all sessions below some folders, one row each, from a database that is renewed first.

    Nothing is processed: of a session that is not, the parameters are listed.

    Parameters
    ----------
    folders : path-like, or iterable of them
        Searched for ``session.toml``; symbolic links are not followed.
    database : path-like, optional
        Default ``labpipe/catalogue.sqlite`` in the first folder.
    where : str
        An SQL expression in the columns, ``"material = 'acrylic' and height > 0.005"``; SI units.
    columns : sequence of str
        Only these; default all.
    table : {"experiments", "results", "sessions", "columns"}
        ``results`` has one row per value with all columns of its experiment.

    Returns
    -------
    Catalogued
        Its ``table`` is a DataFrame, ordered by session and experiment; ``attrs["units"]`` maps columns to SI units.

    Examples
    --------
    >>> catalogue("sessions", where="material = 'acrylic'").table  # doctest: +SKIP
    """
    if table not in TABLES:
        raise UsageError(f'unknown table "{table}"; expected one of {", ".join(TABLES)}')
    with open_catalogue(folders, database) as opened:
        return Catalogued(
            opened.path, opened.page_folder / PAGE, **opened.done, table=opened.select(table, where, columns)
        )


@dataclass(frozen=True, eq=False, slots=True)
class Opened:
    """A catalogue that is up to date: the database, and the folder from which the names of sessions start.

    ``done`` are sessions by their state, as in :class:`Catalogued`, ``units`` those of the columns of experiments. The
    connection is to a copy in memory, of which anything may be asked.
    """

    path: Path
    base: Path
    done: dict[str, Any]
    units: dict[str, str]
    connection: sqlite3.Connection

    @property
    def page_folder(self) -> Path:
        """Folder of pages about the sessions: the one that holds them, or ``labpipe`` where it is a session itself."""
        return self.base / "labpipe" if (self.base / FILE_NAME).is_file() else self.base

    def href(self, session: str, page: str) -> str:
        """Return the way from a page about the sessions to one of a session; "" where there is none below."""
        folder = self.base / session if self.page_folder == self.base or session != self.base.name else self.base
        target = files.relative(folder / "labpipe" / page, self.page_folder)
        return target if (self.page_folder / target).is_file() and not target.startswith("..") else ""

    def select(self, table: str, where: str = "", columns: Sequence[str] = ()) -> pd.DataFrame:
        """Return rows of a table, with ``attrs["units"]``; ``where`` and ``columns`` as in :func:`catalogue`."""
        import pandas as pd

        source = "results NATURAL JOIN experiments" if table == "results" else table
        known = [column[0] for column in self.connection.execute(f"SELECT * FROM {source} LIMIT 0").description]  # noqa: S608
        for name in columns:
            if name not in known:
                raise UsageError(f'no column "{name}"{suggest(name, known)}; there are {", ".join(known)}')
        selected = ", ".join(f'"{name}"' for name in columns) or "*"
        order = '"session", "experiment"' if "experiment" in known else "1"
        condition = f"WHERE ({where})" if where.strip() else ""
        statement = f"SELECT {selected} FROM {source} {condition} ORDER BY {order}"  # noqa: S608 (of a copy in memory)
        try:
            rows = self.connection.execute(statement).fetchall()
        except (sqlite3.Error, sqlite3.Warning) as error:
            near = suggest(str(error).removeprefix("no such column: "), known) if "no such column" in str(error) else ""
            raise UsageError(f"--where {where!r}: {error}{near}; the columns are {', '.join(known)}") from error
        frame = pd.DataFrame(rows, columns=list(columns) or known)
        frame.attrs["units"] = {name: self.units[name] for name in frame.columns if self.units.get(name)}
        return frame


@contextmanager
def open_catalogue(folders: str | Path | Iterable[str | Path], database: str | Path | None = None) -> Iterator[Opened]:
    """Bring the catalogue of all sessions below some folders, and its page, up to date; as :func:`catalogue`."""
    import pandas as pd

    roots = [Path(folder).resolve() for folder in ([folders] if isinstance(folders, str | Path) else folders)]
    if not roots:
        raise InputError("no folder to search; give at least one")
    path = Path(database).resolve() if database is not None else roots[0] / CATALOGUE
    before = path.read_bytes() if path.exists() else None
    # the application is in the first bytes (sqlite.org/fileformat2.html, section 1.3)
    is_ours = before is None or (before[:16] == b"SQLite format 3\0" and int.from_bytes(before[68:72]) == _APPLICATION)
    if not is_ours:
        hint = "Give another --database; this file is left as it is."
        raise SourceError(path, "not a catalogue of labpipe", hint=hint)
    base = path.parents[1] if path.parts[-2:] == Path(CATALOGUE).parts else path.parent
    tables: dict[str, list[dict[str, Any]]] = {name: [] for name in TABLES}
    units: dict[str, str] = {}
    done: dict[str, Any] = {"renewed": (), "unchanged": (), "problems": {}}
    for folder in _sessions(roots):
        name, (kept, state, problem) = files.relative(folder, base), _kept_rows(folder)
        name = base.name if name == "." else name
        if problem is not None:
            done["problems"][name] = problem
        else:
            done[state] += (name,)
        tables["sessions"].append(kept.get("session", {}) | {"session": name, "problem": problem})
        titles = TABLES["results"]
        tables["results"] += [dict(zip(titles, (name, *row), strict=True)) for row in kept.get("results", ())]
        for cells, found in kept.get("experiments", ()):
            row = {"session": name} | cells
            for title, value, unit in found:
                # The same word for two quantities, in kinds that know nothing of each other.
                own = title if units.get(title, unit) == unit else f"{cells['kind']}_{title}"
                units.setdefault(own, unit)
                row[own] = value
            tables["experiments"].append(row)
    tables["columns"] = [{"name": name, "unit": unit} for name, unit in units.items()]
    with closing(sqlite3.connect(":memory:")) as connection:
        for name, rows in tables.items():
            columns = list(dict.fromkeys((*TABLES[name], *(title for row in rows for title in row))))
            pd.DataFrame(rows, columns=columns, dtype=None if rows else object).to_sql(name, connection, index=False)
        connection.execute(f"PRAGMA application_id = {_APPLICATION}")
        opened = Opened(path, base, done, units, connection)
        page, data = opened.page_folder / PAGE, connection.serialize()
        if data != before or done["renewed"] or not page.exists():
            files.write_bytes(path, data)
            files.write_text(page, _page(opened))
        yield opened


def _kept_rows(folder: Path) -> tuple[dict[str, Any], str, str | None]:
    """Return the rows of a session, whether they are ``"renewed"`` or ``"unchanged"``, and why it cannot be read."""
    path = Store(folder / "labpipe").root / _KEPT
    try:
        kept = files.unseal(path.read_bytes()) or {}
    except OSError:
        kept = {}
    try:
        plan = plan_session(folder, keep=True)  # years of sessions outlive the code that processed them
    except LabpipeError as error:
        return kept, "unchanged", str(error)
    session = plan.session
    # findings name lines, so that a line more is a change
    settings = {n: [msgspec.to_builtins(e.settings), dict(e.lines)] for n, e in session.experiments.items()}
    states = [[*row.task, row.state, plan.keys[row.task].value] for row in plan.rows]
    document = [_LAYOUT, session.title, session.operator, session.synthetic, settings, states, session.waiting]
    digest = hashlib.sha256(files.canonical(document).encode("utf-8", "replace")).hexdigest()
    if kept.get("digest") == digest:
        return kept, "unchanged", None
    kept = {"digest": digest, **_rows(plan)}
    with suppress(StorageError):  # it only saves time
        files.write_bytes(path, files.seal(kept))
    return files.unseal(files.seal(kept)), "renewed", None


def _sessions(roots: Iterable[Path]) -> Iterator[Path]:
    seen = set[str]()
    for folder, names, file_names in itertools.chain.from_iterable(map(os.walk, roots)):
        has_session = FILE_NAME in file_names
        # the results of labpipe hold no sessions, and there may be many of them
        names[:] = sorted(n for n in names if not n.startswith(".") and not (has_session and n == "labpipe"))
        if has_session and folder not in seen:
            seen.add(folder)
            yield Path(folder)


def _rows(plan: Plan) -> dict[str, Any]:
    """Return the rows of a session: of itself, of its experiments with value and unit of each column, and results."""
    import numpy as np

    from labpipe.judging import from_json

    session, results = plan.session, Results(plan)
    verdicts, waiting = stored_verdicts(results), waiting_verdicts(session)
    experiments: list[tuple[dict[str, Any], list[tuple[str, Any, str]]]] = []
    numbers: list[tuple[Any, ...]] = []
    for experiment in session.without_variants().experiments.values():
        rows = [row for row in plan.rows if row.experiment == experiment.name]
        to_do, kept = sum(row.state not in READY for row in rows), sum(row.state == KEPT for row in rows)
        state = f"{to_do} of {len(rows)} steps to do" if to_do else "done"
        state += f", {kept} results of earlier code" if kept else ""
        cells: dict[str, Any] = {"experiment": experiment.name, "kind": experiment.kind, "state": state}
        cells |= {"operator": session.operator, **_verdict_cells(verdicts.get(experiment.name))}
        found = {title: (value, unit) for title, value, unit in _settings((), experiment.settings)}
        for title, (value, u, unit) in key_numbers(results, experiment.name).items():
            numbers.append((experiment.name, KEYS, None, title, 0, value, u, unit))
            column = title.replace(" ", "_")
            found.setdefault(column, (value, unit))
            if u is not None:
                found.setdefault(f"u_{column}", (u, unit))
        for row, dataset in ((row, results.up_to_date(row.task)) for row in rows):
            if dataset is not None:
                cells |= _calibration(dataset, cells, found)
                numbers += [(experiment.name, row.stage, row.recording, *v) for v in _values(dataset)]
                judged = dataset.attrs.get(JUDGEMENT)
                for i, check in enumerate(from_json(judged).checks if judged else ()):  # observed over expected
                    if np.isfinite(check.log_ratio) and np.isfinite(check.u_log_ratio):
                        ratio = float(np.exp(check.log_ratio))
                        own = (check.recording, check.name, i, ratio, ratio * check.u_log_ratio, "1")
                        numbers.append((experiment.name, CHECKS, *own))
        source = next((str(found[n][0]) for n in ("material_from", "material_file") if n in found), "")
        if source:  # the polymer that the name of a DMA experiment or a file contains, or else that name
            source = source.removeprefix(REFERENCE)
            found.setdefault("material", (material_word(source) or source, ""))
        experiments.append((cells, [(title, *pair) for title, pair in found.items()]))
    for one in waiting.values():
        cells = {"experiment": one.experiment, "kind": one.kind, "state": one.state, **_verdict_cells(one)}
        experiments.append((cells, []))
    head = {"title": session.title, "operator": session.operator, "synthetic": int(session.synthetic)}
    return {"session": head, "experiments": experiments, "results": numbers}


def _verdict_cells(verdict: Verdict | None) -> dict[str, Any]:
    """Return the cells of a verdict, the worst finding first; none of an experiment that was not judged."""
    if verdict is None:
        return {}
    lines = [f"{f.level}: {f.message}" + (f" ({f.place})" if f.file else "") for f in verdict.findings]
    cause = verdict.cause or next((f.cause for f in verdict.findings if f.cause), "")
    return {"believable": verdict.believable, "model": verdict.model, "checks": verdict.checks,
            "findings": "; ".join(lines), "cause": cause}  # fmt: skip


def _settings(path: tuple[str, ...], value: Any) -> Iterator[tuple[str, Any, str]]:
    """Yield name, value and unit of a setting or, of a table of settings, of all in it."""
    if isinstance(value, msgspec.Struct):
        for name in value.__struct_fields__:
            yield from _settings((*path, name), getattr(value, name))
        return
    name = "_".join(path[1:] if len(path) > 1 and path[0] in _BODIES else path)
    if value is None or name == "kind":
        return
    if isinstance(value, Quantity):
        yield name, value.value, value.si
        if value.u:
            yield f"u_{name}", value.u, value.si
    else:
        is_plain = isinstance(value, bool | int | float | str)
        yield name, value if is_plain else files.canonical(msgspec.to_builtins(value)), ""


def _calibration(dataset: xr.Dataset, cells: dict[str, Any], settings: dict[str, Any]) -> dict[str, Any]:
    """Return the first day of the recordings, and the record that their sensor was calibrated with."""
    found = json.loads(dataset.attrs.get("calibration") or "{}")
    if not isinstance(found, dict):  # why there is none
        found = {"recorded_day": str(dataset.attrs.get("start", ""))[:10]}
    days = filter(None, (found.get("stated_day") or found.get("recorded_day"), cells.get("recorded")))
    made: dict[str, Any] = {"recorded": day} if (day := min(days, default=None)) else {}
    if "id" in found:
        places = [v for n, (v, _) in settings.items() if n.endswith(("calibration", "_record"))]
        name = found["serial"] or _DATE.sub("", next((Path(str(place)).stem for place in places), ""))
        made |= {"record": found["id"], "sensor": f"{found['instrument']} {name}".strip()}
    return made


def _values(dataset: xr.Dataset) -> Iterator[tuple[str, int, float, float | None, str]]:
    """Yield numbers of short variables: name, position, value, standard uncertainty, unit."""
    import numpy as np

    for name, variable in dataset.data_vars.items():
        text = str(name)
        if variable.size > _LONGEST_RESULT or variable.dtype.kind not in "fiub":
            continue
        if text.startswith("u_") and text[2:] in dataset:
            continue
        u, unit = dataset.get(f"u_{text}"), str(variable.attrs.get("units", ""))
        own = np.full(variable.size, np.nan) if u is None or u.size != variable.size else np.ravel(u.values)
        for i, (value, of_it) in enumerate(zip(np.ravel(variable.values), own, strict=True)):
            if np.isfinite(value):
                yield text, i, float(value), float(of_it) if np.isfinite(of_it) else None, unit


def _page(opened: Opened) -> str:
    """Write the page: every experiment by kind with its verdict and key numbers, and a way to its own page."""
    experiments, sessions = opened.select("experiments"), opened.select("sessions")
    experiments = experiments.astype(object).where(experiments.notna(), None)
    n = len(experiments)
    sure, bad = (int((experiments["believable"] == word).sum()) for word in ("yes", "impossible"))
    agree, differ = (int((experiments["model"] == word).sum()) for word in ("agrees", "differs"))
    text = f"{counted(len(sessions), 'session')} with {counted(n, 'experiment')}: {sure} believable, "
    text += f"{agree} in which the model agrees{f', {differ} in which it differs' if differ else ''}."
    answer: list[Block] = [Notice("error" if bad else "ok" if sure == n else "info", text)]
    broken = sessions[sessions["problem"].notna()].to_dict("records")
    answer += [Notice("error", f"{row['session']}: {row['problem']}") for row in broken]
    if (opened.page_folder / TREND_PAGE).is_file():
        answer.append(Link("Quantities over time", TREND_PAGE, "control charts, as of the last labpipe trend"))
    sections = [Section("Answer", answer)]
    for kind in dict.fromkeys(experiments["kind"]):
        own = experiments[experiments["kind"] == kind]
        title = KINDS[kind].title if kind in KINDS else kind or "Waiting"
        sections.append(Section(title, [_table(opened, kind, own)]))
    links = [
        Link(row["session"], href, ", ".join(str(row[n]) for n in ("title", "operator") if row[n]))
        for row in sessions.to_dict("records")
        if (href := opened.href(row["session"], SESSION_PAGE))
    ]
    sections += [Section("Sessions", links)] if links else []
    title = f"{opened.base.name}: all sessions"
    badge = SYNTHETIC if len(sessions) and (sessions["synthetic"] == 1).all() else ""
    return Document(title, "", badge, sections).render()


def _table(opened: Opened, kind: str, own: pd.DataFrame) -> Table:
    """List the experiments of a kind, the latest first."""
    own = own.sort_values("recorded", ascending=False, kind="stable", na_position="last")
    named = ["recorded", *(n for n in ("material", "height") if n in own and own[n].notna().any())]
    columns = [Listed(name, own[name].tolist(), own.attrs["units"].get(name, "")) for name in named]
    numbers = opened.select("results", f"stage = '{KEYS}'")
    for title in dict.fromkeys(numbers.loc[numbers["kind"] == kind, "variable"]):
        those = numbers.loc[numbers["variable"] == title, ["session", "experiment", "value", "u", "unit"]]
        found = own[["session", "experiment"]].merge(those, how="left")
        u = found["u"].tolist() if found["u"].notna().any() else None
        columns.append(Listed(title, found["value"].tolist(), those["unit"].iloc[0], u))
    entries: list[tuple[None, Link, Notice]] = []
    for row in own.to_dict("records"):
        is_judged = row["believable"] is not None
        state, level = judgement(row["believable"], row["model"]) if is_judged else (row["state"], "info")
        remark = row["session"] + (f": {row['cause']}" if row["cause"] else "")
        link = Link(row["experiment"], opened.href(row["session"], page_name(row["experiment"])), remark)
        entries.append((None, link, Notice(level, state)))  # type: ignore[arg-type]
    caption = "The latest first; select a heading to sort." if len(entries) > 1 else ""
    return experiments_table(entries, columns, caption)
