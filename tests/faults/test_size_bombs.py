"""A few bytes that declare gigabytes are refused before memory for them is asked for."""

import io
import os
import struct
import time
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path

import netCDF4
import numpy as np
import pytest

import instruments
from instruments import anton_paar, images, mach1, phantom
from labpipe import files
from labpipe.errors import LabpipeError
from labpipe.workflow.session import load
from pipelines.session import SETTINGS
from tests.by_day import by_day
from tests.faults import seeds

resource = pytest.importorskip("resource", reason="limits of memory are those of Unix")
MEMORY = 256 * 2**20  # bytes beyond what the test process has already
SECONDS = 20  # of processor time; what grows with the square of the size takes hours


def png(columns: int, rows: int) -> bytes:
    head = b"IHDR" + struct.pack(">IIBBBBB", columns, rows, 8, 0, 0, 0, 0)
    chunk = struct.pack(">I", 13) + head + struct.pack(">I", zlib.crc32(head))
    return b"\x89PNG\r\n\x1a\n" + chunk + b"\0\0\0\0IEND\xaeB`\x82"


def tiff(entries: list[tuple[int, ...]], following: int = 0) -> bytes:
    fields = b"".join(struct.pack("<HHII", *entry) for entry in entries)
    return b"II*\0" + struct.pack("<IH", 8, len(entries)) + fields + struct.pack("<I", following)


GREY = [(tag, 4, 1, value) for tag, value in ((256, 80), (257, 64), (273, 8), (279, 5120))]
GREY = sorted([*GREY, *((tag, 3, 1, value) for tag, value in ((258, 8), (262, 1), (277, 1)))])
LARGE = [(tag, 4, 1, 100_000) if tag in (256, 257) else (tag, *rest) for tag, *rest in GREY]


def film(folder: Path, offset: int, layout: str, value: int) -> bytes:
    data = bytearray(seeds.film_bytes(folder))
    struct.pack_into("<" + layout, data, offset, value)
    return bytes(data)


def film_of_shared_frames(folder: Path, count: int = 200_000) -> bytes:
    """A table of offsets that points at every byte of one frame."""
    data = bytearray(seeds.film_bytes(folder, count=1, rows=1000, columns=250))
    struct.pack_into("<I", data, 20, count)
    first = struct.unpack_from("<q", data, struct.unpack_from("<I", data, 32)[0])[0]
    struct.pack_into("<I", data, 32, len(data))
    return bytes(data) + (first + np.arange(count, dtype="<i8")).tobytes()


def netcdf(folder: Path) -> bytes:
    with netCDF4.Dataset(folder / "bomb.nc", "w") as handle:
        handle.createDimension("time", 2**32)
        handle.createVariable("z", "f8", ("time",), chunksizes=(2**20,), zlib=False)
    return (folder / "bomb.nc").read_bytes()


def workbook(folder: Path) -> bytes:
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("[Content_Types].xml", "<Types/>")
        archive.writestr("xl/sharedStrings.xml", "<t>Interval and data points:</t>")
        with archive.open("xl/worksheets/sheet1.xml", "w") as part:
            for _ in range(200):
                part.write(b" " * 2**20)
    return made.getvalue()


def chain(key: str, count: int) -> bytes:
    return f"labpipe = 1\n{'.'.join([key] * count)} = 1\n".encode()


Case = tuple[str, Callable[[Path], bytes], Callable[[Path], object]]
one_image = lambda path: images.read(path, fps=1.0)[0]  # noqa: E731
whole_film = lambda path: phantom.read(path).valid  # noqa: E731
session = lambda path: load(path, SETTINGS)  # noqa: E731

CASES: dict[str, Case] = {
    "netCDF of 32 GB in 6 kB": ("a.nc", netcdf, files.read_dataset),
    "cine of 2^31 frames": ("a.cine", lambda f: film(f, 20, "I", 2**31), whole_film),
    "cine with a frame at every byte": ("a.cine", film_of_shared_frames, whole_film),
    "PNG of 1e10 px": ("1.png", lambda f: png(100_000, 100_000), one_image),
    "TIFF of 1e10 px": ("a.tif", lambda f: tiff(LARGE), one_image),
    "TIFF of pages in a circle": ("a.tif", lambda f: tiff(GREY, following=8), one_image),
    "workbook that unpacks to 200 MB": ("a.xlsx", workbook, anton_paar.read),
    "Mach-1 of one line": ("a.txt", lambda f: b"<Mach-1 File>\r\n" + b"1" * 40_000_000, mach1.read),
    "file of nothing but line ends": ("a.txt", lambda f: b"\n" * 20_000_000, instruments.read),
    "session of 100 MB": ("session.toml", lambda f: b"#" * 100_000_000, session),
    "session of a key 300,000 deep": ("session.toml", lambda f: chain("a", 300_000), session),
}


def address_space() -> int:
    return int(Path("/proc/self/statm").read_text().split()[0]) * os.sysconf("SC_PAGE_SIZE")


def refusal(path: Path, read: Callable[[Path], object]) -> str:
    """Say how a file was refused by a child with little memory and time, or what else happened."""
    reader, writer = os.pipe()
    pid = os.fork()
    if not pid:
        said = "killed"
        try:
            resource.setrlimit(resource.RLIMIT_AS, (address_space() + MEMORY,) * 2)
            resource.setrlimit(resource.RLIMIT_CPU, (int(time.process_time()) + SECONDS,) * 2)
            said = f"accepted: {read(path)!r}"
        except LabpipeError as error:
            said = f"refused: {error}"
        except BaseException as error:
            said = f"{type(error).__name__}: {error}"
        finally:
            os.write(writer, said[:4000].encode("utf-8", "replace"))
            os._exit(0)
    os.close(writer)
    with os.fdopen(reader, errors="replace") as stream:
        said = stream.read()
    status = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
    return said if status == 0 else f"ended by signal {-status}"


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of fork, where there are threads
@pytest.mark.skipif(not Path("/proc/self/statm").is_file(), reason="measures memory by /proc")
@pytest.mark.parametrize("name", by_day(CASES, 9))
def test_what_declares_too_much_is_refused_with_little_memory(tmp_path: Path, name: str) -> None:
    file_name, make, read = CASES[name]
    path = tmp_path / file_name
    path.write_bytes(make(tmp_path))
    target = tmp_path if file_name == "1.png" else path
    said = refusal(target, read)
    if name == "cine with a frame at every byte":  # the film is read; none of these is a frame
        assert said.startswith("accepted"), said
        return
    assert said.startswith("refused"), said
    assert len(said) > 40
    assert file_name in said or str(tmp_path) in said
