"""Damaged files of the laser and of the tester: the right line and column, or the right numbers; never fewer."""

import re

import numpy as np
import pytest

from instruments import keyence, mach1
from labpipe.errors import SourceError
from tests.faults import seeds
from tests.instruments.mach1_blocks import split_blocks

N_ROWS = 250  # more than are looked at to learn the layout
LASER = seeds.keyence_text(N_ROWS).decode()
HEAD, FIRST_ROW = LASER.split("\r\n1,")[0], LASER[: LASER.index("\r\n1,") + 2].count("\r\n") + 1
ROWS = LASER.split("\r\n")[FIRST_ROW - 1 : -1]
TESTER = seeds.mach1_text(30).decode("ascii")
FIRST, SECOND = TESTER[: TESTER.index("<INFO>", 40)], TESTER[TESTER.index("<INFO>", 40) :]
SAMPLES_1, SAMPLES_2 = ([line for line in part.split("\r\n") if line[:1].isdigit()] for part in (FIRST, SECOND))
ROW, LINE = ROWS[5], SAMPLES_1[5]
AT, FROM = FIRST_ROW + 5, TESTER[: TESTER.index(LINE)].count("\r\n") + 1


def once(old, new):
    def damage(text):
        assert old in text
        return text.replace(old, new, 1)

    return damage


def line_of(text, needle):
    return text[: text.index(needle)].count("\r\n") + 1


def cell(row, sign, index, new):
    cells = row.split(sign)
    return once(row, sign.join([*cells[:index], new, *cells[index + 1 :]]))


def column(row, sign, index):
    return len(sign.join(row.split(sign)[:index])) + (2 if index else 1)


def renumber(text, change):
    return re.sub(r"(?m)^(\d{1,3})(?=,[+-])", lambda match: str(change(int(match[1]))), text)


# name: (damage, line, column, part of the message)
OF_LASER = {
    "quotation mark in a number": (cell(ROW, ",", 1, '+01."234'), AT, column(ROW, ",", 1), "expected a number"),
    "letter in the first row": (cell(ROWS[0], ",", 1, "+0x.1234"), FIRST_ROW, 3, "first row"),
    "empty cell": (cell(ROW, ",", 1, ""), AT, column(ROW, ",", 1), "expected a number"),
    "lost digit": (cell(ROW, ",", 1, "+01.234"), AT, column(ROW, ",", 1), "4 after the decimal sign"),
    "empty line among rows": (once(ROW, ""), AT, 1, "empty line"),
    "repeated row": (once(ROW, ROW + "\r\n" + ROW), None, None, "251 rows, the header states 250"),
    "swapped rows": (once(ROWS[5] + "\r\n" + ROWS[6], ROWS[6] + "\r\n" + ROWS[5]), AT + 1, 1, "6 after 7, expected 8"),
    "gap in the counter": (
        lambda t: renumber(t, lambda n: n + 3 * (n > 9)),
        FIRST_ROW + 9,
        1,
        "13 after 9, expected 10",
    ),
    "prose below the names": (once("OUT1,OUT2\r\n", "OUT1,OUT2\r\nhello\r\n"), FIRST_ROW, 1, "'hello'"),
    "unit that lost a letter": (once("Unit,mm", "Unit,m"), line_of(LASER, "Unit"), None, "'m'"),
    "cycle without unit": (once("cycle,50us", "cycle,50"), line_of(LASER, "Sampling"), None, "a time with its unit"),
    "rows missing at the end": (lambda t: t[: t.rindex("\r\n250") + 2], None, None, "249 rows, the header states 250"),
}
OF_TESTER = {
    "empty cell": (cell(LINE, "\t", 1, ""), FROM, column(LINE, "\t", 1), "expected a number"),
    "added cell": (once(LINE, LINE + "\t1.0"), FROM, len(LINE) + 2, "4 cells, expected 3"),
    "empty line among rows": (once(LINE, ""), FROM, 1, "1 cells"),
    "repeated row": (once(LINE, LINE + "\r\n" + LINE), FROM + 1, 1, "does not go on"),
    "no time column": (once("Time, s\t", "Zeit, s\t"), FROM - 6, 1, "expected 'Time, s'"),
    "END INFO missing": (once("<END INFO>\r\n", ""), line_of(TESTER, "<END INFO>"), 1, "<END INFO>"),
    "END DATA missing": (once("<END DATA>\r\n", ""), line_of(TESTER, "<END DATA>"), 1, "<END DATA>"),
    "letter in the calibration factor": (once("1.000491", "1.00x491"), line_of(TESTER, "1.000491"), 31, "'1.00x491'"),
    "empty": (lambda _: "", None, None, "empty"),
}
REFUSED = [(keyence.read, LASER, *case) for case in OF_LASER.values()]
REFUSED += [(mach1.read, TESTER, *case) for case in OF_TESTER.values()]


