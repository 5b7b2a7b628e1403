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
from labpipe.errors import InputError, UsageError
from pipelines.acquire import parse_trigger, record_keyence
from pipelines.commands.acquire import acquire
from tests.instruments.keyence_emulator import emulator


def test_the_command_writes_a_file_and_says_what_was_lost(tmp_path: Path) -> None:
    with emulator("lk-g5000", lambda n: [1234], {3: "close"}) as made:
        done = CliRunner().invoke(acquire, [
            "keyence", str(tmp_path / "a.csv"), "--host", "127.0.0.1", "--port", str(made.port),
            "--decimals", "4", "--duration", "0.6 s", "--model", "LK-G5001", "--json",
        ])  # fmt: skip
    assert done.exit_code == 0, done.output
    document = json.loads(done.output)
    assert document["errors"] == 1
    assert document["reconnections"] == 1
    found = instruments.read(tmp_path / "a.csv")
    assert float(found["out1"].max()) == pytest.approx(0.1234e-3)


def test_ctrl_c_keeps_what_came_and_is_130(tmp_path: Path) -> None:
    with emulator("dl-en1", lambda n: [n]) as made:
        child = subprocess.Popen(
            [sys.executable, "-m", "labpipe", "acquire", "keyence", str(tmp_path / "a.csv"),
             "--host", "127.0.0.1", "--port", str(made.port), "--protocol", "dl-en1",
             "--decimals", "3", "--duration", "600 s"],
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        deadline = time.monotonic() + 60
        while made.answered < 30 and time.monotonic() < deadline:
            time.sleep(0.02)
        child.send_signal(signal.SIGINT)
        _, err = child.communicate(timeout=60)
    assert child.returncode == 130, err
    assert instruments.read(tmp_path / "a.csv").sizes["time"] > 10


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--protocol", "dl-en1", "--decimals", "3", "--duration", "1 s"], "--port is needed"),
        (["--duration", "1 s"], "--decimals"),
        (["--decimals", "3", "--duration", "1 kg"], 'such as "10 ms"'),
        (["--decimals", "3", "--duration", "-1 s"], 'such as "10 ms"'),
    ],
)
def test_options_that_do_not_fit_are_usage_errors(
    options: list[str], words: str, tmp_path: Path
) -> None:
    arguments = ["keyence", str(tmp_path / "a.csv"), "--host", "127.0.0.1", *options]
    done = CliRunner().invoke(acquire, arguments)
    assert done.exit_code == 2
    assert words in done.output


def test_a_trigger_is_read_with_its_unit() -> None:
    found = parse_trigger("OUT2 > 1.5 mm", 0.2)
    assert (found.output, found.level, found.is_rising, found.before) == (2, 1.5e-3, True, 0.2)
    with pytest.raises(InputError, match=r'reads "out1 < -1\.5 mm"'):
        parse_trigger("when it falls")


def test_a_raw_file_is_never_replaced_and_the_trigger_must_be_recorded(tmp_path: Path) -> None:
    from instruments.keyence_recorder import Setup

    (tmp_path / "a.csv").write_text("precious")
    setup = Setup((1,), (4,), ("mm",), 0.01)
    with pytest.raises(UsageError, match="never replaced"):
        record_keyence(tmp_path / "a.csv", setup, lambda: None, 1.0)  # type: ignore[arg-type,return-value]
    with pytest.raises(InputError, match="looks at out2, which is not recorded"):
        record_keyence(
            tmp_path / "b.csv", setup, lambda: None, 1.0, parse_trigger("out2 > 1 mm")  # type: ignore[arg-type,return-value]
        )  # fmt: skip
