"""Live acquisition against an emulator: both protocols, errors, disconnects, gaps, triggers."""

import json
import socket
import threading
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest

import instruments
from instruments import keyence
from instruments.keyence._live import DL_EN1, LK_G5000, Connection, ProtocolError, Reading
from instruments.keyence._markers import Status
from instruments.keyence._recorder import Recorder, Ring, Sample, Setup, Trigger, recording, stamps, timing
from labpipe.errors import InputError, SourceError
from tests.instruments.keyence_emulator import emulator

START = datetime(2024, 5, 14, 10, 22, 31)


def ask(made, outputs=(1,), timeout=0.5) -> Reading:
    with Connection(made.protocol, "127.0.0.1", made.port, outputs, timeout) as connection:
        return connection.read()


def test_the_binary_protocol_reads_what_formats_say() -> None:
    """Raw -5790 with 3 decimals is -5.790 mm; 0xFFF00000 is no reading."""
    with emulator(LK_G5000, lambda n: [-5790, 12345, -1048576]) as made:
        found = ask(made, (1, 2, 3, 12))
    assert found.counts[:2] == (-5790, 12345)
    assert found.states == (Status.VALID, Status.VALID, Status.INVALID, Status.INVALID)
    assert Setup((1,), (3,), ("mm",), 0.01).value(0, -5790) == pytest.approx(-5.790e-3)


def test_the_ascii_protocol_reads_values_and_markers() -> None:
    values = [12345, 100000000, 99999999, -99999999, -99999998]
    with emulator(DL_EN1, lambda n: values) as made:
        found = ask(made, (1, 2, 3, 4, 5))
    assert found.counts == tuple(values)
    assert found.states == (Status.VALID, Status.ALARM, Status.RANGEOVER_P, Status.RANGEOVER_N, Status.INVALID)


@pytest.mark.parametrize("protocol", [LK_G5000, DL_EN1])
def test_an_answer_that_comes_byte_by_byte_is_put_together(protocol: str) -> None:
    with emulator(protocol, lambda n: [n + 7], {0: "pieces"}) as made:
        assert ask(made).counts == (7,)


@pytest.mark.parametrize(
    ("protocol", "fault", "words"),
    [
        (LK_G5000, "close", "closed the connection after 0 bytes"),
        (LK_G5000, "short", "closed the connection after 58 bytes"),
        (LK_G5000, "garbage", "found an answer of 120 bytes, expected 116"),
        (LK_G5000, "long", "bytes, expected 116|bytes without an end"),
        (LK_G5000, "random", "which holds no readings\n  Something else may answer"),
        (LK_G5000, "http", r"found the answer b'HTTP/1.1 400'…, which holds no readings"),
        (LK_G5000, "silent", "no complete answer within 0.2 s"),
        (LK_G5000, "slow", "no complete answer within 0.2 s"),
        (DL_EN1, "http", "found the answer|bytes without an end|no complete answer"),
        (DL_EN1, "slow", "no complete answer within 0.2 s"),
        (DL_EN1, "close", "closed the connection"),
        (DL_EN1, "short", "closed the connection"),
        (DL_EN1, "garbage", 'found the answer "\\?!", expected for example "M0,\\+000012345"'),
        (DL_EN1, "long", "bytes without an end"),
        (DL_EN1, "error", 'the error "ER,M0,022"'),
        (DL_EN1, "silent", "no complete answer within 0.2 s"),
    ],
)
def test_every_fault_is_an_error_that_names_the_controller(protocol: str, fault: str, words: str) -> None:
    with emulator(protocol, lambda n: [1], {0: fault}) as made:
        with pytest.raises(SourceError, match=words) as caught:
            ask(made, timeout=0.2)
        assert caught.value.path == f"127.0.0.1:{made.port}"
        is_late = "no complete answer" in str(caught.value)
        assert type(caught.value) is (SourceError if is_late else ProtocolError)


def test_a_number_that_no_display_shows_is_no_reading() -> None:
    with emulator(LK_G5000, lambda n: [2**31 - 1, 10_000_000, 9_999_999, -9_999_999]) as made:
        found = ask(made, (1, 2, 3, 4))
    assert found.states == (Status.SUSPECT, Status.SUSPECT, Status.VALID, Status.VALID)


def test_random_answers_of_the_right_length_are_never_readings() -> None:
    with emulator(LK_G5000, lambda n: [1], dict.fromkeys(range(200), "random")) as made:
        for _ in range(200):
            with pytest.raises(ProtocolError, match="holds no readings"):
                ask(made)


