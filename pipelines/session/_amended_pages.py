"""Findings of the session as a whole, added to the page of the experiment that they concern.

A page is a result of its experiment and knows no other. Findings beyond it are added where the page
is shown, so that it agrees with the command, the index, the catalogue and JSON; the stored page
stays as it is, and comes back when the finding goes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from labpipe import files
from labpipe.workflow.code import behind
from labpipe.workflow.plan import READY, page_name
from labpipe.workflow.results import Results
from labpipe.workflow.store import AMENDED, Store

if TYPE_CHECKING:
    from pipelines.session._verdicts import Verdict

_BY_ITSELF = "By what it records alone: "


def amend_pages(results: Results, verdicts: Mapping[str, Verdict]) -> None:
    """Let the pages of all experiments say what their verdicts say, those that are up to date."""
    store = Store(results.plan.session.folder)
    known = store.amended()
    if not known and not any(one.findings for one in verdicts.values()):
        return
    code = behind(f"{__name__}:{_amended.__name__}", is_page=True).digest
    kept = {name: entry for name, entry in known.items() if name not in verdicts and name in results.experiments}
    for name, one in verdicts.items():
        path = store.folder / page_name(name)
        if not path.is_file() or not (one.findings or name in known):
            continue
        key, before = _key(results, name), known.get(name, {})
        told = [[f.level, f.message, f.cause, f.place] for f in one.findings]
        mark = [key, code, told]
        if before.get("mark") != mark or before["digest"] != store.index.digest(path):
            page = path.read_text("utf-8") if key is None else str(store.read(key))
            files.write_text(path, _amended(page, one))
            before = {"key": key, "mark": mark, "digest": files.digest(path)}
        if told:
            kept[name] = before
    if kept != known:
        files.write_bytes(store.root / AMENDED, files.seal(kept))


def _key(results: Results, name: str) -> str | None:
    """Return the key of a page that is a result; that of an experiment that failed is made again in every run."""
    plan = results.plan
    rows = (r for r in plan.rows if r.experiment == name and plan.tasks[r.task].stage.output == "page")
    row = next((r for r in rows if r.state in READY), None)
    return None if row is None else plan.keys[row.task].value


def _amended(page: str, one: Verdict) -> str:
    from markupsafe import escape

    from labpipe.report import Notice, amended
    from pipelines.experiments.shared.judgements import VERDICT, capitalised, with_minus, written_place
    from pipelines.session._verdict_notices import LEVELS, as_sentence

    for finding in one.own:
        if finding.setting and finding.place:
            for stored in {written_place(replace(finding, line=None, value="", file=f)) for f in (finding.file, "")}:
                page = page.replace(f">{escape(stored)}</td>", f">{escape(finding.place)}</td>")
    if not one.of_session:
        return page
    notices = []
    for found in one.of_session:
        level: Any = LEVELS.get(found.level, "info")
        place = f" ({found.place})" if found.place else ""
        cause = f" {as_sentence(found.cause)}" if found.cause else ""
        text = f"{found.message.rstrip('.')}{place}.{cause}"  # a notice that is one is called so
        told = text if found.level == "note" else f"{capitalised(found.level)}: {text}"
        notices.append(Notice(level, with_minus(told)))
    is_by_session = one.believable != "yes" and not any(f.level == one.believable for f in one.own)
    return amended(page, VERDICT, notices, aside=_BY_ITSELF if is_by_session else "")
