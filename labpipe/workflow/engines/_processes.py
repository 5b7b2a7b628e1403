"""Local processes; one that dies is replaced.

They are forked from a server that has loaded the numerical libraries. They share no queue and no
lock that a dead one could keep: each has a pipe of its own.
"""

import contextlib
import multiprocessing
import os
import signal
import sys
import threading
import traceback
import types
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from multiprocessing import connection
from typing import Any, cast

from labpipe.errors import InputError
from labpipe.workflow.engines._calls import Call, Crew, Died, Tell

_ENVIRONMENT = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "VECLIB_MAXIMUM_THREADS": "1",
    "NUMBA_NUM_THREADS": "1",
    "OPENCV_FOR_THREADS_NUM": "1",
    "MPLBACKEND": "Agg",
}
"""Of every worker."""

_METHOD = "forkserver" if "forkserver" in multiprocessing.get_all_start_methods() else "spawn"
"""How processes begin; never a fork of this one, which may run threads."""

_PATIENCE = 5.0
"""Seconds that a process gets to end after it was asked to."""

_TOLD, _DONE, _RAISED = "told", "done", "raised"


def processors() -> int:
    """Count the processors that this process may use, not those that the machine has."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@dataclass(frozen=True, slots=True)
class Processes:
    """Local processes; 0 are as many as there are processors.

    Raises
    ------
    InputError
        There are fewer than none.
    """

    workers: int = 0

    def __post_init__(self) -> None:
        """Refuse a number that is none."""
        if self.workers < 0:
            raise InputError(f"jobs must be at least 0, found {self.workers}")

    @contextlib.contextmanager
    def crew(self) -> Iterator[Crew]:
        """See :class:`Engine`; processes begin when they are needed."""
        crew = _Crew(self.workers or processors())
        try:
            yield crew
        finally:
            crew.end()


def load_ahead(imports: Sequence[str]) -> None:
    """Have the server of local processes load modules from now on, beside what this process goes on to do.

    What it loads for the first of all processes counts for all; see :class:`Call`.
    """
    if _METHOD == "forkserver":
        from multiprocessing.forkserver import ensure_running, set_forkserver_preload

        set_forkserver_preload(list(imports))
        with _clean_start():
            ensure_running()


@contextlib.contextmanager
def alongside(call: Call) -> Iterator[None]:
    """Let a process compute a call during a block, for what it leaves behind; its answer is lost."""
    worker = _Worker(call.imports)
    try:
        worker.take(call)
        yield
    finally:
        worker.stop()


def elsewhere(call: Call) -> Any:
    """Return what a call gives in a local process, which has loaded what this one need not load.

    Raises
    ------
    Died
        The process ended first. What the call raises is raised.
    """
    worker = _Worker(call.imports)
    try:
        worker.take(call)
        what, value = worker.answer()
    finally:
        worker.stop()
    if what == _RAISED:
        raise value
    return value


@dataclass(slots=True)
class _Crew:
    """See :class:`Crew`."""

    size: int
    idle: "list[_Worker]" = field(default_factory=list)
    busy: "dict[connection.Connection, tuple[_Worker, Any, Tell]]" = field(default_factory=dict)

    @property
    def room(self) -> int:
        return self.size - len(self.busy)

    def give(self, key: Any, call: Call, hear: Tell) -> None:
        worker = self.idle.pop() if self.idle else _Worker(call.imports)
        if not worker.take(call):  # died with nothing to do: nobody's fault
            worker.stop()
            worker = _Worker(call.imports)
            worker.take(call)
        self.busy[worker.pipe] = worker, key, hear

    def ended(self) -> Sequence[tuple[Any, Any]]:
        ended: list[tuple[Any, Any]] = []
        for pipe in connection.wait(list(self.busy)):
            worker, key, hear = self.busy[cast(connection.Connection, pipe)]
            try:
                what, value = worker.answer()
            except Died as death:
                del self.busy[worker.pipe]
                worker.stop()
                ended.append((key, death))
                continue
            if what == _TOLD:
                hear(value)
                continue
            del self.busy[worker.pipe]
            self.idle.append(worker)
            if what == _RAISED:
                raise value
            ended.append((key, value))
        return ended

    def end(self) -> None:
        """End all processes; what they were computing never comes to exist."""
        workers = [*self.idle, *(worker for worker, _, _ in self.busy.values())]
        for worker in workers:
            worker.process.terminate()
        for worker in workers:
            worker.stop()


class _Worker:
    """A process that computes one call after another."""

    def __init__(self, imports: Sequence[str]) -> None:
        context: Any = multiprocessing.get_context(_METHOD)
        if _METHOD == "forkserver":
            context.set_forkserver_preload(list(imports))
        self.pipe, its_end = context.Pipe()
        self.process = context.Process(target=_serve, args=(its_end,), daemon=True)
        with _clean_start():
            self.process.start()
        its_end.close()  # so that its death closes the pipe

    def take(self, call: Call) -> bool:
        """Hand out a call; False where nobody is there to take it."""
        try:
            self.pipe.send(call)
        except OSError:
            return False
        return True

    def answer(self) -> tuple[str, Any]:
        """Return what the call tells, gives or raises.

        Raises
        ------
        Died
            The process ended first; the message says how.
        """
        try:
            answer: tuple[str, Any] = self.pipe.recv()
        except (EOFError, OSError):
            self.process.join(_PATIENCE)
            raise Died(_how(self.process.exitcode)) from None
        return answer

    def stop(self) -> None:
        """End the process, by force where it does not answer."""
        self.process.terminate()
        self.process.join(_PATIENCE)
        if self.process.is_alive():
            self.process.kill()
            self.process.join()
        self.pipe.close()


def _how(code: int | None) -> str:
    if code is not None and code < 0:
        name = signal.Signals(-code).name
        hint = "; was the memory full?" if -code == 9 else ""
        return f"its process was ended by {name}{hint}"
    return f"its process ended with code {code}"


# --- in the worker -----------------------------------------------------------------------------


def _serve(pipe: connection.Connection) -> None:
    """Body of a worker."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent decides when to stop
    os.environ.update(_ENVIRONMENT)
    # Standard output belongs to the command; what a call or a library prints goes to the errors.
    os.dup2(sys.__stderr__.fileno() if sys.__stderr__ else 2, 1)
    _die_with_parent()
    with contextlib.suppress(EOFError, OSError):  # the parent is done with us
        while True:
            call: Call = pipe.recv()
            answer: tuple[str, Any]
            try:
                answer = _DONE, call.run(lambda value: pipe.send((_TOLD, value)))
            except Exception as error:
                error.add_note(traceback.format_exc())
                answer = _RAISED, error
            _send(pipe, answer)


def _send(pipe: connection.Connection, answer: tuple[str, Any]) -> None:
    """Send an answer; one that cannot be sent is a fault of the function, not a death."""
    try:
        pipe.send(answer)
    except OSError:
        raise
    except Exception as error:
        message = f"{answer[1]!r} cannot be sent between processes: {error}"
        pipe.send((_RAISED, TypeError(message)))


def _die_with_parent() -> None:
    """End this worker at once when its parent is gone: no orphan keeps computing, or a lock."""

    def watch() -> None:
        parent = multiprocessing.parent_process()
        if parent is not None:
            connection.wait([parent.sentinel])
            os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


@contextlib.contextmanager
def _clean_start() -> Iterator[None]:
    """Start processes with one thread per library, and without the calling script.

    A worker imports what it calls by name. If it ran the script again, a script or notebook
    without the ``__main__`` guard would start itself in every worker.
    """
    before = {name: os.environ.get(name) for name in _ENVIRONMENT}
    main = sys.modules["__main__"]
    os.environ.update(_ENVIRONMENT)
    sys.modules["__main__"] = types.ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = main
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
