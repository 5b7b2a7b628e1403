"""Damaged Mach-1 files: the right line and column, or the right numbers; never a shorter result."""

import re

import numpy as np
import pytest

from instruments import mach1
from labpipe.errors import SourceError
from tests.faults import seeds
from tests.instruments.mach1_blocks import split_blocks
from tests.instruments.test_keyence_damage import as_bytes, once, same

WHOLE = seeds.mach1_text(30).decode("ascii")
FIRST, SECOND = WHOLE[: WHOLE.index("<INFO>", 40)], WHOLE[WHOLE.index("<INFO>", 40) :]


def line_of(needle, text=WHOLE, nth=0):
    found = [m.start() for m in re.finditer(re.escape(needle), text)]
    return text[: found[nth]].count("\r\n") + 1


def row(block, number):
    """A row of a block without its line end: the ``number``-th that begins with a digit."""
    part = FIRST if block == 0 else SECOND
    return [line for line in part.split("\r\n") if re.match(r"[0-9]", line)][number]


def after_last(old, new):
    def damage(text):
        head, found, tail = text.rpartition(old)
        assert found
        return head + new + tail

    return damage


ROW = row(0, 5)
CELLS = ROW.split("\t")
AT = line_of(ROW)


def cell(index, new):
    """Damage one cell of the sixth row of the first block."""
    return once(ROW, "\t".join([*CELLS[:index], new, *CELLS[index + 1 :]]))


def column(index):
    return len("\t".join(CELLS[:index])) + (2 if index else 1)


# name: (damage, line, column or None, part of the message)
REFUSED = {
    "letter in a number": (cell(2, "-0.2x5"), AT, column(2), "expected a number"),
    "empty cell": (cell(1, ""), AT, column(1), "expected a number"),
    "added cell": (once(ROW, ROW + "\t1.0"), AT, len(ROW) + 2, "4 cells, expected 3"),
    "empty line among rows": (once(ROW, ""), AT, 1, "1 cells"),
    "repeated row": (once(ROW, ROW + "\r\n" + ROW), AT + 1, 1, "does not go on"),
    "missing row": (once(ROW + "\r\n", ""), AT, 1, "rows are missing"),
    "unit that lost a letter": (once("(z), mm\t", "(z), m\t"), AT - 6, None, "found the unit 'm', expected mm"),
    "no time column": (once("Time, s\t", "Zeit, s\t"), AT - 6, 1, "expected 'Time, s'"),
    "END INFO missing": (once("<END INFO>\r\n", ""), line_of("<END INFO>"), 1, "<END INFO>"),
    "END DATA missing": (once("<END DATA>\r\n", ""), line_of("<END DATA>"), 1, "<END DATA>"),
    "letter in the calibration factor": (once("1.000491", "1.00x491"), line_of("1.000491"), 31, "'1.00x491'"),
    "no END DATA at the end": (after_last("<END DATA>\r\n", ""), None, None, "expected <END DATA>"),
    "empty": (lambda _: "", None, None, "empty"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_damage_is_refused_where_it_is(tmp_path, name):
    damage, line, col, message = REFUSED[name]
    path = tmp_path / "damaged.txt"
    path.write_bytes(damage(WHOLE).encode())
    with pytest.raises(SourceError, match=re.escape(message)) as caught:
        mach1.read(path)
    assert caught.value.path == str(path)
    if line is not None:
        assert caught.value.line == line
    if col is not None:
        assert caught.value.column == col


# Changes of form that leave every number what it is.
HARMLESS = {
    "untouched": as_bytes(same),
    "UTF-8 mark": as_bytes(same, "utf-8-sig"),
    "UTF-16 little end first": lambda t: ("\ufeff" + t).encode("utf-16-le"),
    "LF only": as_bytes(lambda t: t.replace("\r\n", "\n")),
    "no line end after END DATA": as_bytes(lambda t: t.rstrip("\r\n")),
    "tabs after tags and keys": as_bytes(lambda t: re.sub(r"(?m)^(<.*>|[A-Z].*:\t.*)\r", r"\1\t\t\r", t)),
    "unknown function": as_bytes(once("<Stress Relaxation>", "<Normal Indentation>")),
    "no filter declared": as_bytes(lambda t: re.sub(r"Load Cell Low-pass filter[^\r]*\r\n", "", t)),
}


def whole_of(folder):
    (folder / "whole.txt").write_bytes(WHOLE.encode())
    return mach1.read(folder / "whole.txt")


@pytest.mark.parametrize("name", HARMLESS)
def test_change_of_form_leaves_the_numbers(tmp_path, name):
    whole, path = whole_of(tmp_path), tmp_path / "changed.dat"
    path.write_bytes(HARMLESS[name](WHOLE))
    readings = mach1.read(path)
    for variable in ("time", "block", "segment", "position_z", "force_z"):
        np.testing.assert_array_equal(readings[variable].values, whole[variable].values)


def test_decimal_comma_is_read_with_the_option(tmp_path):
    path = tmp_path / "comma.txt"
    path.write_text(re.sub(r"(?<=\d)\.(?=\d)", ",", WHOLE), newline="")
    with pytest.warns(UserWarning, match="date and time"):  # the clock has a comma too
        readings = mach1.read(path, decimal=",")
    np.testing.assert_array_equal(readings.force_z.values, whole_of(tmp_path).force_z.values)


def test_empty_data_section_and_silent_functions_are_blocks(tmp_path):
    path = tmp_path / "blocks.txt"
    info = SECOND[: SECOND.index("<Sinusoid>")]
    text = (
        f"<Mach-1 File>\r\n{info}<Zero Load>\r\n"
        f"{info}<Find Contact>\r\nContact Criteria, gf:\t0.5000\r\nStage Repositioning:\tNone\r\n"
        "<DATA>\r\nTime, s\tPosition (z), mm\tFz, gf\r\n<END DATA>\r\n"
        f"{SECOND}{info}<Wait>\r\nWait Time (HH:MM:SS):\t00:00:05\r\n"
    )
    path.write_text(text, newline="")
    readings = mach1.read(path)
    assert readings.function.values.tolist() == ["Zero Load", "Find Contact", "Sinusoid", "Wait"]
    assert readings.n_rows.values.tolist() == [0, 0, 30, 0]
    assert readings.declared_contact_force.values[1] == pytest.approx(0.5 * 0.00980665)
    assert mach1.encode(readings) == path.read_bytes()
    assert [block.sizes["time"] for block in split_blocks(readings)] == [0, 0, 30, 0]


def test_incomplete_file_is_read_on_request_and_marked(tmp_path):
    path = tmp_path / "cut.txt"
    cut = WHOLE.index(row(1, 20)) + 12
    path.write_text(WHOLE[:cut], newline="")
    with pytest.warns(UserWarning, match="expected <END DATA>"):
        readings = mach1.read(path, allow_incomplete=True)
    assert readings.n_rows.values.tolist() == [30, 20]  # the cut row is dropped
    assert readings.is_complete.values.tolist() == [1, 0]
    assert readings.attrs["incomplete"] == 1
