"""The page of a session, as small as it gets."""

from collections.abc import Sequence

from labpipe.report import Cell, Column, Document, Level, Link, Notice, Picture, Section, Table


def index_row(
    name: str,
    *metrics: Cell,
    state: str = "done",
    level: Level = "ok",
    href: str = "",
    picture: bytes | None = None,
    remark: str = "",
) -> tuple[Cell, ...]:
    shown = None if picture is None else Picture(picture, "")
    return shown, Link(name, href, remark), Notice(level, state), *metrics


def index_page(
    title: str,
    rows: Sequence[Sequence[Cell]],
    columns: Sequence[Column] = (),
    *,
    subtitle: str = "",
    badge: str = "",
    caption: str = "",
) -> str:
    heads = (*map(Column, ("", "Experiment", "State")), *columns)
    table = Table(heads, tuple(rows), caption, sortable=len(rows) > 1)
    return Document(title, subtitle, badge, (Section("Experiments", (table,)),)).render()
