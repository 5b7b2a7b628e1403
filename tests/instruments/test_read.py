"""`instruments.read`: the content of a file decides, and what is not known is said."""

import importlib
import inspect
import os
import subprocess
import sys
from datetime import datetime

import numpy as np
import pytest

import instruments
from instruments import keyence, mach1
from labpipe.errors import SourceError


@pytest.fixture
def laser(tmp_path):
    path = tmp_path / "drop.csv"
    keyence.write(path, {1: np.linspace(0, 1e-3, 50)}, cycle="50 us", start=datetime(2024, 5, 14))
    return path


@pytest.fixture
def tester(tmp_path):
    time = np.arange(10) * 0.01
    columns = {"Time, s": time, "Position (z), mm": time, "Fz, N": time}
    block = mach1.make_block("Sinusoid", datetime(2024, 1, 1), columns, {})
    path = tmp_path / "wave.txt"
    mach1.write(path, mach1.assemble([block]))
    return path


@pytest.mark.parametrize("suffix", [".csv", ".txt", ".tif", ".cine", ""])
def test_content_decides_not_the_name(laser, tester, suffix):
    assert instruments.identify(laser.rename(laser.with_suffix(suffix))) == "keyence"
    assert instruments.identify(tester.rename(tester.with_name("wave2" + suffix))) == "mach1"


def test_unknown_content_lists_what_was_tried(tmp_path):
    path = tmp_path / "letter.csv"
    path.write_text("dear reader\n")
    with pytest.raises(SourceError, match="no instrument recognises the content") as caught:
        instruments.read(path)
    for each in instruments.OURS:
        assert each.name in str(caught.value)


def _touch(path):
    now = path.stat().st_mtime_ns
    os.utime(path, ns=(now + 10**9, now + 10**9))


def test_file_that_changes_once_is_read_again(laser, monkeypatch):
    calls = []
    real = keyence.read

    def changing(path, **options):
        result = real(path, **options)
        calls.append(path)
        if len(calls) == 1:
            _touch(path)
        return result

    monkeypatch.setattr(keyence, "read", changing)
    assert instruments.read(laser).sizes["time"] == 50
    assert len(calls) == 2


@pytest.mark.parametrize("each", instruments.OURS, ids=lambda each: each.name)
def test_options_are_those_that_the_reader_takes(each):
    module, function = each.reader.split(":")
    reader = getattr(importlib.import_module(module), function)
    path, *options = inspect.signature(reader).parameters.values()
    assert path.name == "path"
    assert all(option.kind is option.KEYWORD_ONLY for option in options)
    assert tuple(option.name for option in options) == each.option_names()


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes here")
def test_a_pipe_is_refused_at_once(tmp_path):
    os.mkfifo(tmp_path / "a.csv")
    for options in ({}, {"instrument": "keyence"}):
        with pytest.raises(SourceError, match="is a named pipe, expected a file"):
            instruments.read(tmp_path / "a.csv", **options)
    with pytest.raises(SourceError, match="is a device, expected a file"):
        instruments.read("/dev/zero")


def test_identifying_imports_no_numerical_library(tester):
    code = (
        "import sys, instruments; "
        f"assert instruments.identify({str(tester)!r}) == 'mach1'; "
        "sys.exit('numpy' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
