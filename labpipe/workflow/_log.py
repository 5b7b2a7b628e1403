"""``run.jsonl``: what the runs of a session did, and when; the only place with times."""

import json
from collections.abc import Iterator
from typing import Any

from labpipe.workflow.session import Session
from labpipe.workflow.tasks import TaskId

LOG = "run.jsonl"


def events(session: Session) -> Iterator[dict[str, Any]]:
    """Go through the log of all runs; lines that a kill left incomplete are passed over."""
    for line in _lines(session):
        try:
            event = json.loads(line)
        except ValueError:
            continue
        if isinstance(event, dict):
            yield event


def last_seconds(session: Session) -> dict[TaskId, float]:
    """Return how long every step took when it was last computed, on the clock."""
    found = {}
    for line in _lines(session):
        if '"state": "done"' in line:  # most lines tell of what was there already
            try:
                event = json.loads(line)
                task = TaskId(event["experiment"], event["stage"], event["recording"])
                found[task] = float(event["seconds"])
            except (ValueError, KeyError, TypeError):
                continue
    return found


def _lines(session: Session) -> list[str]:
    path = session.folder / LOG
    return path.read_text("utf-8", errors="replace").splitlines() if path.is_file() else []
