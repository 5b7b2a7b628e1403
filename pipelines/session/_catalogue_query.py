"""A catalogue that is up to date: what may be asked of it, and where its pages lie."""

from __future__ import annotations

import os
import sqlite3
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from labpipe.errors import UsageError
from labpipe.workflow.fields import suggest
from labpipe.workflow.session import FILE_NAME
from pipelines.experiments import KeyNumber

if TYPE_CHECKING:
    import pandas as pd

CATALOGUE = "labpipe/catalogue.sqlite"
PAGE = "catalogue.html"
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
        target = relative(self.base / session / "labpipe" / page, self.page_folder)
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


def relative(folder: Path, start: Path) -> str:
    try:
        return Path(os.path.relpath(folder, start)).as_posix()
    except ValueError:  # another drive
        return folder.as_posix()
