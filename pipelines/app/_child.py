"""The process that computes for the page: events go out as lines of JSON, the end of input stops it."""

import json
import os
import signal
import sys
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from labpipe.errors import LabpipeError

if TYPE_CHECKING:
    from labpipe.workflow.results import Event

_INTERRUPTED = 130


def main(mode: str, folder: Path, seconds: float = 2.0) -> int:
    """Process a session, or watch it by looks so far apart, and report each event; return an exit code."""
    threading.Thread(target=_end_with_the_page, daemon=True).start()
    try:
        if mode != "watch":
            return _processed(folder)
        from pipelines.session import verdict_on, watch

        watcher = watch(folder, jobs=1)
        while True:
            for news in watcher.look():
                _tell(kind="news", experiment=news.experiment, state=news.state, message=news.text)
                if news.state == "processed":
                    _tell_verdict(verdict_on(folder, news.experiment))
            time.sleep(seconds)
    except KeyboardInterrupt:
        _tell(kind="stopped", message="stopped; results that were complete are kept")
        return _INTERRUPTED
    except LabpipeError as error:
        _tell(kind="refused", message=str(error))
        return error.exit_code


def _end_with_the_page() -> None:
    """Interrupt the run when the input ends: the page said stop, or is gone."""
    while sys.stdin.readline():
        pass
    os.kill(os.getpid(), signal.SIGINT)


def _tell_verdict(found: Any) -> None:
    _tell(**found.document() | {"of": found.kind, "kind": "verdict"})


def _tell(**event: Any) -> None:
    print(json.dumps(event), flush=True)  # noqa: T201 (the events are what this process is for)


def _processed(folder: Path) -> int:
    from labpipe.workflow.engines import processors
    from pipelines.app._outlook import shortened
    from pipelines.experiments import JUDGEMENT
    from pipelines.session import process, verdict_on, verdicts_of

    def progress(event: "Event") -> None:
        task, so_far = event.task, {"done": event.done, "total": event.total, "message": event.message}
        _tell(kind=event.kind, experiment=task.experiment, stage=task.stage, recording=task.recording, **so_far)
        if event.task.stage == JUDGEMENT and event.kind in ("done", "cached", "kept"):
            _tell_verdict(verdict_on(folder, event.task.experiment, is_running=True))

    outcome = process(folder, jobs=max(1, min(processors(), 4)), progress=progress)
    for one in verdicts_of(outcome).experiments:  # those that failed, and what the session as a whole tells
        if one.state != "waiting":  # told next
            _tell_verdict(one)
    for name, lines in outcome.session.waiting.items():
        _tell(kind="waiting", experiment=name, message="\n".join(shortened(name, lines)))
    _tell(kind="finished", message=outcome.summary, reports=sorted(outcome.reports))
    return outcome.exit_code


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], Path(sys.argv[2])))
