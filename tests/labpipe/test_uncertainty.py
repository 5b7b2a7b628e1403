import json
from math import inf, sqrt

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from uncertainties.umath import cos
from uncertainties.umath import sqrt as usqrt

from labpipe.errors import InputError
from labpipe.uncertainty import Input, Source, budget, combine, combined, table


def test_gum_end_gauge_style_sum_and_product():
    found = budget(
        lambda a, b, c: a * b + c,
        {"a": Input(2.0, 0.1), "b": Input(5.0, 0.2), "c": Input(1.0, 0.3)},
    )
    assert found.value == 11.0
    assert found.u == pytest.approx(sqrt(0.5**2 + 0.4**2 + 0.3**2))
    assert [row["source"] for row in found.rows] == ["a", "b", "c"]
    assert [row["share"] for row in found.rows] == pytest.approx([0.5, 0.32, 0.18])
    assert found.rows[0]["sensitivity"] == pytest.approx(5.0)


@given(
    reading=st.floats(1e-4, 1e-2),
    angle=st.floats(0.0, 0.6),
    u_reading=st.floats(1e-8, 1e-5),
    u_angle=st.floats(1e-5, 1e-3),
)
def test_propagation_agrees_with_a_large_sample(reading, angle, u_reading, u_angle):
    found = budget(
        lambda reading, angle: reading / cos(angle),
        {"reading": Input(reading, u_reading, "m"), "angle": Input(angle, u_angle, "rad")},
    )
    by_hand = sqrt(
        (u_reading / np.cos(angle)) ** 2
        + (reading * np.sin(angle) / np.cos(angle) ** 2 * u_angle) ** 2
    )
    assert found.u == pytest.approx(by_hand, rel=1e-9, abs=0.0)
    assert sum(row["share"] for row in found.rows) == pytest.approx(1.0)
    assert combine(found.rows) == pytest.approx(found.u, rel=1e-6, abs=0.0)


def test_restitution_from_two_speeds_with_one_scale_is_free_of_it():
    # The scale multiplies both speeds: fully correlated relative errors cancel.
    speeds = {"incoming": Input(0.17, 0.0017, "m/s"), "outgoing": Input(0.12, 0.0012, "m/s")}

    def ratio(incoming, outgoing):
        return outgoing / incoming

    apart = budget(ratio, speeds)
    together = budget(ratio, speeds, {("incoming", "outgoing"): 1.0})
    assert together.u == pytest.approx(0.0, abs=1e-12)
    assert apart.u == pytest.approx(apart.value * 0.01 * sqrt(2))
    row = next(row for row in together.rows if row["source"].startswith("correlation"))
    assert row["value"] == 1.0


def test_negative_share_of_a_correlation_is_combined_with_its_sign():
    inputs = {"a": Input(1.0, 0.1), "b": Input(1.0, 0.1)}
    found = budget(lambda a, b: a - b, inputs, {("a", "b"): 0.5})
    assert found.u == pytest.approx(0.1)
    assert combine(found.rows) == pytest.approx(0.1)


def test_few_repeats_widen_the_expanded_uncertainty():
    few = budget(lambda a: a, {"a": Input(1.0, 0.1, "m", 4)})
    many = budget(lambda a: a, {"a": Input(1.0, 0.1, "m")})
    assert few.degrees_of_freedom == pytest.approx(4.0)
    assert few.expanded() == pytest.approx(0.2776, abs=1e-4)  # Student, 4 degrees of freedom
    assert many.expanded() == pytest.approx(0.196, abs=1e-4)
    assert many.degrees_of_freedom == inf


def test_rows_are_plain_json_and_exact_inputs_have_no_share():
    inputs = {"height": Input(1.5e-3, 0.0, "m"), "g": Input(9.81, 0.01, "m/s2")}
    found = budget(lambda height, g: usqrt(2 * g * height), inputs)
    assert json.loads(json.dumps(found.rows)) == list(found.rows)
    assert found.value == pytest.approx(0.17155174)
    assert found.rows[-1]["share"] == 0.0


@pytest.mark.parametrize(
    ("inputs", "correlations", "message"),
    [
        ({"a": Input(1.0, -0.1)}, {}, "a: expected a finite value"),
        ({"a": Input(float("nan"), 0.1)}, {}, "found nan"),
        ({"a": Input(1.0, 0.1)}, {("a", "b"): 0.5}, "between two of a"),
        ({"a": Input(1.0, 0.1), "b": Input(1.0, 0.1)}, {("a", "b"): 1.5}, "-1 to 1"),
    ],
)
def test_impossible_inputs_are_refused(inputs, correlations, message):
    with pytest.raises(InputError, match=message):
        budget(lambda **given: sum(given.values()), inputs, correlations)


def test_contradicting_correlations_are_refused():
    inputs = {name: Input(1.0, 0.1) for name in "abc"}
    contradicting = {("a", "b"): -1.0, ("a", "c"): -1.0, ("b", "c"): -1.0}
    with pytest.raises(InputError, match="negative variance"):
        budget(lambda a, b, c: a + b + c, inputs, contradicting)


def test_budget_shares_add_up_largest_first():
    sources = [
        Source("a", 1.0, 1.0, "m", 1.0, "random"),
        Source("b", 1.0, 1.0, "m", -2.0, "random"),
    ]
    rows = table(sources)
    assert [row["source"] for row in rows] == ["b", "a"]
    assert [row["share"] for row in rows] == pytest.approx([0.8, 0.2])
    assert combined(sources) == pytest.approx(5**0.5)


def test_budget_without_any_uncertainty_has_no_shares():
    rows = table([Source("a", 1.0, 0.0, "m", 1.0, "random")])
    assert rows[0]["share"] == 0.0
