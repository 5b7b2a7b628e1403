"""Damaged Keyence files: the right line and column, or the right numbers; never fewer."""

import re

import numpy as np
import pytest

from instruments import keyence
from labpipe.errors import SourceError
from tests.faults import seeds

N_ROWS = 250  # more than are looked at to learn the layout


WHOLE = seeds.keyence_text(N_ROWS).decode()
HEAD, FIRST_ROW = WHOLE.split("\r\n1,")[0], WHOLE[: WHOLE.index("\r\n1,") + 2].count("\r\n") + 1
ROWS = WHOLE.split("\r\n")[FIRST_ROW - 1 : -1]
ROW = ROWS[5]
CELLS = ROW.split(",")
AT = FIRST_ROW + 5
LATE = FIRST_ROW + 230


def once(old, new):
    def damage(text):
        assert old in text
        return text.replace(old, new, 1)

    return damage


def line_of(needle):
    return WHOLE[: WHOLE.index(needle)].count("\r\n") + 1


def cell(index, new, row=ROW):
    cells = row.split(",")
    return once(row, ",".join([*cells[:index], new, *cells[index + 1 :]]))


def in_row(number, new):
    """Replace a whole row, counted from 0."""
    return once("\r\n" + ROWS[number] + "\r\n", "\r\n" + new + "\r\n" if new is not None else "\r\n")


def renumber(text, change):
    return re.sub(r"(?m)^(\d{1,3})(?=,[+-])", lambda match: str(change(int(match[1]))), text)


def column(index):
    return len(",".join(CELLS[:index])) + (2 if index else 1)


REFUSED = {
    "letter in a number": (cell(1, "+0x.1234"), AT, column(1), "expected a number"),
    "letter in the first row": (cell(1, "+0x.1234", ROWS[0]), FIRST_ROW, 3, "first row"),
    "empty cell": (cell(1, ""), AT, column(1), "expected a number"),
    "lost digit": (cell(1, "+01.234"), AT, column(1), "4 after the decimal sign"),
    "added cell": (in_row(5, ROW + ",+00.0001"), AT, len(ROW) + 2, "4 cells, expected 3"),
    "empty line among rows": (in_row(5, ""), AT, 1, "empty line"),
    "repeated row": (in_row(5, ROW + "\r\n" + ROW), None, None, "251 rows, the header states 250"),
    "swapped rows": (once(ROWS[5] + "\r\n" + ROWS[6], ROWS[6] + "\r\n" + ROWS[5]), AT + 1, 1, "6 after 7, expected 8"),
    "gap in the counter": (
        lambda t: renumber(t, lambda number: number + 3 * (number > 9)),
        FIRST_ROW + 9,
        1,
        "13 after 9, expected 10",
    ),
    "prose below the names": (once("OUT1,OUT2\r\n", "OUT1,OUT2\r\nhello\r\n"), FIRST_ROW, 1, "'hello'"),
    "unit that lost a letter": (once("Unit,mm", "Unit,m"), line_of("Unit"), None, "'m'"),
    "cycle without unit": (once("cycle,50us", "cycle,50"), line_of("Sampling"), None, "expected a time with its unit"),
    "count too high": (once("count,250", "count,300"), None, None, "the header states 300"),
    "empty": (lambda _: "", None, None, "empty"),
    "rows missing at the end": (lambda t: t[: t.rindex("\r\n250") + 2], None, None, "249 rows, the header states 250"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_damage_is_refused_where_it_is(tmp_path, name):
    damage, line, col, message = REFUSED[name]
    path = tmp_path / "damaged.csv"
    path.write_bytes(damage(WHOLE).encode())
    with pytest.raises(SourceError, match=re.escape(message)) as caught:
        keyence.read(path)
    assert caught.value.path == str(path)
    if line is not None:
        assert caught.value.line == line
    if col is not None:
        assert caught.value.column == col


def as_bytes(change, codec="utf-8"):
    return lambda text: change(text).encode(codec)


def same(text):
    return text


HARMLESS = {
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


@pytest.mark.parametrize("name", HARMLESS)
def test_change_of_form_leaves_the_numbers(tmp_path, name):
    path = tmp_path / "changed.dat"
    path.write_text(WHOLE, "utf-8", newline="")
    whole = keyence.read(path)
    path.write_bytes(HARMLESS[name](WHOLE))
    readings = keyence.read(path)
    for variable in ("time", "out1", "out2", "status1", "status2"):
        np.testing.assert_array_equal(readings[variable].values, whole[variable].values)


def test_ambiguous_thousands_are_refused_until_the_decimal_sign_is_given(tmp_path):
    path = tmp_path / "ambiguous.csv"
    rows = "".join(f"{i};1,23{i}\r\n" for i in range(1, 5))
    path.write_text(
        HEAD.replace(",", ";").replace(";OUT2", "").replace("mm;mm", "mm").replace("250", "4") + "\r\n" + rows,
        newline="",
    )
    with pytest.raises(SourceError, match=r'decimal="\." or decimal=","'):
        keyence.read(path)
    readings = keyence.read(path, decimal=",")
    np.testing.assert_allclose(readings.out1.values * 1e3, [1.231, 1.232, 1.233, 1.234])
