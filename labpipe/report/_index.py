"""The table on a session's page: every experiment with its state, key numbers and thumbnail."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any
from urllib.parse import quote

from labpipe.report._media import Level, check_inside, mime_type
from labpipe.report._tables import Cell, Column, HeadingView, Table, table_view


@dataclass(frozen=True)
class IndexRow:
    """One experiment on the session's page.

    Attributes
    ----------
    name : str
        The experiment.
    state : str
        "done", "failed", "waiting for files", ...
    level : {"ok", "info", "warning", "error"}
        How the state is coloured.
    href : str
        Path of its page relative to the index, with ``/``; empty when there is none.
    metrics : sequence of float, int, str, bool or None
        One cell for each metric column, numbers in SI.
    thumbnail : bytes or None
        A small PNG, JPEG or SVG file (:func:`labpipe.report.thumbnail`).
    remark : str
        A short line below the name (kind of experiment, or why it failed).

    Raises
    ------
    InputError
        `href` leaves the folder of the index, or `thumbnail` is no picture.
    """

    name: str
    state: str = "done"
    level: Level = "ok"
    href: str = ""
    metrics: Sequence[Cell] = ()
    thumbnail: bytes | None = None
    remark: str = ""

    def __post_init__(self) -> None:
        """Refuse addresses outside the folder of the index, and bytes that are no picture."""
        if self.href:
            check_inside(f'experiment "{self.name}"', self.href)
        if self.thumbnail is not None:
            mime_type(self.thumbnail)


@dataclass(frozen=True)
class IndexTable:
    """All experiments of a session; a block of the session's page.

    Attributes
    ----------
    columns : sequence of Column
        The metrics.
    rows : sequence of IndexRow
        One per experiment; each with one metric per column.
    caption : str
        Above the table.
    """

    columns: Sequence[Column]
    rows: Sequence[IndexRow]
    caption: str = ""


def index_view(table: IndexTable) -> tuple[tuple[HeadingView, ...], list[dict[str, Any]]]:
    """Return headings and rows ready for the page's template."""
    metrics = Table(tuple(table.columns), [row.metrics for row in table.rows], table.caption)
    view = table_view(metrics)
    headings = (HeadingView("Experiment", "", False), HeadingView("State", "", False))
    rows = [
        {
            "name": row.name,
            "href": quote(row.href),
            "state": row.state,
            "level": row.level,
            "remark": row.remark,
            "picture": row.thumbnail,
            "cells": cells,
        }
        for row, cells in zip(table.rows, view.rows, strict=True)
    ]
    return headings + view.headings, rows
