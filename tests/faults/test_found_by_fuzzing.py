"""Inputs that once ended in anything but a result or an error of labpipe, one case each."""

import contextlib
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import instruments
from calibration.record import load_record
from instruments import dice, keyence
from instruments.images._files import read_headers
from labpipe.errors import LabpipeError, SourceError
from labpipe.workflow.session import load
from pipelines.session import SETTINGS
from tests.faults import seeds

CORPUS = sorted(path for path in Path(__file__).parent.glob("corpus/*/*") if path.is_file())
KEYENCE = seeds.keyence_text()


def changed(data: bytes, old: bytes, new: bytes) -> bytes:
    assert old in data
    return data.replace(old, new, 1)


REFUSED: dict[str, tuple[bytes, Callable[[Path], object], str]] = {
    "a sampling cycle beyond any number": (changed(KEYENCE, b"50us", b"501e999us"), keyence.read, "sampling cycle"),
    "a storage factor of 500 digits": (changed(KEYENCE, b"x1", b"x" + b"9" * 500), keyence.read, "storage cycle"),
    "a point at infinity": (
        b"COORDINATE_X,COORDINATE_Y,DISPLACEMENT_X,DISPLACEMENT_Y\n1,2,3,-inf\n",
        lambda path: dice.read(path.rename(path.with_name("DICe_solution_0.txt"))),
        "-inf",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_it_is_refused_with_its_place(tmp_path: Path, name: str) -> None:
    data, read, words = REFUSED[name]
    (tmp_path / "a.txt").write_bytes(data)
    with pytest.raises(SourceError, match=words) as caught:
        read(tmp_path / "a.txt")
    assert caught.value.line is not None


def attempt(target: str, path: Path) -> None:
    """Read a file, of a film its times and some frames too."""
    if target == "configuration":
        load(path, SETTINGS, may_wait=True)
    elif target == "record":
        load_record(path)
    elif target == "image":
        read_headers(path)
    else:
        found = instruments.read(path, instrument=target, **({"cycle": "50 us"} if target == "keyence" else {}))
        if not isinstance(found, xr.Dataset):
            assert np.isfinite(found.time).all()
            assert all(found[int(index)].shape == found.shape[1:] for index in np.flatnonzero(found.valid)[:4])


@pytest.mark.parametrize("path", CORPUS, ids=lambda path: f"{path.parent.name}/{path.name}")
def test_the_corpus_of_the_fuzzer_is_read_or_refused(tmp_path: Path, path: Path) -> None:
    """One file for each kind of fault that coverage-guided fuzzing (atheris) found; warnings of numpy count too."""
    copy = tmp_path / ("session.toml" if path.parent.name == "configuration" else "input")
    copy.write_bytes(path.read_bytes())
    with warnings.catch_warnings(), contextlib.suppress(LabpipeError):
        warnings.simplefilter("error")
        warnings.simplefilter("ignore", UserWarning)
        attempt(path.parent.name, copy)
