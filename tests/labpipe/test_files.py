"""Files exist whole or not at all; names stay inside; damage is noticed."""

import contextlib
import errno
import hashlib
import multiprocessing
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from hypothesis import HealthCheck, given, settings, strategies as st

from labpipe import files
from labpipe.errors import InputError, StorageError, StoreError
from labpipe.files import HashIndex, safe_join
from tests.by_day import by_day


def some_dataset(size: int = 50) -> xr.Dataset:
    time_axis = np.arange(size) / 20e3
    return xr.Dataset(
        {
            "displacement": ("time", np.sin(time_axis), {"units": "m", "long_name": "z"}),
            "valid": ("time", time_axis > 1e-3),
            "label": ("impact", np.array(["é", "second"])),
            "restitution": ((), 0.73),
            "nothing": ("none", np.zeros(0)),
        },
        coords={"time": ("time", time_axis, {"units": "s"}), "serial": ("impact", [1, 2])},
        attrs={"title": "drop", "n": 3, "flag": True, "absent": None, "work": {"steps": 4}},
    )


def test_written_bytes_are_there_and_nothing_else(tmp_path: Path) -> None:
    files.write_bytes(tmp_path / "new" / "a.bin", b"\x00\xff" * 1000)
    assert (tmp_path / "new" / "a.bin").read_bytes() == b"\x00\xff" * 1000
    assert [p.name for p in tmp_path.rglob("*")] == ["new", "a.bin"]


@pytest.mark.parametrize(
    ("number", "says"),
    [
        (errno.ENOSPC, "no space left: 7 bytes are needed"),
        (errno.EFBIG, "limit on the size of a file"),
        (errno.EROFS, "no permission"),
        (errno.EIO, "7 bytes could not be written"),
    ],
)
def test_a_disk_that_refuses_keeps_the_old_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int, says: str
) -> None:
    target = tmp_path / "a"
    files.write_bytes(target, b"old")

    def refuse(handle: int) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(os, "fsync", refuse)
    with pytest.raises(StorageError, match=says) as caught:
        files.write_bytes(target, b"newdata")
    assert caught.value.exit_code == 5
    assert target.read_bytes() == b"old"
    assert [p.name for p in tmp_path.iterdir()] == ["a"]


