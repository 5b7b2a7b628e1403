from dataclasses import replace

import numpy as np
import pytest

from labpipe.errors import InputError
from labpipe.identification import (
    Evidence,
    Problem,
    SmoothSpectrum,
    fit,
    moduli,
    modulus_evidence,
    posterior,
    relaxation_times,
)
from tests.labpipe.identification.holds import RUBBER, hold

_SEEDS = 24


@pytest.fixture(scope="module")
def known():
    return posterior(fit(hold(RUBBER, 1)[0]))


def test_moduli_are_determined_where_the_data_are_and_nowhere_else(known) -> None:
    frequency = np.array([1e-9, 1e-2, 1.0, 1e7])
    found = moduli(known, frequency)
    assert found.is_determined[1:3].all()
    assert known.fit.misfits == {}
    assert known.fit.is_converged
    # the gain that all readings share is not averaged away
    assert float(known.sd[0]) * known.fit.problem.parameters[0].sd > 0.004
    spread = found.u_ln_loss_factor
    assert spread[2] < 0.1
    assert spread[3] > 10 * spread[2]


def test_intervals_cover_the_truth_as_often_as_they_say() -> None:
    frequency = np.array([0.02, 0.2, 2.0])
    truth = RUBBER.complex_modulus(2 * np.pi * frequency)
    deviations = []
    for seed in range(_SEEDS):
        known = posterior(fit(hold(RUBBER, 100 + seed)[0]))
        value, low, high = known.interval(0, 0.6827)
        deviations.append((np.log(value) - np.log(RUBBER.E_relaxed)) / (0.5 * np.log(high / low)))
        found = moduli(known, frequency)
        deviations += list((np.log(found.storage / truth.real) / found.u_ln_storage).values)
        deviations += list((np.log(found.loss_factor / (truth.imag / truth.real)) / found.u_ln_loss_factor).values)
    assert np.mean(np.abs(deviations) < 1.96) >= 0.9
    assert np.sqrt(np.mean(np.square(deviations))) < 1.2


def test_discrepancy_shows_and_widens_the_answer(known) -> None:
    problem = hold(RUBBER, 1)[0]
    evidence = problem.evidence[0]
    wave = 1 + 0.02 * np.sin(4 * np.log(evidence.groups[0].axis))
    group = replace(evidence.groups[0], values=evidence.values * wave)
    bent = replace(problem, evidence=(replace(evidence, groups=(group,)),))
    found = fit(bent)
    misfit = found.misfits["hold", "force"]
    assert misfit.relative > 2e-3
    assert posterior(found).sd[0] > 1.2 * known.sd[0]


def swept(problem: Problem, highest: float, count: int) -> Evidence:
    """What a rheometer tells of the rubber, to 1 % and 3 %."""
    frequency = np.geomspace(1e-3, highest, count)
    truth = RUBBER.complex_modulus(2 * np.pi * frequency)
    storage, loss = (truth.real, 0.01 * truth.real), (truth.imag, 0.03 * truth.imag)
    return modulus_evidence("dma", frequency, storage, loss, problem.spectrum.rho)


def test_rheometer_as_prior_narrows_what_the_hold_leaves_open() -> None:
    problem = hold(RUBBER, 3, longest=0.3)[0]
    joint = replace(problem, evidence=(*problem.evidence, swept(problem, 1e3, 13)))
    alone, both = (posterior(fit(p)) for p in (problem, joint))
    assert both.sd[0] < 0.2 * alone.sd[0]
    _, low, high = both.interval(0, 0.999)
    assert low < RUBBER.E_relaxed < high
    assert [one.is_prior for one in joint.evidence] == [False, True]


def test_rheometer_far_beyond_the_hold_is_no_discrepancy_for_a_spectrum_as_long() -> None:
    misses = []
    for shortest in (0.1, 0.5 / np.pi / 1e4):
        problem = hold(RUBBER, 3, rho=relaxation_times(shortest, 600.0))[0]
        found = fit(replace(problem, evidence=(*problem.evidence, swept(problem, 1e4, 15))))
        misses.append([name for name, _ in found.misfits])
    assert "dma" in misses[0]
    assert "dma" not in misses[1]


def test_problems_without_experiment_or_prior_are_refused() -> None:
    with pytest.raises(InputError, match="there are no observations"):
        fit(Problem(SmoothSpectrum(np.array([1.0, 10.0]), 0.5), ()))
    with pytest.raises(InputError, match="no prior is given for: gain"):
        replace(hold(RUBBER, 1)[0], nuisances=())
