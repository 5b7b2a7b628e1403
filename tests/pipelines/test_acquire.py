"""The command acquire: from an emulated controller to a file in a session."""

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from click.testing import CliRunner

import instruments
from pipelines.commands.system import acquire
from tests.instruments.keyence_emulator import emulator


def line(folder: Path, port: int, *options: str) -> list[str]:
    return ["keyence", str(folder / "a.csv"), "--host", "127.0.0.1", "--port", str(port), "--decimals", "3", *options]


def test_the_command_writes_a_file_and_says_what_was_lost(tmp_path: Path) -> None:
    with emulator("lk-g5000", lambda n: [1234], {3: "close"}) as made:
        done = CliRunner().invoke(acquire, [*line(tmp_path, made.port), "--duration", "0.6 s", "--json"])
    assert done.exit_code == 0, done.output
    assert json.loads(done.output)["errors"] == 1
    found = instruments.read(tmp_path / "a.csv")
    assert float(found["out1"].max()) == pytest.approx(1.234e-3)


@pytest.mark.parametrize(("protocol", "order"), [("dl-en1", signal.SIGINT), ("lk-g5000", signal.SIGKILL)])
def test_a_recording_that_is_ended_or_killed_is_readable(tmp_path: Path, protocol: str, order: signal.Signals) -> None:
    with emulator(protocol, lambda n: [n]) as made:
        options = line(tmp_path, made.port, "--protocol", protocol, "--duration", "600 s")
        command = [sys.executable, "-m", "labpipe", "acquire", *options]
        child = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        deadline = time.monotonic() + 60
        while made.answered < 40 and time.monotonic() < deadline:
            time.sleep(0.02)
        child.send_signal(order)
        _, err = child.communicate(timeout=60)
    assert child.returncode == (130 if order == signal.SIGINT else -signal.SIGKILL), err
    assert instruments.read(tmp_path / "a.csv").sizes["time"] > 10
    done = CliRunner().invoke(acquire, ["recover", str(tmp_path / "a.csv")])
    assert "bytes cut off a.csv 0" in done.output
