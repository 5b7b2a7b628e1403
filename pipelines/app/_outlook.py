"""Outlook of a run, by experiment: number of steps and reasons, waiting and failed ones."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from labpipe.errors import LabpipeError
from labpipe.workflow import events
from labpipe.workflow.plan import READY, page_name
from pipelines.experiments import KINDS
from pipelines.session import Surveyed, plan

_RECORDINGS = ("displacement", "force", "film", "sweep")


def outlook(folder: Path, surveyed: Iterable[Surveyed]) -> dict[str, Any]:
    """Return the outlook of a run of a session; nothing is computed.

    It is ``summary``, ``known`` (whether it is known how long it takes), ``experiments`` in the order of a run,
    ``problem`` where nothing can run before session.toml is corrected, and ``unused``, surveyed files that no
    experiment uses.
    """
    unused = [each.name for each in surveyed if each.content in _RECORDINGS and not each.used_by and not each.copy_of]
    told: dict[str, Any] = {"summary": "", "known": True, "experiments": [], "problem": "", "unused": unused}
    try:
        made = plan(folder)
    except LabpipeError as error:
        return told | {"problem": str(error)}
    session, failed = made.session, dict[str, dict[tuple[Any, Any], str]]()  # of the last run of every step
    for event in (one for one in events(session) if one.get("event") == "ended"):
        own_failures = failed.setdefault(str(event.get("experiment")), {})
        step = event.get("stage"), event.get("recording")
        own_failures.pop(step, None)
        if event.get("state") == "failed":
            own_failures[step] = f"{event.get('stage')}: {event.get('message')}"
    empty = {"title": "", "steps": 0, "to_run": 0, "why": "", "what": [], "failed": "", "waits": [], "page": False}
    cards = []
    for name, rows in itertools.groupby(made.rows, key=lambda row: row.experiment):
        own = list(rows)
        open_ = [row for row in own if row.state not in READY]
        card = {"name": name, "title": KINDS[session.experiments[name].kind].title, "steps": len(own)}
        card |= {"to_run": len(open_), "page": (session.folder / page_name(name)).is_file()}
        if open_:
            what = list(dict.fromkeys(row.summary for row in open_))
            card |= {"why": open_[0].reason, "what": what, "failed": next(iter(failed.get(name, {}).values()), "")}
        cards.append(empty | card)
    cards += [empty | {"name": n, "waits": shortened(n, lines)} for n, lines in session.waiting.items()]
    return told | {"summary": made.summary, "known": bool(made.estimate or not made.to_run), "experiments": cards}


def shortened(experiment: str, lines: Iterable[str]) -> list[str]:
    """Say in few words which lines of an experiment wait; its card says whose they are.

    Examples
    --------
    >>> shortened("a", ['session.toml:19: experiments.a.sphere.mass: to be filled in: a mass such as "28.2 g"'])
    ['session.toml:19: sphere.mass']
    """
    return [line.partition(": to be filled in")[0].replace(f" experiments.{experiment}.", " ", 1) for line in lines]
