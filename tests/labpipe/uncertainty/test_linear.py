import json
from math import cos, inf, isnan, nan, sin, sqrt

import numpy as np
import pytest
from hypothesis import given, strategies as st

from labpipe.errors import InputError
from labpipe.uncertainty import (
    Input,
    Source,
    budget_rows,
    combined_uncertainty,
    linear_budget,
    monte_carlo,
    propagated_covariance,
    propagated_u,
    propagated_variance,
)


def test_gum_end_gauge_style_sum_and_product():
    found = linear_budget(lambda a, b, c: a * b + c, {"a": Input(2.0, 0.1), "b": Input(5.0, 0.2), "c": Input(1.0, 0.3)})
    assert found.value == 11.0
    assert found.u == pytest.approx(sqrt(0.5**2 + 0.4**2 + 0.3**2))
    assert [row["source"] for row in found.rows] == ["a", "b", "c"]
    assert [row["share"] for row in found.rows] == pytest.approx([0.5, 0.32, 0.18])
    sources = [Source("a", 2.0, 0.1, "1", 5.0), Source("b", 5.0, 0.2, "1", 2.0), Source("c", 1.0, 0.3, "1", 1.0)]
    assert found.u == pytest.approx(combined_uncertainty(sources))
    for ours, stated in zip(found.rows, budget_rows(sources), strict=True):
        assert ours == pytest.approx(stated)


@given(
    reading=st.floats(1e-4, 1e-2),
    angle=st.floats(0.0, 0.6),
    u_reading=st.floats(1e-8, 1e-5),
    u_angle=st.floats(1e-5, 1e-3),
)
def test_propagation_agrees_with_the_exact_derivatives(reading, angle, u_reading, u_angle):
    found = linear_budget(
        lambda reading, angle: reading / cos(angle),
        {"reading": Input(reading, u_reading, "m"), "angle": Input(angle, u_angle, "rad")},
    )
    by_hand = sqrt((u_reading / cos(angle)) ** 2 + (reading * sin(angle) / cos(angle) ** 2 * u_angle) ** 2)
    assert found.u == pytest.approx(by_hand, rel=1e-5)  # over one u the cosine bends a little
    assert sum(row["share"] for row in found.rows) == pytest.approx(1.0)


def test_few_repeats_widen_the_expanded_uncertainty():
    few = linear_budget(lambda a: a, {"a": Input(1.0, 0.1, "m", 4)})
    many = linear_budget(lambda a: a, {"a": Input(1.0, 0.1, "m")})
    assert few.degrees_of_freedom == pytest.approx(4.0)
    assert few.expanded() == pytest.approx(0.2776, abs=1e-4)  # Student, 4 degrees of freedom
    assert many.expanded() == pytest.approx(0.196, abs=1e-4)
    assert many.degrees_of_freedom == inf
    drawn = monte_carlo(lambda a: a, {"a": Input(1.0, 0.1, "m", 4)}, draws=20000)
    assert 0.5 * (drawn.high - drawn.low) == pytest.approx(few.expanded(), rel=0.1)


def test_a_negative_uncertainty_is_refused_and_none_has_no_share():
    assert budget_rows([Source("a", 1.0, 0.0, "m", 1.0, "random")])[0]["share"] == 0.0
    found = linear_budget(
        lambda height, g: sqrt(2 * g * height), {"height": Input(1.5e-3, 0.0), "g": Input(9.81, 0.01)}
    )
    assert json.loads(json.dumps(found.rows)) == list(found.rows)
    assert (found.value, found.rows[-1]["share"]) == (pytest.approx(0.17155174), 0.0)
    assert isnan(linear_budget(lambda a, b: a + b, {"a": Input(nan, 0.0), "b": Input(0.0, 0.1)}).value)
    with pytest.raises(InputError, match="a: a standard uncertainty cannot be negative"):
        linear_budget(lambda a: a, {"a": Input(1.0, -0.1)})


def test_restitution_from_two_speeds_with_one_scale_is_free_of_it():
    # The scale multiplies both speeds: fully correlated relative errors cancel.
    incoming, outgoing, relative = 0.17, 0.12, 0.01
    slopes = np.array([-outgoing / incoming**2, 1.0 / incoming])
    u = relative * np.array([incoming, outgoing])
    apart, together = np.diag(u**2), np.outer(u, u)
    assert propagated_u(slopes, together) == pytest.approx(0.0, abs=1e-9)
    rounded = np.array([1.0, -1.0 - 1e-16])
    assert propagated_variance(rounded, np.array([[1.0, 1.0], [1.0, 1.0 - 1e-15]])) >= 0.0
    assert propagated_u(slopes, apart) == pytest.approx(outgoing / incoming * relative * sqrt(2))


def test_covariance_of_parameters_is_what_draws_of_them_make_of_the_results():
    covariance = np.array([[4.0, 1.5], [1.5, 1.0]])
    slopes = np.array([[1.0, -2.0], [0.5, 3.0]])
    drawn = np.random.default_rng(4).multivariate_normal([0.0, 0.0], covariance, 40000) @ slopes.T
    found = propagated_covariance(slopes, covariance)
    assert np.cov(drawn.T) == pytest.approx(found, rel=0.05, abs=0.1)
    assert propagated_variance(slopes, covariance) == pytest.approx(np.diag(found))
    assert propagated_u(slopes[1], covariance) ** 2 == pytest.approx(found[1, 1])
