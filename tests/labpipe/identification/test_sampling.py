import numpy as np
import pytest

from labpipe.identification import fit, moduli, posterior, sample, sampled_moduli
from tests.labpipe.identification.holds import hold_problem


@pytest.fixture(scope="module")
def known():
    return posterior(fit(hold_problem(1)))


@pytest.fixture(scope="module")
def drawn(known):
    return sample(known, 150)


def test_draws_are_good_and_the_same_every_time(known, drawn) -> None:
    assert drawn.is_reliable
    assert drawn.failed <= 0.1 * 150
    again = sample(known, 20)
    assert (again.draws == drawn.draws[: len(again.draws)]).all()


def test_draws_agree_with_laplace_where_it_is_right(known, drawn) -> None:
    found = moduli(known, np.array([0.02]))
    storage, loss = sampled_moduli(drawn, known, found)
    for values, centre, u in (
        (storage, found.storage, found.u_ln_storage),
        (loss, found.loss_factor, found.u_ln_loss_factor),
    ):
        mean, spread = drawn.mean_and_sd(np.log(values))
        assert abs(mean[0] - np.log(centre[0])) < 0.5 * u[0]
        assert spread[0] == pytest.approx(u[0], rel=0.25)


def test_weighted_quantiles_are_those_of_repeated_draws(drawn) -> None:
    values = np.array([[1.0], [2.0], [3.0], [4.0], [5.0]])
    few = type(drawn)(values, np.full(5, 0.2), 0)
    shares = np.array([0.025, 0.3, 0.5, 0.85, 0.975])
    assert few.quantiles(values, shares)[:, 0] == pytest.approx(np.quantile(values, shares, method="hazen"))
    twice = type(drawn)(values[:3], np.array([0.25, 0.5, 0.25]), 0)  # 1, 2, 2, 3
    assert twice.quantiles(values[:3], np.array([0.125, 0.5, 0.875]))[:, 0] == pytest.approx([1.0, 2.0, 3.0])
    tilted = type(drawn)(values, np.array([0.0, 0.0, 0.0, 0.0, 1.0]), 0)
    assert tilted.effective == pytest.approx(1.0)
    assert not type(drawn)(values, tilted.weights, 5).is_reliable
    assert "with care" in type(drawn)(values, tilted.weights, 5).statement
