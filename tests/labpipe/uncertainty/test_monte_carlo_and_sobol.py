from math import exp, isinf, sqrt

import pytest

from labpipe.uncertainty import Input, inputs_to_halve, intervals_agree, linear_budget, monte_carlo, sobol


def product(a: float, b: float) -> float:
    return a * b


def exp_of(x: float) -> float:
    return exp(x)


LINEAR = {"a": Input(2.0, 0.02, "m"), "b": Input(5.0, 0.1, "N")}


def test_monte_carlo_agrees_with_a_linear_model_and_objects_to_a_strongly_curved_one() -> None:
    made, drawn = linear_budget(product, LINEAR), monte_carlo(product, LINEAR)
    assert drawn.u == pytest.approx(made.u, rel=0.04)
    assert intervals_agree(made, drawn)
    curved = {"x": Input(0.0, 1.0)}
    assert not intervals_agree(linear_budget(exp_of, curved), monte_carlo(exp_of, curved))


def test_sobol_indices_of_a_linear_model_are_its_shares() -> None:
    found = sobol(lambda a, b, c: a * b * c, LINEAR | {"c": Input(1.0, 0.0)})  # what is exact takes no part
    assert set(found) == set(LINEAR)
    made = {row["source"]: row["share"] for row in linear_budget(product, LINEAR).rows}
    for name, indices in found.items():
        assert indices.total == pytest.approx(made[name], abs=0.03)
        assert indices.first == pytest.approx(made[name], abs=0.03)


def test_sobol_total_exceeds_first_order_where_inputs_interact() -> None:
    inputs = {"a": Input(0.0, 1.0), "b": Input(0.0, 1.0)}
    found = sobol(product, inputs)
    assert found["a"].first == pytest.approx(0.0, abs=0.1)
    assert found["a"].total == pytest.approx(1.0, abs=0.15)


def test_what_to_measure_better_halves_the_uncertainty() -> None:
    shares = {"a": 0.6, "b": 0.35, "c": 0.05}
    names, factor = inputs_to_halve(shares)
    assert names == ("a", "b")
    left = 0.95 / factor**2 + 0.05
    assert sqrt(left) == pytest.approx(0.5)
    names, factor = inputs_to_halve({str(i): 0.25 for i in range(4)})
    assert len(names) == 4
    assert not isinf(factor)
