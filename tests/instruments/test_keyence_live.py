"""Live acquisition against an emulator: both protocols, errors, disconnects, gaps, crashes."""

import socket
from pathlib import Path

import numpy as np
import pytest

import instruments
from instruments.keyence import DL_EN1, LK_G5000, Connection, Setup, Status, record, recover
from labpipe.errors import InputError, SourceError, UsageError
from tests.instruments.keyence_emulator import emulator


def opened(made, outputs=(1,), timeout=0.5) -> Connection:
    return Connection(made.protocol, "127.0.0.1", made.port, outputs, timeout)


def ask(made, outputs=(1,), timeout=0.5):
    connection = opened(made, outputs, timeout)
    try:
        return connection.read()
    finally:
        connection.close()


def recorded(made, path: Path, duration: float, outputs=(1,), **options):
    setup = Setup(outputs, (4,) * len(outputs), ("mm",) * len(outputs), 0.01)
    return record(path, setup, lambda: opened(made, outputs, 0.1), duration, **options)


def test_the_binary_protocol_reads_values_and_markers() -> None:
    with emulator(LK_G5000, lambda n: [-5790, 12345, -1048576, 99999999]) as made:
        found = ask(made, (1, 2, 3, 12))
    assert found.counts[:2] == (-5790, 12345)
    assert found.states == (Status.VALID, Status.VALID, Status.INVALID, Status.INVALID)


def test_the_ascii_protocol_reads_values_and_markers() -> None:
    values = [12345, 100000000, 99999999, -99999999, -99999998, 12345678]
    with emulator(DL_EN1, lambda n: values) as made:
        found = ask(made, (1, 2, 3, 4, 5, 6))
    assert found.counts == tuple(values)
    expected = ("VALID", "ALARM", "RANGEOVER_P", "RANGEOVER_N", "INVALID", "SUSPECT")
    assert tuple(state.name for state in found.states) == expected


@pytest.mark.parametrize("protocol", [LK_G5000, DL_EN1])
@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("close", "closed or flooded"),
        ("short", "closed or flooded"),
        ("garbage", "no readings"),
        ("long", "no readings|flooded|no complete answer"),
        ("silent", "no complete answer within 0.2 s"),
        ("slow", "no complete answer within 0.2 s"),
    ],
)
def test_every_fault_is_an_error_that_names_the_controller(protocol: str, fault: str, words: str) -> None:
    with emulator(protocol, lambda n: [n], {0: fault}) as made:
        with pytest.raises(SourceError, match=words) as caught:
            ask(made, timeout=0.2)
        assert f"127.0.0.1:{made.port}" in str(caught.value)


def test_what_does_not_exist_is_refused() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    with pytest.raises(SourceError, match="no connection"):
        Connection(LK_G5000, "127.0.0.1", port, (1,), 0.5)
    for protocol, outputs in (("cl-3000", (1,)), (LK_G5000, (13,)), (DL_EN1, (0,)), (DL_EN1, (1, 1))):
        with pytest.raises(InputError, match="numbers from 1"):
            Connection(protocol, "127.0.0.1", 1, outputs, 0.5)
    for decimals, units, interval in (((4, 4), ("mm",), 0.01), ((4,), ("V",), 0.01), ((4,), ("mm",), 1e-5)):
        with pytest.raises(InputError):
            Setup((1,), decimals, units, interval)


@pytest.mark.parametrize("protocol", [LK_G5000, DL_EN1])
def test_a_recording_is_a_storage_file_that_the_reader_reads(protocol: str, tmp_path: Path) -> None:
    with emulator(protocol, lambda n: [1000 + n, -99999999 if protocol == DL_EN1 else -5]) as made:
        done = recorded(made, tmp_path / "new" / "drop.csv", 0.3, outputs=(1, 2))
    found = instruments.read(done.path)
    assert instruments.identify(done.path) == "keyence"
    assert found.attrs["sampling_interval"] == pytest.approx(0.01)
    valid = found["status1"].values == Status.VALID
    assert (valid.sum(), valid.size) == (done.readings, done.rows)
    steps = np.diff(found["out1"].values[valid])
    np.testing.assert_allclose(steps, 1e-7, rtol=1e-9)  # every answer once, in order
    if protocol == DL_EN1:
        assert set(found["status2"].values[valid]) == {Status.RANGEOVER_N}
    rows = np.loadtxt(done.times, delimiter=",", skiprows=1)
    assert len(rows) == done.readings
    assert np.abs(rows[:, 1] - 0.01 * (rows[:, 0] - 1 + (rows[0, 1] // 0.01))).max() <= 0.01 + done.worst_lateness


def test_broken_connections_and_late_answers_leave_empty_rows(tmp_path: Path) -> None:
    faults = {3: "close", 5: "short", 8: "garbage", 12: "late"}
    with emulator(LK_G5000, lambda n: [n], faults, delay=0.06) as made:
        done = recorded(made, tmp_path / "a.csv", 0.6)
    assert done.errors == 3
    found = instruments.read(tmp_path / "a.csv")
    counts = np.round(found["out1"].values[found["status1"].values == 0] * 1e7).astype(int)
    assert not {3, 5, 8} & set(counts.tolist())
    assert (np.diff(counts) > 0).all()
    place = np.flatnonzero(np.round(found["out1"].values * 1e7) == 12)[0]
    assert not np.isfinite(found["out1"].values[place + 1 : place + 5]).any()


def test_a_controller_that_stays_silent_ends_the_recording_and_keeps_the_readings(tmp_path: Path) -> None:
    faults = dict.fromkeys(range(10, 10_000), "silent")
    with emulator(LK_G5000, lambda n: [n], faults) as made, pytest.raises(SourceError, match=r"silent for 0\.5 s"):
        recorded(made, tmp_path / "a.csv", 60.0, patience=0.5)
    assert instruments.read(tmp_path / "a.csv").sizes["time"] >= 10


def test_a_file_is_never_replaced(tmp_path: Path) -> None:
    for name in ("a.csv", "b.times.csv"):
        (tmp_path / name).write_text("precious")
    with emulator(LK_G5000, lambda n: [n]) as made:
        for name in ("a.csv", "b.csv"):
            with pytest.raises(UsageError, match="never replaced"):
                recorded(made, tmp_path / name, 0.1)


def test_a_recording_that_lost_power_is_read_after_its_half_line_is_cut_off(tmp_path: Path) -> None:
    with emulator(LK_G5000, lambda n: [n]) as made:
        done = recorded(made, tmp_path / "a.csv", 0.2)
    whole = done.path.read_bytes()
    for cut in range(1, 14):
        done.path.write_bytes(whole[:-cut])
        recover(done.path)
        kept = instruments.read(done.path)
        assert kept.sizes["time"] in (done.rows - 1, done.rows - 2)
    assert done.times.read_bytes().endswith(b"\r\n")