@pytest.mark.parametrize(("read", "whole", "damage", "line", "col", "message"), REFUSED, ids=[*OF_LASER, *OF_TESTER])
def test_damage_is_refused_where_it_is(tmp_path, read, whole, damage, line, col, message):
    path = tmp_path / "damaged.txt"
    path.write_bytes(damage(whole).encode())
    with pytest.raises(SourceError, match=re.escape(message)) as caught:
        read(path)
    assert caught.value.path == str(path)
    assert line in (None, caught.value.line)
    assert col in (None, caught.value.column)


def as_bytes(change, codec="utf-8"):
    return lambda text: change(text).encode(codec)


def same(text):
    return text


# Changes of form that leave every number what it is.
FORMS_OF_LASER = {
    "untouched": as_bytes(same),
    "Japanese header in cp932": as_bytes(once("Remark", "備考"), "cp932"),
    "LF only": as_bytes(lambda t: t.replace("\r\n", "\n")),
    "no line end at the end, count stated": as_bytes(lambda t: t[:-2]),
    "blank lines at the end": as_bytes(lambda t: t + "\r\n\r\n"),
    "everything quoted": as_bytes(
        lambda t: re.sub(r"(?m)^(.+?)\r", lambda m: '"' + m[1].replace(",", '","') + '"\r', t)
    ),
    "no count stated": as_bytes(once("Data count,250\r\n", "")),
    "unpadded numbers": as_bytes(lambda t: re.sub(r"\+0(?=\d\.)", "", t).replace("-0", "-")),
}
FORMS_OF_TESTER = {
    "untouched": as_bytes(same),
    "UTF-8 mark": as_bytes(same, "utf-8-sig"),
    "UTF-16 little end first": lambda t: ("\ufeff" + t).encode("utf-16-le"),
    "LF only": as_bytes(lambda t: t.replace("\r\n", "\n")),
    "no line end after END DATA": as_bytes(lambda t: t.rstrip("\r\n")),
    "tabs after tags and keys": as_bytes(lambda t: re.sub(r"(?m)^(<.*>|[A-Z].*:\t.*)\r", r"\1\t\t\r", t)),
    "unknown function": as_bytes(once("<Stress Relaxation>", "<Normal Indentation>")),
    "no filter declared": as_bytes(lambda t: re.sub(r"Load Cell Low-pass filter[^\r]*\r\n", "", t)),
}
HARMLESS = [(keyence.read, LASER, form) for form in FORMS_OF_LASER.values()]
HARMLESS += [(mach1.read, TESTER, form) for form in FORMS_OF_TESTER.values()]


@pytest.mark.parametrize(("read", "whole", "form"), HARMLESS, ids=[*FORMS_OF_LASER, *FORMS_OF_TESTER])
def test_change_of_form_leaves_the_numbers(tmp_path, read, whole, form):
    path = tmp_path / "changed.dat"
    path.write_bytes(whole.encode())
    expected = read(path)
    path.write_bytes(form(whole))
    readings = read(path)
    for variable in {"time", "block", "segment", "position_z", "force_z", "out1", "out2", "status1"} & {
        *expected.variables
    }:
        np.testing.assert_array_equal(readings[variable].values, expected[variable].values)


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
    cut = TESTER.index(SAMPLES_2[20]) + 12
    path.write_text(TESTER[:cut], newline="")
    with pytest.warns(UserWarning, match="expected <END DATA>"):
        readings = mach1.read(path, allow_incomplete=True)
    assert readings.n_rows.values.tolist() == [30, 20]  # the cut row is dropped
    assert readings.is_complete.values.tolist() == [1, 0]
    assert readings.attrs["incomplete"] == 1
