"""One process per experiment, a few at a time; a process that dies takes only its task with it.

The processes are forked from a server that has the numerical libraries loaded and runs them on
one thread each, so that a result does not depend on how many processors there are.
"""

import multiprocessing
import os
import signal
import sys
from collections.abc import Sequence
from multiprocessing import connection
from typing import Any

from labpipe.workflow.processes import (
    ENVIRONMENT,
    METHOD,
    PATIENCE,
    Died,
    clean_start,
    die_with_parent,
    end,
)
from labpipe.workflow.tasks import TaskId
from labpipe.workflow.worker import Job, run_job

PRELOADED = ("numpy", "xarray", "netCDF4", "labpipe.netcdf", "labpipe.workflow.worker")
"""What every worker needs."""

PRELOADED_TO_DRAW = (
    "jinja2",
    "matplotlib.figure",
    "matplotlib.backends.backend_svg",
    "matplotlib.backends.backend_agg",
    "labpipe.report._document",
    "labpipe.report._pictures",
)
"""What workers need that write pages: loaded once, not once for every experiment."""


class Worker:
    """A process that computes one job and tells what happens."""

    def __init__(self, job: Job, preload: Sequence[str]) -> None:
        self.job = job
        self.current: TaskId | None = None
        context: Any = multiprocessing.get_context(METHOD)
        if METHOD == "forkserver":
            context.set_forkserver_preload([*PRELOADED, *preload])
        self.receiver, sender = context.Pipe(duplex=False)
        self.process = context.Process(target=_work, args=(job, sender), daemon=True)
        with clean_start():
            self.process.start()
        sender.close()

    def receive(self) -> tuple[str, Any] | None:
        """Return the next event, or None when the job is finished.

        Raises
        ------
        Died
            The process ended before its job did; the message says how.
        """
        try:
            event: tuple[str, Any] = self.receiver.recv()
        except (EOFError, OSError):
            self.process.join(PATIENCE)
            raise Died(_how(self.process.exitcode)) from None
        return None if event[0] == "finished" else event

    def stop(self) -> None:
        """End the process; what it was writing never comes to exist."""
        end(self.process)
        self.receiver.close()


def wait(workers: Sequence[Worker]) -> list[Worker]:
    """Wait until at least one worker has something to tell."""
    ready = connection.wait([worker.receiver for worker in workers])
    return [worker for worker in workers if worker.receiver in ready]


def _how(code: int | None) -> str:
    if code is not None and code < 0:
        name = signal.Signals(-code).name
        hint = "; was the memory full?" if -code == 9 else ""
        return f"its process was ended by {name}{hint}"
    return f"its process ended with code {code}"


def _work(job: Job, sender: connection.Connection) -> None:
    """Body of the process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent decides when to stop
    os.environ.update(ENVIRONMENT)
    # Standard output belongs to the command; what a stage or a library prints goes to the errors.
    os.dup2(sys.__stderr__.fileno() if sys.__stderr__ else 2, 1)
    die_with_parent()
    run_job(job, lambda name, value: sender.send((name, value)))
    sender.send(("finished", None))
    sender.close()
