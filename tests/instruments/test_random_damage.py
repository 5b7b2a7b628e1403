"""Exports with random damage: an error of ours, a warning, or the numbers that stand in the file; never fewer."""

import random
import re
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
import xarray as xr

import instruments
from labpipe.errors import LabpipeError
from tests.faults import seeds
from tests.instruments.tables_of_sweeps import ALL, table

Amount = Callable[[int, int], int]


class Form(NamedTuple):
    """A whole file, two of its columns by their place in a row, and their variables with the unit of the file in SI.

    ``words`` state what these columns are: where one is damaged, they are other columns. ``sign`` parts the cells.
    """

    data: bytes
    places: tuple[int, int]
    variables: dict[str, float]
    words: tuple[str, ...]
    sign: str


FORMS = {
    "mach1": Form(
        seeds.mach1_text(30), (0, 1), {"time": 1.0, "position_z": 1e-3}, ("Time, s\tPosition (z), mm",), "\t"
    ),
    "keyence": Form(
        seeds.keyence_text(60), (1, 2), {"out1": 1e-3, "out2": 1e-3}, ("Unit,mm,mm", "No.,OUT1,OUT2"), r"(?<=.)[,;\t]"
    ),
    "anton_paar": Form(
        seeds.anton_paar_text(),
        (2, 3),
        {"angular_frequency": 1.0, "storage_modulus": 1e6},
        ("Interval data:\tPoint No.\tAngular Frequency\tStorage Modulus", "\t\t[rad/s]\t[MPa]"),
        "\t",
    ),
    "plain_table": Form(
        ("Sample: X\n" + table("f (Hz),E' (MPa),E'' (MPa),T (°C)", *ALL)).encode(),
        (0, 1),
        {"frequency": 1.0, "storage_modulus": 1e6},
        ("f (Hz),E' (MPa),E'' (MPa),T (°C)",),
        ",",
    ),
}
PIECES = [b",", b";", b"\t", b"\r\n", b"\r", b"-", b".", b"9", b"e9", b"+FFFFFFF", b"nan", b"<", b'"', b" "]
PIECES += [b"[", b"\xc3"]


def damaged(data: bytes, source: random.Random) -> bytes:
    """Change, delete or insert some bytes, or drop, repeat or exchange lines, one to three times."""
    for _ in range(source.choice((1, 1, 3))):
        at, piece = source.randrange(len(data) + 1), b"".join(source.choices(PIECES, k=source.randrange(1, 4)))
        lines = data.split(b"\n")
        i, j = source.randrange(len(lines)), source.randrange(len(lines))
        action = source.randrange(6)
        if action < 3:
            data = data[:at] + (b"" if action == 0 else piece) + data[at + source.randrange(1, 8) * (action < 2) :]
            continue
        if action == 3:
            del lines[i]
        elif action == 4:
            lines.insert(i, lines[i])
        else:
            lines[i], lines[j] = lines[j], lines[i]
        data = b"\n".join(lines)
    return data


def outcome(path: Path, name: str, data: bytes) -> tuple[xr.Dataset | None, bool]:
    """Return the readings, None where the file is refused, and whether there were warnings."""
    path.write_bytes(data)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            found = instruments.read(path, instrument=name)
        except LabpipeError:
            return None, True
    assert isinstance(found, xr.Dataset)
    return found, bool(caught)


def pairs(text: str, form: Form) -> set[tuple[float, float]]:
    """Read two columns of all rows in the most naive way."""
    found = set()
    for line in re.split("\r\n|\r|\n", text):
        cells = [cell.strip().strip('"').strip() for cell in re.split(form.sign, line)]
        if len(cells) > max(form.places):
            try:
                found.add(tuple(float(cells[place]) for place in form.places))
            except ValueError:
                continue
    return found


def numbers(found: xr.Dataset, form: Form) -> set[tuple[float, float]]:
    """Return the readings of the two columns in the units of the file."""
    columns = [[float(f"{x:.12g}") for x in found[name].values / unit] for name, unit in form.variables.items()]
    return {row for row in zip(*columns, strict=True) if np.isfinite(row).all()}


@pytest.mark.parametrize("name", FORMS)
def test_what_is_read_of_a_damaged_file_stands_in_it(tmp_path: Path, name: str, amount: Amount) -> None:
    form, read = FORMS[name], 0
    whole, _ = outcome(tmp_path / "a.txt", name, form.data)
    assert whole is not None
    rounded = lambda found: {tuple(float(f"{x:.12g}") for x in row) for row in found}  # noqa: E731
    assert numbers(whole, form) == rounded(pairs(form.data.decode(), form))
    for seed in range(amount(200, 20_000)):
        data = damaged(form.data, random.Random(seed))
        found, is_noted = outcome(tmp_path / "a.txt", name, data)
        if found is None or is_noted:
            continue
        text, before = data.decode(found.attrs["encoding"], "replace"), form.data.decode()
        if any(text.count(word) < before.count(word) for word in form.words):
            continue  # other quantities or units then, as the headings state
        read += 1
        below = text.partition(form.words[-1])[2]
        untouched = set(re.split("\r\n|\r|\n", below)) & set(before.splitlines())
        assert rounded(pairs("\n".join(untouched), form)) <= numbers(found, form), (seed, data)
        if name != "plain_table":  # which reads other signs between cells, too
            assert numbers(found, form) <= rounded(pairs(text, form)), (seed, data)
    assert read > 3


@pytest.mark.parametrize("name", ["mach1", "keyence", "anton_paar"])
def test_a_cut_file_is_never_shorter_in_silence(tmp_path: Path, name: str, amount: Amount) -> None:
    """Where a block or an interval ends, what stands before is a complete file; nothing in it tells."""
    data = FORMS[name].data
    ends = [m.start() for m in re.finditer(b"<INFO>|Interval and data|Test:", data)]
    for cut in [*range(0, len(data) - 2, amount(7, 1)), *(m.end() for m in re.finditer(b"\n", data[:-1]))]:
        found, is_noted = outcome(tmp_path / "a.txt", name, data[:cut])
        assert found is None or is_noted or any(end - 4 <= cut <= end for end in ends), cut
