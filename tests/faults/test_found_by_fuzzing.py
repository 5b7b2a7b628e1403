"""Inputs that once ended in anything but a result or an error of labpipe, one case each."""

import contextlib
import warnings
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import instruments
from calibration.record import load_record
from instruments.images._files import read_headers
from labpipe.errors import LabpipeError
from labpipe.workflow.session import load
from pipelines.session import SETTINGS

CORPUS = sorted(path for path in Path(__file__).parent.glob("corpus/*/*") if path.is_file())


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