def test_patience_ends_although_bytes_trickle_in() -> None:
    """One byte after the other comes, but no reading; the recording is given up all the same."""
    with emulator(LK_G5000, lambda n: [1], dict.fromkeys(range(99), "slow"), delay=0.1) as made:
        rec = recorder(made, interval=0.02, patience=0.4, timeout=0.2)
        with pytest.raises(SourceError, match=r"silent for 0.4 s\n  Last error: .*complete answer"):
            rec.record(60.0)
    assert rec.kept == []
    assert rec.tally.errors >= 1


def test_an_amplifier_that_is_not_there_is_told() -> None:
    with (
        emulator(DL_EN1, lambda n: [1, 2]) as made,
        pytest.raises(ProtocolError, match="readings of 2 amplifiers, asked for number 3"),
    ):
        ask(made, (3,))


def test_nobody_at_the_address_is_told() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    with pytest.raises(SourceError, match="Is the controller on"):
        Connection(LK_G5000, "127.0.0.1", port, (1,), 0.2)


@pytest.mark.parametrize(
    ("protocol", "outputs", "words"),
    [
        ("lk-g3000", (1,), "unknown protocol"),
        (LK_G5000, (13,), "from 1 to 12"),
        (DL_EN1, (), "from 1 to 16"),
        (DL_EN1, (1, 1), "different numbers"),
    ],
)
def test_what_does_not_exist_is_refused(protocol: str, outputs: tuple, words: str) -> None:
    with pytest.raises(InputError, match=words):
        Connection(protocol, "127.0.0.1", 1, outputs)


# --- recording ------------------------------------------------------------------------------------


def recorder(made, interval=0.01, patience=2.0, timeout=0.3, outputs=(1,)) -> Recorder:
    count = len(outputs)
    setup = Setup(outputs, (4,) * count, ("mm",) * count, interval, "LK-G5001")
    return Recorder(setup, lambda: Connection(made.protocol, "127.0.0.1", made.port, outputs, timeout), patience)


@pytest.mark.parametrize("protocol", [LK_G5000, DL_EN1])
def test_a_recording_is_a_storage_file_that_the_reader_reads(protocol: str, tmp_path: Path) -> None:
    from instruments.keyence import record

    with emulator(protocol, lambda n: [1000 + n, -99999999 if protocol == DL_EN1 else -5]) as made:
        rec = recorder(made, outputs=(1, 2))
        done = record(tmp_path / "drop.csv", rec.setup, rec.connect, 0.3)
    found = instruments.read(done.path)
    assert instruments.identify(done.path) == "keyence"
    assert found.attrs["sampling_interval"] == pytest.approx(0.01)
    assert found.attrs["model"] == "LK-G5001"
    valid = found["status1"].values == Status.VALID
    assert valid.sum() == done.summary["readings"]
    assert (~valid).sum() == done.summary["empty_slots"]
    steps = np.diff(found["out1"].values[valid])
    np.testing.assert_allclose(steps, 1e-7, rtol=1e-9)  # every answer once, in order
    if protocol == DL_EN1:
        assert set(found["status2"].values[valid]) == {Status.RANGEOVER_N}
    times = done.times.read_text("utf-8").splitlines()
    assert json.loads(times[0][1:])["readings"] == done.summary["readings"]
    assert len(times) == 2 + done.summary["readings"]
    assert "emulator only" in done.summary["remark"]


def test_broken_connections_leave_empty_rows_and_a_new_connection() -> None:
    faults = {3: "close", 5: "short", 8: "garbage"}
    with emulator(LK_G5000, lambda n: [n], faults) as made:
        rec = recorder(made)
        rec.record(1.0)
        assert made.connections >= 5  # the first look, the recording, and one after each fault
    assert (rec.tally.errors, rec.tally.reconnections) == (3, 3)
    counts = [s.reading.counts[0] for s in rec.kept]
    assert not {3, 5, 8} & set(counts)
    assert rec.empty >= 3
    assert counts == sorted(counts)


def test_a_late_answer_empties_the_slots_it_missed() -> None:
    with emulator(DL_EN1, lambda n: [n], {6: "late"}, delay=0.1) as made:
        rec = recorder(made)
        rec.record(0.8)
    slots = np.array([s.slot for s in rec.kept])
    place = [s.reading.counts[0] for s in rec.kept].index(6)
    assert slots[place + 1] - slots[place] >= 9
    assert rec.tally.errors == 0


def test_a_controller_that_stays_silent_ends_the_recording_and_keeps_what_came(tmp_path: Path) -> None:
    from instruments.keyence import record

    faults = dict.fromkeys(range(10, 10_000), "silent")
    with emulator(LK_G5000, lambda n: [n], faults) as made:
        rec = recorder(made, timeout=0.1)
        with pytest.raises(SourceError, match=r"silent for 0\.5 s") as caught:
            record(tmp_path / "a.csv", rec.setup, rec.connect, 60.0, patience=0.5)
    assert "no complete answer" in str(caught.value)
    assert instruments.read(tmp_path / "a.csv").sizes["time"] >= 10


