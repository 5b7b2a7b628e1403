"""Many session folders as one table of experiments, parameters and results.

The table is an SQLite database. It is made in memory and written whole, so that it is never half
there, and it can be thrown away: everything in it is in the sessions. A session is read again
only when its plan says that something changed. Conditions are asked of the database in memory.
"""

from __future__ import annotations

import hashlib
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
from labpipe.errors import InputError, LabpipeError, SourceError, UsageError
from labpipe.notebook import html_table
from labpipe.units import Quantity
from labpipe.workflow.fields import REFERENCE
from labpipe.workflow.plan import KEPT, READY, Plan
from labpipe.workflow.results import Results
from labpipe.workflow.session import FILE_NAME
from pipelines.experiments import JUDGEMENT, KINDS
from pipelines.experiments.shared.proposals import material_word
from pipelines.session._catalogue_page import CATALOGUE, PAGE, Opened, base_of, catalogue_page
from pipelines.session._processing import plan as plan_session
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
    "sessions": ("session", "title", "operator", "synthetic", "digest", "problem"),
    "columns": ("name", "unit"),
}  # fmt: skip
"""Tables and the columns that they always have; experiments have one more for each setting and key number.

``recorded`` is the first day of the recordings, ``record`` the calibration record by its ``id``, ``sensor`` what it
calibrates: instrument and serial number or, without a number, the name of the record's file without its date.
"""

CHECKS = "checks"
"""Stage of the results that are checks: observed over expected, under the name of the check."""

_APPLICATION = 0x6C706361  # "lpca": marks our databases
_LAYOUT = 4
"""Raised when the tables change; a catalogue of another layout is made anew."""
_LONGEST_RESULT = 64
"""Values of one variable that are listed; longer ones are curves, which ``export`` writes."""
_BODIES = ("sphere", "punch", "substrate")
"""Their fields have no name of a table before them: ``radius``, not ``sphere_radius``."""
_DATE = re.compile(r"[ _.-]*(19|20)\d\d([-_.]?\d\d){0,2}$")
_MOST_SHOWN = 60
"""Rows of a table in a notebook; the middle of a longer one is left out."""


