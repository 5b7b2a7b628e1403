"""The page of all experiments of many sessions."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from labpipe.report import Document, IndexRow, IndexTable, Level, Link, Listed, Notice, Section, listed
from labpipe.workflow.plan import page_name
from pipelines.experiments import KINDS
from pipelines.experiments.shared.pages import SYNTHETIC, counted
from pipelines.session._overview import PAGE as SESSION_PAGE

if TYPE_CHECKING:
    import pandas as pd

    from pipelines.session._catalogue_query import Opened

_TIED = "\N{NON-BREAKING HYPHEN}"
TREND_PAGE = "trend.html"
_LEVELS: dict[str, Level] = {"impossible": "error", "doubtful": "warning", "unknown": "info"}


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
    text += ", ".join(f"{int((experiments['model'] == word).sum())} {said}" for word, said in (
        ("agrees", "in which the model agrees"), ("differs", "in which it differs")))  # fmt: skip
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
    believable, model, name = row["believable"], row["model"], row["experiment"]
    if believable is None:
        state, level = row["state"], "info"
    else:
        state = "believable" if believable == "yes" else believable
        state += f", model {model}" if believable == "yes" and model != "none" else ""
        level = _LEVELS.get(believable, "warning" if model == "differs" else "ok")
    href = opened.href(row["session"], page_name(name))
    remark = row["session"] + (f": {row['cause']}" if row["cause"] else "")
    return IndexRow(name, state, level, href, metrics, remark=remark)  # type: ignore[arg-type]
