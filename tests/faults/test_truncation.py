"""Real exports cut anywhere: never a shorter result without an error or a warning.

A cut between two tables (or two blocks) leaves a file that is complete as far as any reader can
know; every other one has to be noticed.
"""

import warnings
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import xarray as xr

import instruments
from labpipe.errors import LabpipeError

Amount = Callable[[int, int], int]
SAMPLES = Path(__file__).parents[2] / "../shared/samples"
HEAD = 4096  # bytes that are cut at each of them; beyond, at the ends of lines
FILES = {
    "rheocompass/freqsweep.csv": "Test:",
    "rheocompass/viscosity_curves.csv": "Test:",
    "rheocompass/multiple_relaxation.csv": "Test:",
    "mach1/dynamic_5_sinusoid_blocks.txt": "<INFO>",
}
"""Samples, and the word that begins their next table or block."""


def line_ends(data: bytes) -> Iterator[int]:
    end = b"\n\0" if data.startswith(b"\xff\xfe") else b"\n"
    at = 0
    while (at := data.find(end, at)) >= 0:
        at += len(end)
        yield at


def outcome(path: Path, data: bytes, instrument: str) -> tuple[xr.Dataset | None, bool]:
    """Read the bytes; the result, if there is one, and whether something was said against it."""
    path.write_bytes(data)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            found = instruments.read(path, instrument=instrument)
        except LabpipeError as error:
            assert "cut.txt" in str(error)  # noqa: PT017
            return None, True
    assert isinstance(found, xr.Dataset)
    return found, bool(caught)


@pytest.mark.skipif(not SAMPLES.is_dir(), reason="the public samples are not beside the checkout")
@pytest.mark.parametrize("name", FILES)
def test_no_cut_of_a_real_export_is_silent(tmp_path: Path, name: str, amount: Amount) -> None:
    data = (SAMPLES / name).read_bytes()
    encoding = "utf-16-le" if data.startswith(b"\xff\xfe") else "latin-1"
    instrument = "mach1" if name.startswith("mach1") else "anton_paar"
    path = tmp_path / "cut.txt"
    whole, _ = outcome(path, data, instrument)
    assert whole is not None
    late = [end for end in line_ends(data[:-4]) if end >= HEAD]
    cuts = [*range(1, min(HEAD, len(data)), amount(83, 3)), *late[:: -(-len(late) // amount(5, 100)) or 1]]
    for cut in cuts:
        found, is_noticed = outcome(path, data[:cut], instrument)
        if is_noticed or found is None or found.sizes["sample"] == whole.sizes["sample"]:
            continue
        rest = data[cut + cut % 2 :].decode(encoding, "replace").lstrip()
        assert rest.startswith(FILES[name]), (cut, dict(found.sizes))
