"""Ticks of the still pictures: round numbers inside the range, written as what they are."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from labpipe.report.ticks import ticks

RAISED = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁻", "0123456789-")


def number(text):
    """Read a tick as a reader does."""
    factor, _, power = text.replace("\N{MINUS SIGN}", "-").rpartition("·")
    if power.startswith("10") and any(c in "⁰¹²³⁴⁵⁶⁷⁸⁹⁻" for c in power):
        return float(factor or 1) * 10.0 ** float(power[2:].translate(RAISED))
    return float(text.replace("\N{MINUS SIGN}", "-"))


@given(
    low=st.floats(-1e12, 1e12),
    length=st.floats(1e-9, 1e12),
    most=st.integers(2, 12),
)
def test_linear_ticks_are_round_inside_and_no_more_than_asked(low, length, most):
    high = low + length
    if not high - low > 1e-9 * max(abs(low), abs(high)):
        return
    found = ticks(low, high, "linear", most)
    assert 1 <= len(found.positions) <= most + 1
    slack = 1e-6 * (high - low)
    assert all(low - slack <= x <= high + slack for x in found.positions)
    assert len(set(found.texts)) == len(found.texts)
    for x, text in zip(found.positions, found.texts, strict=True):
        assert number(text) == pytest.approx(x, rel=1e-9, abs=slack)


@given(
    exponent=st.floats(-30.0, 30.0),
    decades=st.floats(0.01, 40.0),
    most=st.integers(2, 10),
)
def test_logarithmic_ticks_lie_inside_and_say_what_they_are(exponent, decades, most):
    low, high = 10.0**exponent, 10.0 ** (exponent + decades)
    found = ticks(low, high, "log", most)
    assert len(found.positions) >= 1
    for x, text in zip(found.positions, found.texts, strict=True):
        assert low * (1 - 1e-6) <= x <= high * (1 + 1e-6)
        assert number(text) == pytest.approx(x, rel=1e-6)
    assert not set(found.minor) & set(found.positions)
    assert list(found.positions) == sorted(found.positions)


@pytest.mark.parametrize(
    ("ends", "scale", "most", "texts"),
    [
        ((-55.0, 60.0), "linear", 4, "−50 0 50"),
        ((0.0, 1.0), "linear", 4, "0.00 0.25 0.50 0.75 1.00"),
        ((-1e-9, 2.1e-9), "linear", 4, "−1·10⁻⁹ 0 1·10⁻⁹ 2·10⁻⁹"),
        ((0.09, 4.0), "log", 8, "0.1 0.2 0.5 1 2"),
        ((1e-8, 1e5), "log", 5, "10⁻⁸ 10⁻⁵ 0.01 10 10⁴"),
        ((2.1, 3.9), "log", 4, "2.5 3.0 3.5"),
    ],
)
def test_ticks_read_as_an_author_would_write_them(ends, scale, most, texts):
    assert " ".join(ticks(*ends, scale, most).texts) == texts


def test_every_tick_of_an_axis_has_the_same_number_of_decimals():
    found = ticks(-0.031, 0.047, "linear", 6).texts
    assert len({len(text.partition(".")[2]) for text in found}) == 1
    assert math.isclose(number(found[0]), -0.02) or math.isclose(number(found[0]), -0.03)
