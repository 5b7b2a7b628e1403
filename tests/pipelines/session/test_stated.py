"""Masses and heights from the student's workbook, where session.toml leaves them out."""

import re
import shutil
from pathlib import Path

import openpyxl
import pytest

import labpipe as lp
from labpipe.errors import ConfigError
from pipelines.session import open_session

STATED = (
    'stated = { file = "masses.xlsx", row = "Specimen", rows = { drop = "A3" }, '
    'columns = { mass = "m / g", u_mass = "u(m) / g", height = "drop height (mm)" } }\n'
)


def write(folder: Path, mass: object = 505.25, stated: str = STATED) -> Path:
    """Leave mass and height of the drop to a workbook."""
    book = openpyxl.Workbook()
    sheet = book.active
    assert sheet is not None
    sheet.title = "balance"
    for row in (["weighed on Monday"], [], ["specimen", "m / g", "u(m) / g", "drop height (mm)", "remark"]):
        sheet.append(row)
    sheet.append(["A2", 411.0, 0.5, "7 ± 0.01", ""])
    sheet.append(["A3", mass, 0.5, "1.5 ± 0.005", "the good one"])
    book.save(folder / "masses.xlsx")
    toml = folder / "session.toml"
    text = toml.read_text("utf-8").replace("[session]\n", f"[session]\n{stated}")
    lines = [line for line in text.splitlines() if not line.startswith("height")]
    text = "\n".join(lines).replace('mass = "505.0 ± 0.5 g"', 'mass = "FILL g"')
    toml.write_text(text + "\n", "utf-8")
    return folder


def test_values_of_the_row_are_taken_and_the_page_says_where_from(session_copy: Path) -> None:
    settings = open_session(write(session_copy)).experiments["drop"].settings
    assert (settings.sphere.mass.value, settings.sphere.mass.u) == pytest.approx((0.50525, 0.5e-3))
    assert (settings.height.value, settings.height.u) == pytest.approx((1.5e-3, 5e-6))
    lp.process(session_copy, only="drop", jobs=0)
    page = lp.report(session_copy, "drop").html
    assert "mass 505.25 ± 0.5 g, height 1.5 ± 0.005 mm: from masses.xlsx, sheet balance, row 5 (A3)" in page


@pytest.mark.parametrize(
    ("mass", "stated", "message"),
    [
        ("abc", STATED, r'masses.xlsx, sheet balance, row 5: .*abc.*; correct the cell in column "m / g", or write '),
        (-3, STATED, r"session.toml:\d+: experiments.drop.sphere.mass: must be > 0 kg, found -3"),
        (505, STATED.replace("A3", "A7"), r'sheet balance: no row is "A7" in column "Specimen"'),
        (505, STATED.replace('drop = "A3"', 'dorp = "A3"'), r'there is no experiment "dorp"; did you mean "drop"'),
        (505, STATED.replace('"m / g"', '"mass / g"'), r'no row of headings has "mass / g"; correct the headings here'),
        (505, STATED.replace("masses.xlsx", "massses.xlsx"), r'no file "massses.xlsx" .*did you mean "masses.xlsx"'),
    ],
)
def test_a_mistake_is_named_with_sheet_row_and_line(
    small_session: Path, tmp_path: Path, mass: object, stated: str, message: str
) -> None:
    folder = write(Path(shutil.copytree(small_session, tmp_path / "session")), mass, stated)
    try:
        told = [line for lines in open_session(folder).waiting.values() for line in lines]
    except ConfigError as error:
        told = [*error.problems]
    assert any(re.search(message, line) and re.match(r"session.toml:\d+: ", line) for line in told), told