def test_a_trigger_keeps_what_lies_around_it() -> None:
    """The reading falls by 1 µm per answer and passes -50 µm once."""
    with emulator(LK_G5000, lambda n: [-10 * n]) as made:
        rec = recorder(made)
        rec.record(0.2, Trigger(1, -50e-6, is_rising=False, before=0.05))
    at = next(s for s in rec.kept if s.slot == rec.trigger_slot)
    assert at.reading.counts[0] <= -500
    assert 0 < rec.trigger_slot - rec.kept[0].slot <= 5
    assert rec.kept[-1].slot < rec.trigger_slot + 20
    before = [s.reading.counts[0] for s in rec.kept if s.slot < rec.trigger_slot]
    assert all(count > -500 for count in before)


def test_a_trigger_does_not_see_invalid_readings() -> None:
    trigger = Trigger(1, 0.0, is_rising=True)
    assert trigger.passed(-1.0, 0.0)
    assert not trigger.passed(0.0, 1.0)
    values = [-99999999, 10, -10, 10]
    samples = [
        Sample(i, i * 0.1, 0.0, Reading((v,), (Status.RANGEOVER_N if v < -1e6 else Status.VALID,)))
        for i, v in enumerate(values)
    ]
    rec = Recorder(Setup((1,), (4,), ("mm",), 0.1), lambda: None)  # type: ignore[arg-type,return-value]
    rec._keep(samples, trigger)
    assert rec.trigger_slot == 3


def test_the_ring_loses_the_oldest_and_counts_them_between_threads() -> None:
    ring, taken = Ring(64), []
    done = threading.Event()

    def fill() -> None:
        for n in range(5000):
            ring.put(n)  # type: ignore[arg-type]
        done.set()

    threading.Thread(target=fill).start()
    while not done.is_set():
        taken += ring.take()
    taken += ring.take()
    assert taken == sorted(taken)
    assert len(taken) + ring.lost == 5000


def sample(slot: int, count: int, at: float | None = None) -> Sample:
    place = slot * 0.01 if at is None else at
    return Sample(slot, place, 0.002, Reading((count,), (Status.VALID,)))


def test_rows_are_slots_and_the_first_is_the_first_reading() -> None:
    setup = Setup((1,), (4,), ("mm",), 0.01)
    found = recording(setup, [sample(3, 10000), sample(6, -20000)], START)
    assert found["status1"].values.tolist() == [0, 3, 3, 0]
    np.testing.assert_allclose(found["out1"].values[[0, 3]], [1e-3, -2e-3])
    assert np.isnan(found["out1"].values[1:3]).all()


def test_a_large_reading_keeps_its_digits_before_the_sign() -> None:
    setup = Setup((1,), (4,), ("mm",), 0.01)
    found = recording(setup, [sample(0, 1234567), sample(1, -15)], START)
    assert found["out1"].attrs["decimals"] == 3
    np.testing.assert_allclose(found["out1"].values, [123.457e-3, -0.002e-3], atol=1e-12)


def test_nothing_recorded_is_an_error() -> None:
    with pytest.raises(InputError, match="nothing was recorded"):
        recording(Setup((1,), (4,), ("mm",), 0.01), [], START)


def test_times_and_lateness_are_those_of_the_samples() -> None:
    setup = Setup((1,), (4,), ("mm",), 0.01)
    kept = [sample(2, 1, 0.0203), sample(3, 1, 0.0296)]
    assert list(stamps(kept))[1:] == ["1,0.020300,0.002000", "2,0.029600,0.002000"]
    found = timing(setup, kept)
    assert found["worst_lateness"] == pytest.approx(4e-4)
    assert found["median_round_trip"] == pytest.approx(2e-3)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (((1, 2), (4,), ("mm",), 0.01), "2 outputs need as many decimals"),
        (((1,), (9,), ("mm",), 0.01), "decimals must be from 0 to 6, found 9"),
        (((1,), (4,), ("mm",), 1e-6), "interval must be from 0.1 ms"),
    ],
)
def test_a_setup_that_cannot_be_is_refused(arguments: tuple, words: str) -> None:
    with pytest.raises(InputError, match=words):
        Setup(*arguments)


def test_the_unit_of_a_display_is_a_length() -> None:
    keyence.check_units(("mm", "um"))
    with pytest.raises(InputError, match='a length such as mm or um, found "kg"'):
        keyence.check_units(("mm", "kg"))
