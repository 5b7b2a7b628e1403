"""A catalogue that is up to date: what may be asked of it, where its pages lie, and the page of all its experiments."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from labpipe import files
from labpipe.errors import UsageError
from labpipe.report import Document, IndexRow, IndexTable, Level, Link, Listed, Notice, Section, listed
from labpipe.workflow.fields import suggest
from labpipe.workflow.plan import page_name
from labpipe.workflow.session import FILE_NAME
from pipelines.experiments import KINDS, KeyNumber
from pipelines.experiments.shared.pages import SYNTHETIC, counted
from pipelines.session._overview import PAGE as SESSION_PAGE
from pipelines.session._verdict_notices import judgement

if TYPE_CHECKING:
    import pandas as pd


_TIED = "\N{NON-BREAKING HYPHEN}"
CATALOGUE = "labpipe/catalogue.sqlite"
PAGE, TREND_PAGE = "catalogue.html", "trend.html"
"""In the folder that holds the sessions, or in the ``labpipe`` folder of a session itself."""


@dataclass(frozen=True, eq=False, slots=True)
class Opened:
    """A catalogue that is up to date.

    Attributes
    ----------
    path : Path
        The database.
    done : dict
        Sessions by what became of them, as attributes of :class:`Catalogued`.
    tables : dict of DataFrame
    connection : Connection
        To a copy in memory, of which anything may be asked.
    """

    path: Path
    done: dict[str, Any]
    tables: dict[str, pd.DataFrame]
    connection: sqlite3.Connection

    @property
    def base(self) -> Path:
        """Folder from which the names of sessions start."""
        return base_of(self.path)

    @property
    def page_folder(self) -> Path:
        """Folder of pages about the sessions: the one that holds them, or ``labpipe`` where it is a session itself."""
        return self.base / "labpipe" if (self.base / FILE_NAME).is_file() else self.base

    def href(self, session: str, page: str) -> str:
        """Return the way from a page about the sessions to one of a session; "" where there is none below."""
        target = files.relative(self.base / session / "labpipe" / page, self.page_folder)
        return target if (self.page_folder / target).is_file() and not target.startswith("..") else ""

    def number(self, frame: pd.DataFrame, kind: str, key: KeyNumber) -> tuple[pd.Series, pd.Series]:
        """Return a key number of the experiments of a kind and its standard uncertainty, NaN where it is not known."""
        import pandas as pd

        name, units = key.title.replace(" ", "_"), frame.attrs["units"]
        name = name if units.get(name, "") == key.unit or (key.unit == "1" and name in frame) else f"{kind}_{name}"
        columns = (frame[n] if n in frame else pd.Series(float("nan"), frame.index) for n in (name, f"u_{name}"))
        value, u = (pd.to_numeric(column, errors="coerce") for column in columns)
        return value, u

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
            raise UsageError(f"--where {where!r}: {error}; the columns are {', '.join(known)}") from error
        frame = pd.DataFrame(rows, columns=list(columns) or known)
        units = dict(zip(self.tables["columns"]["name"], self.tables["columns"]["unit"], strict=True))
        frame.attrs["units"] = {name: units[name] for name in frame.columns if units.get(name)}
        return frame


def base_of(path: Path) -> Path:
    """Return the folder of a catalogue, or the one that holds its ``labpipe/``."""
    return path.parents[1] if path.parts[-2:] == Path(CATALOGUE).parts else path.parent


def catalogue_page(opened: Opened) -> str:
    """Write the page: every experiment by kind with its verdict and key numbers, and a way to its own page."""
    experiments, sessions = opened.select("experiments"), opened.select("sessions")
    experiments = experiments.astype(object).where(experiments.notna(), None)
    sections = [Section("Answer", list(_answer(opened, experiments, sessions)))]
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


def _answer(opened: Opened, experiments: pd.DataFrame, sessions: pd.DataFrame) -> Iterator[Notice | Link]:
    n = len(experiments)
    sure, bad = (int((experiments["believable"] == word).sum()) for word in ("yes", "impossible"))
    text = f"{counted(len(sessions), 'session')} with {counted(n, 'experiment')}: {sure} believable, "
    models = {word: int((experiments["model"] == word).sum()) for word in ("agrees", "differs")}
    text += f"{models['agrees']} in which the model agrees"
    text += f", {models['differs']} in which it differs" if models["differs"] else ""
    yield Notice("error" if bad else "ok" if sure == n else "info", f"{text}.")
    for row in sessions[sessions["problem"].notna()].to_dict("records"):
        yield Notice("error", f"{row['session']}: {row['problem']}")
    if (opened.page_folder / TREND_PAGE).is_file():
        yield Link("Quantities over time", TREND_PAGE, "control charts, as of the last labpipe trend")


def _table(opened: Opened, kind: str, own: pd.DataFrame) -> IndexTable:
    """List the experiments of a kind, the latest first."""
    own = own.sort_values("recorded", ascending=False, kind="stable", na_position="last")
    named = ["recorded", *(n for n in ("material", "height") if n in own and own[n].notna().any())]
    own = own.assign(recorded=[day and day.replace("-", _TIED) for day in own["recorded"]])
    columns = [Listed(name, own[name].tolist(), own.attrs["units"].get(name, "")) for name in named]
    for key in KINDS[kind].key_numbers if kind in KINDS else ():
        value, u = opened.number(own, kind, key)
        if value.notna().any():
            columns.append(Listed(key.title, value.tolist(), key.unit, u.tolist() if u.notna().any() else None))
    table = listed(columns)
    rows = [_row(opened, row, metrics) for row, metrics in zip(own.to_dict("records"), table.rows, strict=True)]
    return IndexTable(table.columns, rows, "The latest first; select a heading to sort." if len(rows) > 1 else "")


def _row(opened: Opened, row: dict[Any, Any], metrics: Any) -> IndexRow:
    name, state = row["experiment"], row["state"]
    level: Level = "info"
    if row["believable"] is not None:
        state, level = judgement(row["believable"], row["model"])
    href = opened.href(row["session"], page_name(name))
    remark = row["session"] + (f": {row['cause']}" if row["cause"] else "")
    return IndexRow(name, state, level, href, metrics, remark=remark)
