"""Progress on stderr: time gone, time left, and only where somebody looks."""

import io
import sys
from pathlib import Path

import click
import pytest

from pipelines.commands.progress import counted, progress, watching
from pipelines.session import process


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def terminal(monkeypatch: pytest.MonkeyPatch) -> Terminal:
    """Put a terminal in the place of stderr; in the test itself, as pytest puts its own there."""
    found = Terminal()
    monkeypatch.setattr(sys, "stderr", found)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "160")
    return found


def test_a_run_shows_steps_time_gone_and_time_left_and_leaves_stdout_alone(
    session_copy: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    screen = terminal(monkeypatch)
    with watching() as seen:
        assert seen is not None
        process(session_copy, only=["nbr"], full=False, jobs=0, progress=seen)
    shown = screen.getvalue()
    assert "nbr: " in shown
    assert " left " in shown
    assert capsys.readouterr().out == ""


def test_nothing_is_shown_where_nobody_looks(monkeypatch: pytest.MonkeyPatch) -> None:
    screen = terminal(monkeypatch)
    with click.Context(click.Command("x"), obj=None) as context:
        context.meta["labpipe.json"] = True
        with counted(3) as step, watching() as shown:
            assert step is shown is None
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    with counted(3) as step, watching() as shown, progress("x"):
        assert step is shown is None
    assert screen.getvalue() == ""