def test_what_cannot_be_read_back_does_not_come_to_exist(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(files, "digest", lambda path: "0" * 64)
    with pytest.raises(StorageError, match="cannot be read back"):
        files.write_bytes(tmp_path / "a", b"data")
    assert list(tmp_path.iterdir()) == []


LIMITED = """
import resource, sys, signal
import numpy, xarray
from labpipe import files
from labpipe.errors import StorageError
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[2]), resource.RLIM_INFINITY))
data = xarray.Dataset({"z": ("time", numpy.arange(20000.0))})
try:
    files.write_dataset(sys.argv[1], data)
except StorageError as error:
    sys.exit(f"refused: {error}")
"""


@pytest.mark.skipif(sys.platform == "win32", reason="limits of Unix")
@pytest.mark.parametrize("limit", by_day([40_000, 1000, 150_000], 1))
def test_a_limit_on_file_size_leaves_the_old_dataset_whole(tmp_path: Path, limit: int) -> None:
    target = tmp_path / "a.nc"
    files.write_dataset(target, some_dataset())
    before = target.read_bytes()
    command = [sys.executable, "-c", LIMITED, str(target), str(limit)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert "refused: " in done.stderr
    assert "bytes" in done.stderr
    assert target.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["a.nc"]


def test_a_log_closes_a_line_that_was_left_incomplete(tmp_path: Path) -> None:
    log = tmp_path / "run.jsonl"
    files.append_line(log, "one")
    with log.open("ab") as stream:
        stream.write(b'{"half')
    files.append_line(log, "two")
    assert log.read_text().splitlines() == ["one", '{"half', "two"]


def test_digest_of_a_folder_follows_names_and_contents(tmp_path: Path) -> None:
    for name in ("f", "g"):
        (tmp_path / name / "sub").mkdir(parents=True)
        (tmp_path / name / "sub" / "0.tif").write_bytes(b"0")
        (tmp_path / name / "1.tif").write_bytes(b"1")
    assert files.digest(tmp_path / "f") == files.digest(tmp_path / "g")
    (tmp_path / "g" / "1.tif").rename(tmp_path / "g" / "2.tif")
    assert files.digest(tmp_path / "f") != files.digest(tmp_path / "g")


def test_an_index_reads_a_file_again_when_it_is_young_or_changed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "a").write_bytes(b"abc")
    index = HashIndex(tmp_path / "index.json")
    found = index.digest(tmp_path / "a")
    index.save()
    assert not (tmp_path / "index.json").exists()  # touched just now
    real = time.time_ns
    monkeypatch.setattr(time, "time_ns", lambda: real() + 10_000_000_000)
    index.digest(tmp_path / "a")
    index.save()
    monkeypatch.setattr(files, "digest", lambda path: "read again")
    assert HashIndex(tmp_path / "index.json").digest(tmp_path / "a") == found
    (tmp_path / "a").write_bytes(b"abd")
    assert HashIndex(tmp_path / "index.json").digest(tmp_path / "a") == "read again"


@pytest.mark.parametrize("damage", [b"", b"\xff\xfe", files.seal({"a": 1}), b'{"sha256":"0","body":{}}'])
def test_a_damaged_index_is_an_empty_one(tmp_path: Path, damage: bytes, monkeypatch: pytest.MonkeyPatch) -> None:
    real = time.time_ns
    monkeypatch.setattr(time, "time_ns", lambda: real() + 10_000_000_000)
    (tmp_path / "a").write_bytes(b"abc")
    (tmp_path / "index.json").write_bytes(damage)
    index = HashIndex(tmp_path / "index.json")
    assert index.digest(tmp_path / "a") == hashlib.sha256(b"abc").hexdigest()
    index.save()
    assert files.unseal((tmp_path / "index.json").read_bytes()) is not None


def test_a_sealed_record_notices_every_flipped_bit() -> None:
    sealed = files.seal({"name": "é", "value": [1, 2.5, None]})
    assert files.unseal(sealed) == {"name": "é", "value": [1, 2.5, None]}
    for bit in range(8 * len(sealed)):
        damaged = bytearray(sealed)
        damaged[bit // 8] ^= 1 << (bit % 8)
        assert files.unseal(bytes(damaged)) is None, bit
    assert all(files.unseal(sealed[:length]) is None for length in range(len(sealed)))


REFUSED = {
    "": "empty",
    "/etc/passwd": "absolute",
    "C:/x": "absolute",
    "a/../../x": r'"\.\."',
    "a\\b": "backslash",
    "a\nb": "control",
    "a\u202eb": "direction",
    "a\ud800b": "control",
    "x/nul/y": "reserved",
    "dir /x": "space",
    "ab:c": "forbids",
    "n" * 256: "longer than 255",
}


@pytest.mark.parametrize(("name", "why"), REFUSED.items(), ids=[ascii(k)[:20] for k in REFUSED])
def test_a_name_that_could_leave_or_mislead_is_refused(tmp_path: Path, name: str, why: str) -> None:
    with pytest.raises(InputError, match=why) as caught:
        safe_join(tmp_path, name)
    assert all(c.isprintable() for c in str(caught.value))


def test_links_may_lead_inside_but_not_out_nor_in_circles(tmp_path: Path) -> None:
    root = tmp_path / "session"
    (root / "data").mkdir(parents=True)
    (root / "data" / "a").write_text("a")
    (tmp_path / "secret").write_text("s")
    (root / "inside").symlink_to(root / "data" / "a")
    (root / "outside").symlink_to(tmp_path / "secret")
    (root / "folder").symlink_to(tmp_path)
    (root / "loop").symlink_to(root / "loop")
    (root / "gone").symlink_to(root / "nothing")
    assert safe_join(root, "inside").read_text() == "a"
    for name in ("outside", "folder/secret", "loop", "loop/x", "gone"):
        with pytest.raises(InputError, match="symbolic link"):
            safe_join(root, name)


def test_ordinary_names_are_taken(tmp_path: Path) -> None:
    for name in ("a", "a/b.csv", ".hidden", "Messung ü.csv", "console", "a..b", "n" * 255, "a;b&c", "$HOME"):
        assert safe_join(tmp_path, name) == (tmp_path / name).resolve()


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(name=st.text(max_size=30) | st.from_regex(r"[./\\a~: ]{1,12}", fullmatch=True))
def test_no_name_leads_out_of_the_root(tmp_path: Path, name: str) -> None:
    with contextlib.suppress(InputError):
        assert safe_join(tmp_path, name).is_relative_to(tmp_path.resolve())


def hold(path: Path, said: "multiprocessing.synchronize.Event") -> None:
    with files.lock(path):
        said.set()
        signal.pause()


def test_a_lock_keeps_others_out_and_ends_with_its_process(tmp_path: Path) -> None:
    context, path = multiprocessing.get_context("fork"), tmp_path / "l" / "lock"
    said = context.Event()
    holder = context.Process(target=hold, args=(path, said), daemon=True)
    holder.start()
    assert said.wait(20)
    with files.lock(path, wait=False) as held:
        assert not held
    holder.kill()
    holder.join()
    with files.lock(path, wait=False) as held:
        assert held


def test_a_dataset_comes_back_equal(tmp_path: Path) -> None:
    dataset = some_dataset()
    files.write_dataset(tmp_path / "a.nc", dataset)
    found = files.read_dataset(tmp_path / "a.nc")
    xr.testing.assert_equal(found, dataset)
    assert found["displacement"].attrs == {"units": "m", "long_name": "z"}
    assert found.attrs == {"title": "drop", "n": 3, "flag": "true", "absent": "null", "work": '{"steps": 4}'}


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    values=st.lists(st.floats(width=64), max_size=20),
    kind=st.sampled_from(["f8", "f4", ">f8", "i8", "u2", "i1"]),
    words=st.lists(st.text(st.characters(exclude_categories=["Cs"]), max_size=8), max_size=4),
    attribute=st.text(max_size=20) | st.integers(-(2**40), 2**40) | st.booleans() | st.none(),
)
def test_any_dataset_survives_the_round_trip(
    tmp_path: Path, values: list[float], kind: str, words: list[str], attribute: object
) -> None:
    with np.errstate(all="ignore"):
        numbers = np.array(values) if "f" in kind else np.nan_to_num(values, posinf=3, neginf=4)
        numbers = (numbers if "f" in kind else np.mod(numbers, 100)).astype(kind)
    dataset = xr.Dataset(
        {"n": ("time", numbers), "w": ("word", np.array(words, dtype=object))}, attrs={"attribute": attribute}
    )
    files.write_dataset(tmp_path / "a.nc", dataset)
    found = files.read_dataset(tmp_path / "a.nc")
    assert found["n"].dtype == np.dtype(kind).newbyteorder("=")
    np.testing.assert_array_equal(found["n"].to_numpy(), numbers)
    assert found["w"].to_numpy().tolist() == [word.replace("\0", "\u2400") for word in words]


@pytest.mark.parametrize(
    ("values", "why"),
    [
        (np.array([1j]), "complex"),
        (np.array(["2020-01-01"], dtype="datetime64[ns]"), "times as numbers"),
        (np.array([{"a": 1}], dtype=object), "Python objects"),
    ],
)
def test_what_netcdf_cannot_hold_is_refused(tmp_path: Path, values: np.ndarray, why: str) -> None:
    with pytest.raises(InputError, match=why):
        files.write_dataset(tmp_path / "a.nc", xr.Dataset({"z": ("time", values)}))
    with pytest.raises(InputError, match="cannot be stored"):
        files.write_dataset(tmp_path / "a.nc", xr.Dataset(attrs={"x": {1, 2}}))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("count", [150, pytest.param(2000, marks=pytest.mark.slow)])
def test_no_flipped_bit_changes_a_value_silently(tmp_path: Path, count: int) -> None:
    path = tmp_path / "a.nc"
    files.write_dataset(path, some_dataset(2000))
    whole, data = files.read_dataset(path), path.read_bytes()
    rng = random.Random(3)
    noticed = 0
    for _ in range(count):
        damaged = bytearray(data)
        damaged[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
        path.write_bytes(damaged)
        try:
            found = files.read_dataset(path)
        except StoreError:
            noticed += 1
        else:
            assert found.identical(whole)  # the bit lay in the mark that says whose file it is
    assert noticed > 0.99 * count


def test_a_truncated_or_empty_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.nc"
    files.write_dataset(path, some_dataset())
    data = path.read_bytes()
    lengths = [0, 1, 8, 100, *range(500, len(data) - 41, len(data) // 20)]
    for length in [*lengths, *range(len(data) - 32, len(data))]:
        path.write_bytes(data[:length])
        with pytest.raises(StoreError, match="damaged"):
            files.read_dataset(path)
    path.write_bytes(data + b"more")
    with pytest.raises(StoreError, match="damaged"):
        files.read_dataset(path)


def test_what_a_killed_process_left_half_written_goes_with_the_next_file(tmp_path: Path) -> None:
    child = subprocess.Popen([sys.executable, "-c", "pass"])
    child.wait()
    names = [f"{files._machine()}-{child.pid}", f"{files._machine()}-{os.getppid()}", f"00000000-{child.pid}"]
    parts = [tmp_path / f".{name}-0badcafe.part" for name in names]
    for path in parts:
        path.touch()
    files.write_text(tmp_path / "b.txt", "b")
    expected = [False, True, True]  # of a process that lives, of another machine
    assert [path.exists() for path in parts] == expected
    parts[0].touch()
    files.remove_orphans(tmp_path.parent, is_deep=True)
    assert [path.exists() for path in parts] == expected


def test_a_journal_holds_what_was_appended_before_it_is_closed(tmp_path: Path) -> None:
    path = tmp_path / "there" / "a.recording"
    with files.journal(path) as append:
        append("one\n")
        assert path.read_text() == "one\n"
        with files.lock(path, wait=False) as is_free:
            assert not is_free
        append("µ\n")
    assert path.read_bytes() == "one\nµ\n".encode()
    with pytest.raises(StorageError), files.journal(path):
        pass
