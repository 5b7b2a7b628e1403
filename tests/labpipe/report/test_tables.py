"""Numbers for readers: rounding after the GUM, prefixes, tables."""

import math

import pytest
from hypothesis import given, strategies as st

from labpipe.errors import InputError
from labpipe.report import Column, Listed, Table, display_unit, listed, plus_minus, value_with_uncertainty
from labpipe.report._tables import table_view
from tests.rounding import rounding


@pytest.mark.parametrize(
    ("value", "u", "unit", "text"),
    [
        (0.72918, 0.01234, "1", "0.729 ± 0.012"),
        (1.50234e-3, 12e-6, "m", "(1.502 ± 0.012) mm"),
        (-0.25, 0.031, "m/s", "(−250 ± 31) mm/s"),
        (0.5, 0.0996, "1", "0.50 ± 0.10"),
        (0.5, 0.0994, "1", "0.500 ± 0.099"),
        (1e-12, 5e-3, "1", "0.0000 ± 0.0050"),
        (21.04, 0.12, "degC", "(21.04 ± 0.12) °C"),
        (12.0, 0.2, "deg", "(12.00 ± 0.20)°"),
        (1.5e-3, 0.0, "m", "1.5 mm"),
        (math.nan, 0.1, "m", "–"),
        (0.7, math.nan, "1", "0.7000 (uncertainty unknown)"),
        (5.0, 0.1, "widgets", "(5.00 ± 0.10) widgets"),
    ],
)
def test_value_and_uncertainty_are_rounded_to_two_digits_of_the_uncertainty(value, u, unit, text):
    assert value_with_uncertainty(value, u, unit) == text


@given(st.floats(-1e12, 1e12, allow_subnormal=False), st.floats(1e-12, 1e9, allow_subnormal=False))
def test_what_is_written_stands_for_the_same_number(value, u):
    text = plus_minus(value, u).replace("−", "-")
    factor = 1.0
    if "×" in text:
        text, _, power = text.partition(" × 10")
        factor = 10.0 ** int(power.translate(str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")))
    shown_value, shown_u = (float(part) * factor for part in text.strip("()").split(" ± "))
    # Half a unit of the second digit of u is at most 5 % of u.
    assert abs(shown_u - u) <= 0.05 * u * (1 + 1e-9)
    assert abs(shown_value - value) <= 0.05 * u * (1 + 1e-9) + rounding(10, abs(value))


def test_prefix_follows_the_median_and_ignores_gaps():
    assert display_unit([math.nan, 0.0, 2e-6, 3e-6, 5.0], "m").text == "µm"
    assert display_unit([], "Pa").text == "Pa"
    assert display_unit([1e-30], "m").text == "nm"
    assert display_unit([1e-3 * (1 - 1e-12)], "m").text == "mm"


def test_a_column_has_one_prefix_and_joins_its_uncertainty():
    table = Table(
        (Column("touch", "s", digits=5), Column("depth", "m"), Column("note")),
        [(0.0319281, (34e-6, 1.2e-6), "first"), (0.08197, (math.nan, 1e-6), None)],
    )
    headings, rows = table_view(table)
    assert [(h.title, h.unit) for h in headings] == [("touch", "ms"), ("depth", "µm"), ("note", "")]
    assert [cell.text for cell in rows[0]] == ["31.928", "34.0 ± 1.2", "first"]
    assert [cell.text for cell in rows[1]] == ["81.970", "–", "–"]
    assert rows[0][1].key == repr(34e-6)


def test_rows_that_do_not_fit_and_negative_uncertainties_are_refused():
    with pytest.raises(InputError, match=r'"bounces": row 1 has 1 cells, expected 2'):
        Table((Column("a"), Column("b")), [(1, 2), (3,)], "bounces")
    with pytest.raises(InputError, match=r"cannot be negative, found -0\.1"):
        value_with_uncertainty(1.0, -0.1)


def test_a_table_is_made_of_columns_that_bring_their_cells():
    known = Listed("radius", [34e-6, 36e-6], "m", u=[1.2e-6, 1.1e-6])
    table = listed([Listed("impact", [1, 2, 3]), known], "peaks", sortable=False)
    _, rows = table_view(table)
    assert (table.caption, table.sortable) == ("peaks", False)
    assert [[cell.text for cell in row] for row in rows] == [["1", "34.0 ± 1.2"], ["2", "36.0 ± 1.1"], ["3", "–"]]