@dataclass(frozen=True, eq=False, repr=False, slots=True)
class Catalogued:
    """What an update found; sessions are named relative to the database's folder.

    Attributes
    ----------
    path : Path
        The database.
    page : Path
        The page of all its experiments.
    renewed, unchanged, removed : tuple of str
        Sessions read again, left as they were, and gone from below the searched folders.
    problems : dict
        Sessions that cannot be read, with the reason; what was known of them is kept.
    """

    path: Path
    page: Path
    renewed: tuple[str, ...]
    unchanged: tuple[str, ...]
    removed: tuple[str, ...]
    problems: dict[str, str]
    table: pd.DataFrame = field(repr=False)

    def __repr__(self) -> str:
        return f"{self._caption}\n{self.table}"

    def _repr_html_(self) -> str:
        shown: str = self.table.to_html(max_rows=_MOST_SHOWN)
        return html_table(self._caption, (), ()) + shown

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
    """List the experiments of all sessions below some folders, one row each.

    The database is brought up to date first. Nothing is processed: of a session that is not, the
    parameters are listed.

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

    Raises
    ------
    UsageError
        The expression is not one, or names a column that is not there.
    SourceError
        The database is another program's file.
    StorageError
        It cannot be written.

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


@contextmanager
def open_catalogue(folders: str | Path | Iterable[str | Path], database: str | Path | None = None) -> Iterator[Opened]:
    """Bring the catalogue of all sessions below some folders, and its page, up to date; as :func:`catalogue`."""
    roots = [Path(folder).resolve() for folder in ([folders] if isinstance(folders, str | Path) else folders)]
    if not roots:
        raise InputError("no folder to search; give at least one")
    path = Path(database).resolve() if database is not None else roots[0] / CATALOGUE
    tables = _tables(path)
    done = _update(tables, roots, path)
    with closing(sqlite3.connect(":memory:")) as connection:
        for name, frame in tables.items():
            frame.to_sql(name, connection, index=False)
        connection.execute(f"PRAGMA application_id = {_APPLICATION}")
        connection.execute(f"PRAGMA user_version = {_LAYOUT}")
        opened = Opened(path, done, tables, connection)
        page = opened.page_folder / PAGE
        if done["renewed"] or done["removed"] or done["problems"] or not (path.exists() and page.exists()):
            files.write_bytes(path, connection.serialize())
            files.write_text(page, catalogue_page(opened))
        yield opened


def _tables(path: Path) -> dict[str, pd.DataFrame]:
    """Return the tables of a catalogue; empty ones where there is none, or it is damaged or of another layout."""
    import pandas as pd

    data = path.read_bytes() if path.exists() else None
    # application and layout are in the first bytes (sqlite.org/fileformat2.html, section 1.3)
    if data is not None and not (data.startswith(b"SQLite format 3\0") and int.from_bytes(data[68:72]) == _APPLICATION):
        hint = "Give another --database; this file is left as it is."
        raise SourceError(path, "not a catalogue of labpipe", hint=hint)
    if data is not None and int.from_bytes(data[60:64]) == _LAYOUT:
        with closing(sqlite3.connect(":memory:")) as connection, suppress(sqlite3.Error, pd.errors.DatabaseError):
            connection.deserialize(data)
            return {name: pd.read_sql_query(f"SELECT * FROM {name}", connection) for name in TABLES}  # noqa: S608
    return {name: pd.DataFrame(columns=list(columns), dtype=object) for name, columns in TABLES.items()}


def _sessions(roots: Iterable[Path]) -> Iterator[Path]:
    seen = set()
    for root in roots:
        for folder, names, file_names in os.walk(root):
            place = Path(folder)
            has_session = FILE_NAME in file_names
            # The results of labpipe hold no sessions, and there may be many of them.
            names[:] = sorted(n for n in names if not n.startswith(".") and not (has_session and n == "labpipe"))
            if has_session and place not in seen:
                seen.add(place)
                yield place


def _update(tables: dict[str, pd.DataFrame], roots: Sequence[Path], path: Path) -> dict[str, Any]:
    """Bring the tables up to date; return the sessions that were read again, unchanged, removed or broken."""
    import pandas as pd

    known = dict(zip(tables["sessions"]["session"], tables["sessions"]["digest"], strict=True))
    units = dict(zip(tables["columns"]["name"], tables["columns"]["unit"], strict=True))
    base = base_of(path)
    new: dict[str, list[dict[str, Any]]] = {name: [] for name in TABLES}
    renewed, unchanged = [], []
    problems: dict[str, str] = {}
    for folder in _sessions(roots):
        name = files.relative(folder, base)
        try:
            plan = plan_session(folder, keep=True)  # years of sessions outlive the code that processed them
        except LabpipeError as error:
            problems[name] = str(error)
            continue
        if known.get(name) == (digest := _digest(plan)):
            unchanged.append(name)
            continue
        session = plan.session
        head = {"session": name, "title": session.title, "operator": session.operator}
        new["sessions"].append({**head, "synthetic": int(session.synthetic), "digest": digest})
        _add(new, units, name, plan)
        renewed.append(name)
    below = [files.relative(root, base) for root in roots]
    found = {*renewed, *unchanged, *problems}
    gone = [
        name
        for name in known
        if name not in found
        and any(name.startswith(f"{root}/") or name == root or (root == "." and name[:3] != "../") for root in below)
    ]
    kept: dict[str, Any] = {row["session"]: row for row in tables["sessions"].to_dict("records")}
    # the rest that is known of a session that cannot be read is kept
    new["sessions"] += [kept.get(n, {"session": n}) | {"digest": None, "problem": why} for n, why in problems.items()]
    stale = {*renewed, *gone}
    for name in ("experiments", "results", "sessions") if stale or problems else ():
        left_out = stale | problems.keys() if name == "sessions" else stale
        rows: list[Any] = [row for row in tables[name].to_dict("records") if row["session"] not in left_out]
        rows += new[name]
        columns = dict.fromkeys((*TABLES[name], *(title for row in rows for title in row)))
        tables[name] = pd.DataFrame(rows, columns=list(columns))
    tables["columns"] = pd.DataFrame(list(units.items()), columns=list(TABLES["columns"]))
    return {"renewed": tuple(renewed), "unchanged": tuple(unchanged), "removed": tuple(gone),
            "problems": problems}  # fmt: skip


def _digest(plan: Plan) -> str:
    session = plan.session
    # findings name lines, so that a line more is a change
    settings = {n: [msgspec.to_builtins(e.settings), dict(e.lines)] for n, e in session.experiments.items()}
    states = [[*row.task, row.state, plan.keys[row.task].value] for row in plan.rows]
    document = [session.title, session.operator, session.synthetic, settings, states, session.waiting]
    return hashlib.sha256(files.canonical(document).encode("utf-8", "replace")).hexdigest()


def _add(new: dict[str, list[dict[str, Any]]], units: dict[str, str], name: str, plan: Plan) -> None:
    """Add the experiments of a session and their short results."""
    session, results = plan.session, Results(plan)
    verdicts = stored_verdicts(results)
    for experiment in session.without_variants().experiments.values():
        rows = [row for row in plan.rows if row.experiment == experiment.name]
        waiting = sum(row.state not in READY for row in rows)
        kept = sum(row.state == KEPT for row in rows)
        state = f"{waiting} of {len(rows)} steps to do" if waiting else "done"
        state += f", {kept} results of earlier code" if kept else ""
        entry = _Entry({"session": name, "experiment": experiment.name, "kind": experiment.kind, "state": state})
        entry.cells["operator"] = session.operator
        entry.add_verdict(verdicts.get(experiment.name))
        entry.add_settings((), experiment.settings)
        for row in rows:
            dataset = results.up_to_date(row)
            if dataset is None:
                continue
            entry.add_key_numbers(experiment.kind, row.stage, dataset)
            entry.add_calibration(dataset)
            label = (name, experiment.name, row.stage, row.recording)
            numbers = [(*label, *v) for v in _values(dataset)]
            if JUDGEMENT in dataset.attrs:
                numbers += [(name, experiment.name, CHECKS, *v) for v in _ratios(dataset.attrs[JUDGEMENT])]
            new["results"] += [dict(zip(TABLES["results"], n, strict=True)) for n in numbers]
        new["experiments"].append(entry.row(units))
    for one in waiting_verdicts(session).values():
        entry = _Entry({"session": name, "experiment": one.experiment, "kind": one.kind, "state": one.state})
        entry.add_verdict(one)
        new["experiments"].append(entry.row(units))


def _ratios(judgement: str) -> Iterator[tuple[str, str, int, float, float, str]]:
    """Yield observed over expected of the checks that compare two sizes: recording, name, and as of a variable."""
    import numpy as np

    from labpipe.judging import from_json

    for i, check in enumerate(from_json(judgement).checks):
        if np.isfinite(check.log_ratio) and np.isfinite(check.u_log_ratio):
            ratio = float(np.exp(check.log_ratio))
            yield check.recording, check.name, i, ratio, ratio * check.u_log_ratio, "1"


def _values(dataset: xr.Dataset) -> Iterator[tuple[str, int, float, float | None, str]]:
    """Yield numbers of short variables: name, position, value, standard uncertainty, unit."""
    import numpy as np

    for name, variable in dataset.data_vars.items():
        text = str(name)
        if variable.size > _LONGEST_RESULT or variable.dtype.kind not in "fiub":
            continue
        if text.startswith("u_") and text[2:] in dataset:
            continue
        u = dataset.get(f"u_{text}")
        for i, value in enumerate(np.ravel(variable.values)):
            if np.isfinite(value):
                own_u = None if u is None or u.size != variable.size else float(np.ravel(u.values)[i])
                yield text, i, float(value), own_u, str(variable.attrs.get("units", ""))


@dataclass(slots=True)
class _Entry:
    """One row of the table of experiments while it is gathered."""

    cells: dict[str, Any]
    units: dict[str, str] = field(default_factory=dict)

    def add_verdict(self, verdict: Verdict | None) -> None:
        """Add the findings, the worst first; none of an experiment that was not judged."""
        if verdict is None:
            return
        lines = []
        for f in verdict.findings:
            place = f.file if f.line is None else f"{f.file}:{f.line}"
            lines.append(f"{f.level}: {f.message}" + (f" ({place})" if f.file else ""))
        cause = verdict.cause or next((f.cause for f in verdict.findings if f.cause), "")
        self.cells |= {"believable": verdict.believable, "model": verdict.model, "checks": verdict.checks,
                       "findings": "; ".join(lines), "cause": cause}  # fmt: skip

    def add_settings(self, path: tuple[str, ...], value: Any) -> None:
        """Add a setting or, for a table of settings, all in it."""
        if isinstance(value, msgspec.Struct):
            for name in value.__struct_fields__:
                self.add_settings((*path, name), getattr(value, name))
            return
        name = "_".join(path[1:] if len(path) > 1 and path[0] in _BODIES else path)
        if value is None or name == "kind":
            return
        if isinstance(value, Quantity):
            self.add_number(name, value.value, value.u or None, value.si)
        elif isinstance(value, bool | int | float | str):
            self.cells[name] = value
        else:
            self.cells[name] = files.canonical(msgspec.to_builtins(value))

    def add_key_numbers(self, kind: str, stage: str, dataset: xr.Dataset) -> None:
        """Add the numbers that the session's page shows of this kind of experiment."""
        for number in KINDS[kind].key_numbers:
            if number.stage == stage and (found := number.within(dataset)) is not None:
                self.add_number(number.title.replace(" ", "_"), *found, number.unit)

    def add_calibration(self, dataset: xr.Dataset) -> None:
        """Add the day of a recording, and the record that its sensor was calibrated with."""
        found = json.loads(dataset.attrs.get("calibration") or "{}")
        if not isinstance(found, dict):  # why there is none
            found = {"recorded_day": str(dataset.attrs.get("start", ""))[:10]}
        days = (found.get("stated_day") or found.get("recorded_day"), self.cells.get("recorded"))
        if known := sorted(filter(None, days)):
            self.cells["recorded"] = known[0]
        if "id" not in found:
            return
        places = [v for n, v in self.cells.items() if n.endswith(("calibration", "_record"))]
        name = found["serial"] or _DATE.sub("", next((Path(str(place)).stem for place in places), ""))
        sensor = f"{found['instrument']} {name}".strip()
        self.cells |= {"record": found["id"], "sensor": sensor}

    def add_number(self, name: str, value: float, u: float | None, unit: str) -> None:
        """Add a value, and its standard uncertainty under ``u_`` and the same name."""
        for title, one in ((name, value), (f"u_{name}", u)):
            if one is not None:
                self.cells.setdefault(title, one)
                self.units[title] = unit

    def row(self, units: dict[str, str]) -> dict[str, Any]:
        """Return the row; units of new columns are added to those that are known.

        Every experiment on a polymer has the column ``material``, wherever its moduli come from: of a DMA
        experiment or a file it is the polymer that its name contains, or else that name.
        """
        source = self.cells.get("material_from") or self.cells.get("material_file")
        if source is not None:
            name = str(source).removeprefix(REFERENCE)
            self.cells.setdefault("material", material_word(name) or name)
        made = {}
        for name, value in self.cells.items():
            unit = self.units.get(name, "")
            # The same word for two quantities, in kinds that know nothing of each other.
            title = name if units.get(name, unit) == unit else f"{self.cells['kind']}_{name}"
            units.setdefault(title, unit)
            made[title] = value
        return made
