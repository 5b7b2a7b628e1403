"""Damaged Mach-1 files: the right line and column, or the right numbers; never a shorter result."""

import re
import warnings
from datetime import datetime

import numpy as np
import pytest
from hypothesis import given

from instruments import mach1
from labpipe.errors import LabpipeError, SourceError
from tests.by_day import by_day
from tests.instruments.mach1_blocks import split_blocks
from tests.instruments.mutations import mutated, mutations, usual


def _blocks():
    time = np.arange(30) * 0.01
    ramp = mach1.make_block(
        "Stress Relaxation",
        datetime(2023, 7, 19, 12, 14, 21),
        {
            "Time, s": time,
            "Position (z), mm": 1.574e-4 + 1e-5 * time,
            "Position (theta), deg": np.zeros(30),
            **{f"F{axis}, N": -0.25 - 0.1 * time for axis in "xyz"},
            **{f"T{axis}, N-mm": 1.1e-3 + 1e-3 * time for axis in "xyz"},
        },
        {
            "Stage Axis": "Position (z)",
            "Amplitude, mm": "0.0393",
            "Number of Ramp": "3",
            "Relaxation Rate, N/min": "0.0100",
        },
        load_cell=mach1.LOAD_CELLS["17N"],
        dividers=(10, 20, 30),
    )
    wave = mach1.make_block(
        "Sinusoid",
        datetime(2023, 7, 19, 12, 20),
        {"Time, s": time, "Position (z), mm": 1e-3 + 1e-5 * np.sin(40 * time), "Fz, gf": 190 + np.sin(40 * time)},
        {"Stage Axis": "Position (z)", "Amplitude, mm": "0.0100", "Frequency, Hz": "6.36620"},
    )
    return ramp, wave


WHOLE = mach1.encode(mach1.assemble(_blocks())).decode("ascii")
FIRST, SECOND = WHOLE[: WHOLE.index("<INFO>", 40)], WHOLE[WHOLE.index("<INFO>", 40) :]


def line_of(needle, text=WHOLE, nth=0):
    found = [m.start() for m in re.finditer(re.escape(needle), text)]
    return text[: found[nth]].count("\r\n") + 1


def row(block, number):
    """A row of a block without its line end: the ``number``-th that begins with a digit."""
    part = FIRST if block == 0 else SECOND
    return [line for line in part.split("\r\n") if re.match(r"[0-9]", line)][number]


def once(old, new):
    """Replace the first place only, and make sure that there is one."""

    def damage(text):
        assert old in text
        return text.replace(old, new, 1)

    return damage


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
    "letter in a number": (cell(5, "-0.2x5"), AT, column(5), "expected a number"),
    "empty cell": (cell(3, ""), AT, column(3), "expected a number"),
    "added cell": (once(ROW, ROW + "\t1.0"), AT, len(ROW) + 2, "10 cells, expected 9"),
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


def as_bytes(change, codec="ascii", errors="strict"):
    return lambda text: change(text).encode(codec, errors)


def same(text):
    return text


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


@pytest.mark.parametrize("name", HARMLESS)
def test_change_of_form_leaves_the_numbers(tmp_path, name):
    whole = mach1.assemble(_blocks())
    path = tmp_path / "changed.dat"
    path.write_bytes(HARMLESS[name](WHOLE))
    readings = mach1.read(path)
    for variable in ("time", "block", "segment", "position_z", "force_z", "torque_z"):
        np.testing.assert_array_equal(readings[variable].values, whole[variable].values)


def test_decimal_comma_is_read_with_the_option(tmp_path):
    path = tmp_path / "comma.txt"
    path.write_text(re.sub(r"(?<=\d)\.(?=\d)", ",", WHOLE), newline="")
    with pytest.warns(UserWarning, match="date and time"):  # the clock has a comma too
        readings = mach1.read(path, decimal=",")
    np.testing.assert_array_equal(readings.force_z.values, mach1.assemble(_blocks()).force_z.values)


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


def _reads_as(path, data):
    """Rows per block, or None when the file is refused."""
    path.write_bytes(data)
    try:
        return tuple(mach1.read(path).n_rows.values.tolist())
    except SourceError:
        return None


@pytest.mark.parametrize("stride", by_day([7, 1], 1))
def test_no_truncation_gives_a_shorter_result_without_an_error(tmp_path, stride):
    data = WHOLE.encode()
    assert len(data) > 4096
    ends = [m.end() for m in re.finditer(b"\r\n", data)]
    cuts = [*range(0, 4096, stride), *(end for end in ends if end >= 4096)]
    end_of_first = len(FIRST)
    path = tmp_path / "cut.txt"
    for cut in cuts:
        found = _reads_as(path, data[:cut])
        if cut in (end_of_first - 2, end_of_first - 1, end_of_first):
            # What stands before this byte is a complete file of one block; nothing in it tells.
            assert found == (30,)
        else:
            assert found == ((30, 30) if cut >= len(data) - 2 else None), cut


def _oracle(text):
    """Rows of a file that holds only well-formed numbers, read in the most naive way."""
    rows, is_data = [], False
    for line in text.replace("\r\n", "\n").replace("\r", "\n").split("\n"):
        is_data = line.startswith("Time, s") or (is_data and "END" not in line)
        if is_data and line and not line.startswith(("T", "<")):
            rows.append([float(cell) for cell in line.split("\t")])
    return rows


PIECES = [b"\t", b"\r\n", b"\r", b"<", b"-", b".", b",", b"e9", b"nan", b"<END DATA>\r\n"]
MUTATIONS = mutations(PIECES)


def check_mutation(path, steps):
    """A mutated file is refused, or every number read is the one that stands in the file."""
    data = mutated(WHOLE.encode(), steps)
    path.write_bytes(data)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", UserWarning)
        try:
            readings = mach1.read(path)
        except LabpipeError:
            return
    if any("is not known" in str(warning.message) for warning in caught):
        return  # a damaged column name was reported
    rows = _oracle(data.decode(readings.attrs["encoding"]))
    assert len(rows) == readings.sizes["sample"]
    np.testing.assert_array_equal(readings.time.values, [r[0] for r in rows])
    np.testing.assert_array_equal(readings.position_z.values, [r[1] * 1e-3 for r in rows])


@usual
@given(MUTATIONS)
def test_mutations_are_refused_or_read_as_they_stand(tmp_path, steps):
    check_mutation(tmp_path / "mutated.txt", steps)
