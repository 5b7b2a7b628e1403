"""Damaged Anton Paar exports: a clear error or a warning, never a shorter result in silence."""

import io
import re
import warnings
import zipfile

import numpy as np
import pytest

from instruments import anton_paar
from labpipe.errors import LabpipeError, SourceError
from tests.faults import seeds
from tests.instruments.test_anton_paar import book_of

WHOLE = anton_paar.assemble(seeds.anton_paar_intervals())
TEXT = seeds.anton_paar_text().decode()


def outcome(folder, data, **options):
    """Return the Dataset or the error, and the texts of the warnings."""
    path = folder / "export.csv"
    path.write_bytes(data)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            found = anton_paar.read(path, **options)
        except LabpipeError as error:
            found = error
    return found, [str(w.message) for w in caught]


def utf16(text):
    return b"\xff\xfe" + text.encode("utf-16-le")


def replaced(old, new, count=1):
    assert old in TEXT
    return TEXT.replace(old, new, count)


ROW = TEXT.split("\r\n")[10]  # the first row of data
SECOND = TEXT.split("\r\n")[11]
assert ROW.startswith("\t1\t10.0")

REFUSED = {
    "empty": ("", "empty"),
    "a_cell_added": (replaced("\t10.0\t", "\t10.0\t10.0\t"), "cells"),
    "point_repeated": (TEXT.replace(ROW, ROW + "\r\n" + ROW, 1), "expected a number above"),
    "blank_line_inside_a_table": (TEXT.replace(SECOND, "\r\n" + SECOND, 1), "outside a table"),
    "both_decimal_signs": (replaced("\t10.0\t", "\t10,05\t"), "decimal sign"),
    "last_line_without_end": (TEXT.removesuffix("\r\n")[:-4], "last line is cut"),
    "window_definition": ("<?xml version='1.0'?><Export Version='1'/>\r\n", "layout of a table"),
}

REPORTED = {
    "strain_unit_is_a_force": (replaced("Torque", "Shear Strain"), "expected a unit of 1"),
    "same_column_in_two_units": (
        replaced("Torque", "Foo").replace("[mN·m]", "[s]", 1).replace("Torque", "Foo"),
        "the column foo is in N m and s; it is left out",
    ),
    "declared_more_points": (replaced("points:\t1\t3", "points:\t1\t11"), "declares 11 points"),
    "second_project": (TEXT + "\r\n" + TEXT, "second project"),
    "count_line_lost": (replaced("Interval and data points:\t1\t3\r\n", ""), "without the line that states"),
    "no_row_in_the_last_table": (
        TEXT + "\r\nInterval and data points:\t2\t3\r\nInterval data:\tPoint No.\tTorque\r\n\t\t[mN·m]\r\n",
        "declares 3 points and holds 0",
    ),
    "ends_after_a_label": (TEXT + "\r\nTest:\tsample C\r\n", "ends after a label"),
}

HARMLESS = {
    "trailing_tabs": TEXT.replace("\r\n", "\t\t\r\n"),
    "sub_label_row_lost": TEXT.replace("\t" * 8 + "\r\n", ""),
    "spaces_around_numbers": TEXT.replace("\t10.0\t", "\t 10.0 \t"),
    "utf8_read_as_cp1252": TEXT.encode().decode("cp1252"),
}


@pytest.mark.parametrize("name", sorted(REFUSED))
def test_damage_is_refused_with_its_place(tmp_path, name):
    text, message = REFUSED[name]
    found, _ = outcome(tmp_path, utf16(text) if text else b"")
    assert isinstance(found, SourceError), found
    assert found.path is not None
    assert re.search(message, str(found)), str(found)


@pytest.mark.parametrize("name", sorted(REPORTED))
def test_doubtful_files_are_read_with_a_warning(tmp_path, name):
    text, message = REPORTED[name]
    found, said = outcome(tmp_path, utf16(text))
    assert not isinstance(found, Exception), found
    assert found.sizes["sample"] >= WHOLE.sizes["sample"]
    assert any(message in s for s in said), said


@pytest.mark.parametrize("name", sorted(HARMLESS))
def test_harmless_changes_change_nothing(tmp_path, name):
    found, said = outcome(tmp_path, utf16(HARMLESS[name]))
    assert not isinstance(found, Exception), found
    assert said == []
    for column in ("storage_modulus", "torque", "temperature"):
        np.testing.assert_allclose(found[column], WHOLE[column], rtol=1e-12)


BOOK = book_of(TEXT)
SHEET = "xl/worksheets/sheet1.xml"


def repacked(changes):
    stream = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(BOOK)) as source, zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as target:
        for name in source.namelist():
            target.writestr(name, changes.get(name, source.read(name)))
    return stream.getvalue()


def test_a_spreadsheet_error_in_a_cell_is_no_reading(tmp_path):
    with zipfile.ZipFile(io.BytesIO(BOOK)) as archive:
        sheet = archive.read(SHEET).decode()
    broken = sheet.replace('t="n"><v>11</v>', 't="e"><v>#REF!</v>', 1)
    found, _ = outcome(tmp_path, repacked({SHEET: broken.encode()}))
    assert np.isnan(found.storage_modulus.values).sum() == 1


def test_a_cell_far_away_costs_no_memory_of_this_process(tmp_path):
    with zipfile.ZipFile(io.BytesIO(BOOK)) as archive:
        sheet = archive.read(SHEET).decode()
    far = sheet.replace("</sheetData>", '<row r="1048576"><c r="XFD1048576"><v>1</v></c></row></sheetData>')
    found, _ = outcome(tmp_path, repacked({SHEET: far.encode()}))
    assert "the workbook is damaged or incomplete" in str(found)


def test_a_row_that_lost_a_cell_is_invalid_with_its_line(tmp_path):
    moved = "\t".join(SECOND.split("\t")[:3] + SECOND.split("\t")[4:-1]) + "\t"  # the rest moved left
    found, said = outcome(tmp_path, utf16(TEXT.replace(SECOND, moved, 1)))
    assert len(said) == 1
    assert re.search(r"line 12: 1 of 3 rows hold fewer than [78] cells; .* marked invalid", said[0])
    assert np.flatnonzero(found.is_valid.values == 0).tolist() == [1]
    for name in ("frequency", "storage_modulus", "loss_modulus", "temperature"):
        assert np.flatnonzero(np.isnan(found[name].values)).tolist() == [1]
