"""The page of a session, as small as it gets."""

from collections.abc import Sequence

from labpipe.report import Column, Document, IndexRow, IndexTable, Section


def index_page(
    title: str,
    rows: Sequence[IndexRow],
    columns: Sequence[Column] = (),
    *,
    subtitle: str = "",
    badge: str = "",
    caption: str = "",
) -> str:
    table = IndexTable(tuple(columns), tuple(rows), caption)
    return Document(title, subtitle, badge, (Section("Experiments", (table,)),)).render()
