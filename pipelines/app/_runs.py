"""The run of a session in a process of its own, which ends when this one does.

The process is asked to stop, and learns of the death of this one, by the end of its input; it then
ends as by Ctrl-C, and all results that were complete stay.
"""

import json
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any, Literal

from labpipe.errors import UsageError

Mode = Literal["process", "watch"]
_MOST_EVENTS = 20_000
_MOST_TEXT = 2000


class Runs:
    """At most one run of a session, in ``folder``, at a time, and its events."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._lock = threading.Lock()
        self._child: subprocess.Popen[str] | None = None
        self._mode: Mode = "process"
        self._events: list[dict[str, Any]] = []
        self._number = 0
        self._errors = ""
        self._takers: list[threading.Thread] = []

    def start(self, mode: Mode) -> None:
        """Begin or go on; ``watch`` processes arriving files until it is stopped.

        Raises
        ------
        UsageError
            A run is going on.
        """
        with self._lock:
            if self._is_running():
                raise UsageError("a run is going on; stop it first")
            self._mode, self._events, self._errors = mode, [], ""
            self._number += 1
            self._child = subprocess.Popen(
                [sys.executable, "-m", "pipelines.app._child", mode, str(self.folder)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
                encoding="utf-8",
                errors="replace",
            )
        self._takers = [threading.Thread(target=t, args=(self._child,)) for t in (self._take_events, self._take_errors)]
        for taker in self._takers:
            taker.start()

    def stop(self) -> None:
        """End the run as by Ctrl-C; complete results are kept."""
        with self._lock:
            if self._child is not None and self._child.stdin is not None and not self._child.stdin.closed:
                self._child.stdin.close()

    def close(self, seconds: float = 20.0) -> None:
        """Stop and wait for the end."""
        self.stop()
        if self._child is not None:
            try:
                self._child.wait(seconds)
            except subprocess.TimeoutExpired:
                self._child.kill()
                self._child.wait()
        for taker in self._takers:
            taker.join()

    def state(self, after: int = 0) -> dict[str, Any]:
        """Return the state: whether it runs, and the events from a number on."""
        with self._lock:
            code = None if self._child is None else self._child.poll()
            return {
                "run": self._number,
                "mode": self._mode,
                "running": self._is_running(),
                "code": code,
                "error": self._errors[-_MOST_TEXT:] if code not in (None, 0, 1, 130) else "",
                "events": self._events[max(after, 0) :],
                "next": len(self._events),
            }

    def _is_running(self) -> bool:
        return self._child is not None and self._child.poll() is None

    def _take_events(self, child: "subprocess.Popen[str]") -> None:
        assert child.stdout is not None  # noqa: S101 (it was opened as a pipe)
        with child.stdout as lines:
            for line in lines:
                try:
                    event = json.loads(line)
                except ValueError:
                    continue  # a library that prints is not an event
                with self._lock:
                    if child is self._child and len(self._events) < _MOST_EVENTS:
                        self._events.append(event)
        child.wait()

    def _take_errors(self, child: "subprocess.Popen[str]") -> None:
        assert child.stderr is not None  # noqa: S101 (it was opened as a pipe)
        with child.stderr as lines:
            for line in lines:
                with self._lock:
                    if child is self._child:
                        self._errors = (self._errors + line)[-2 * _MOST_TEXT :]
