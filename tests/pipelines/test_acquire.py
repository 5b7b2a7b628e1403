"""The command acquire: from an emulated controller to a file in a session."""

import json
import signal
import subprocess
import sys
import time
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import instruments
from instruments.keyence import _journal as journals, parse_trigger, record, recover
from instruments.keyence._live import Reading
from instruments.keyence._markers import Status
from instruments.keyence._recorder import Sample, Setup, Tally
from labpipe.errors import ConfigError, InputError, UsageError
from pipelines.cli import cli
from pipelines.commands.acquire import acquire
from tests.instruments.keyence_emulator import emulator


def test_the_command_writes_a_file_and_says_what_was_lost(tmp_path: Path) -> None:
    with emulator("lk-g5000", lambda n: [1234], {3: "close"}) as made:
        done = CliRunner().invoke(
            acquire,
            [
                "keyence",
                str(tmp_path / "a.csv"),
                "--host",
                "127.0.0.1",
                "--port",
                str(made.port),
                "--decimals",
                "4",
                "--duration",
                "0.6 s",
                "--model",
                "LK-G5001",
                "--json",
            ],
        )
    assert done.exit_code == 0, done.output
    document = json.loads(done.output)
    assert document["errors"] == 1
    assert document["reconnections"] == 1
    found = instruments.read(tmp_path / "a.csv")
    assert float(found["out1"].max()) == pytest.approx(0.1234e-3)


def test_ctrl_c_keeps_what_came_and_is_130(tmp_path: Path) -> None:
    with emulator("dl-en1", lambda n: [n]) as made:
        child = subprocess.Popen(
            [
                sys.executable,
                "-m",
                "labpipe",
                "acquire",
                "keyence",
                str(tmp_path / "a.csv"),
                "--host",
                "127.0.0.1",
                "--port",
                str(made.port),
                "--protocol",
                "dl-en1",
                "--decimals",
                "3",
                "--duration",
                "600 s",
            ],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
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
def test_options_that_do_not_fit_are_usage_errors(options: list[str], words: str, tmp_path: Path) -> None:
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
    (tmp_path / "a.csv").write_text("precious")
    setup = Setup((1,), (4,), ("mm",), 0.01)
    with pytest.raises(UsageError, match="never replaced"):
        record(tmp_path / "a.csv", setup, lambda: None, 1.0)  # type: ignore[arg-type,return-value]
    with pytest.raises(InputError, match="looks at out2, which is not recorded"):
        record(
            tmp_path / "b.csv",
            setup,
            lambda: None,
            1.0,
            parse_trigger("out2 > 1 mm"),  # type: ignore[arg-type,return-value]
        )


class Slow:
    """A connection without a network: counts up, one reading per question."""

    count = 0

    def __enter__(self) -> "Slow":
        return self

    def __exit__(self, *_: object) -> None:
        return

    def read(self) -> Reading:
        Slow.count += 1
        return Reading((Slow.count,), (Status.VALID,))

    def close(self) -> None:
        return


def unfinished(folder: Path, count: int = 40, first: int = 0) -> Path:
    """What a recording killed after some readings leaves."""
    setup = Setup((1,), (4,), ("mm",), 0.01, "LK-G5001")
    head = journals.Head(setup, datetime(2026, 5, 14, 12, tzinfo=UTC), 10.0)
    samples = [Sample(n, n * 0.01 + 0.001, 0.0005, Reading((n,), (Status.VALID,))) for n in range(first, first + count)]
    path = folder / "a.csv.recording"
    path.write_text(journals.first_line(head) + journals.lines(samples, Tally(1, 2, "?", 0)))
    return path


def test_what_a_killed_recording_left_becomes_the_file_it_would_have_written(tmp_path: Path) -> None:
    path = unfinished(tmp_path)
    with path.open("a") as stream:
        stream.write("[40, 0.4")
    done = CliRunner().invoke(acquire, ["recover", str(path), "--json"])
    assert done.exit_code == 0, done.output
    document = json.loads(done.output)
    assert document["readings"] == 40
    assert document["reconnections"] == 1
    assert document["cut_short"] is True
    found = instruments.read(tmp_path / "a.csv")
    assert np.round(found["out1"].values * 1e7).tolist() == list(range(40))
    assert (tmp_path / "a.times.csv").is_file()
    assert not path.exists()


def test_an_unfinished_recording_is_never_written_over(tmp_path: Path) -> None:
    path = unfinished(tmp_path)
    setup = Setup((1,), (4,), ("mm",), 0.01)
    with pytest.raises(UsageError, match="labpipe acquire recover"):
        record(tmp_path / "a.csv", setup, Slow, 1.0)  # type: ignore[arg-type]
    (tmp_path / "a.csv").write_text("precious")
    with pytest.raises(UsageError, match="holds something else; move it away"):
        recover(path)
    assert (tmp_path / "a.csv").read_text() == "precious"
    assert path.exists()
    with pytest.raises(UsageError, match="expected an unfinished recording"):
        recover(tmp_path / "a.csv")
    (tmp_path / "b.csv.recording").touch()
    with pytest.raises(UsageError, match="holds no reading"):
        recover(tmp_path / "b.csv.recording")


def test_a_recording_that_goes_on_is_left_alone_and_ends_without_a_rest(tmp_path: Path) -> None:
    setup = Setup((1,), (4,), ("mm",), 0.01)
    told: list[str] = []

    def look(readings: int, empty: int) -> None:
        if readings and not told:
            with pytest.raises(UsageError, match="is still being recorded") as error:
                recover(tmp_path / "a.csv.recording")
            told.append(str(error.value))

    record(tmp_path / "a.csv", setup, Slow, 0.5, progress=look)  # type: ignore[arg-type]
    assert told
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.csv", "a.times.csv"]


def test_after_a_trigger_the_journal_holds_what_came_before_it_too(tmp_path: Path) -> None:
    setup = Setup((1,), (4,), ("mm",), 0.01)
    Slow.count = 0
    held: list[bytes] = []

    def look(readings: int, empty: int) -> None:
        held.append((tmp_path / "a.csv.recording").read_bytes())

    trigger = parse_trigger("out1 > 0.003 mm", 0.05)
    done = record(tmp_path / "a.csv", setup, Slow, 0.3, trigger, progress=look)  # type: ignore[arg-type]
    (tmp_path / "b.csv.recording").write_bytes(held[-1])
    again = recover(tmp_path / "b.csv.recording")
    assert held[0] == b""
    assert again.summary["trigger_row"] == done.summary["trigger_row"] == 6
    written = done.path.read_bytes().split(b"\r\n")
    recovered = again.path.read_bytes().split(b"\r\n")
    body = next(k for k, line in enumerate(recovered) if line.startswith(b"1,"))
    assert recovered[body:-1] == written[body : body + len(recovered) - body - 1]
    assert len(recovered) - body > 5


def test_process_names_the_unfinished_recording_of_a_file_that_it_misses(tmp_path: Path) -> None:
    unfinished(tmp_path)
    (tmp_path / "session.toml").write_text('labpipe = 1\n[experiments.drop]\nkind = "ball_drop"\nlaser = ["a.csv"]\n')
    done = CliRunner().invoke(cli, ["process", str(tmp_path)])
    assert isinstance(done.exception, ConfigError)
    assert 'labpipe acquire recover "a.csv.recording"' in str(done.exception)
