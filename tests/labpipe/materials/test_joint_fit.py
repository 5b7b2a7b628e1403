"""Derivatives of the joint fit against differences, and noise levels against known ones."""

from types import SimpleNamespace

import numpy as np
import pytest

from labpipe.materials.superposition import _joint_fit
from labpipe.materials.superposition._first_shifts import overlapped_shifts, scanned_shifts
from labpipe.materials.superposition._joint_fit import (
    evaluate,
    grid_for,
    minimise,
    outer_problem,
    sensitivity,
    total_cost,
)
from labpipe.materials.superposition._law_choice import STRONG_EVIDENCE, _criterion
from labpipe.materials.superposition._noise import Noise, Scatter, next_noise, scatter_of_sweeps
from labpipe.materials.superposition._reweighting import Options, _root_of_influence, _with_spread
from labpipe.materials.superposition._shift_parameters import OuterModel, expected_shifts
from labpipe.materials.superposition._sweep_data import read_sweeps


@pytest.fixture(scope="module")
def points(maxwell_truth):
    return read_sweeps(maxwell_truth.sweeps(5)).points


def model_of(truth, **options):
    shifts = truth.log10_aT
    reference = 7
    return OuterModel(
        temperature=np.array(truth.temperature),
        T_ref=60.0,
        reference=reference,
        given=shifts - shifts[reference],
        delay_unit=1 / 63.0,
        **options,
    )


@pytest.mark.parametrize("horizontal", ["free", "wlf", "arrhenius"])
@pytest.mark.parametrize("vertical", ["none", "rho_T", "quadratic"])
def test_sensitivity_is_the_derivative_of_the_prediction(points, maxwell_truth, horizontal, vertical):
    model = model_of(maxwell_truth, horizontal=horizontal, vertical=vertical, has_delay=True, level_spread=0.02)
    begin = model.start().parameters.copy()
    begin[-1] = 0.2  # radians of delay at the highest frequency: without it half of the terms are 0
    state = model.state(begin)
    weight = 1 / np.concatenate([points.storage, points.loss])
    grid = grid_for(points, state, 3, 0.7)
    fit = evaluate(points, weight, grid, state, 10.0)
    change = sensitivity(points, fit, model)
    assert change.shape == (264, model.size)
    rng = np.random.default_rng(0)
    direction = rng.standard_normal(model.size) * (1e-6 if horizontal == "wlf" else 1e-5)
    if horizontal == "arrhenius":
        direction[0] = 1.0

    up = held(points, fit, model.state(state.parameters + direction), weight)
    down = held(points, fit, model.state(state.parameters - direction), weight)
    np.testing.assert_allclose((up - down) / 2, change @ direction, rtol=1e-4, atol=1e-9)


def held(points, fit, state, weight):
    """Weighted prediction of a fit's spectrum at another state, written out."""
    times = np.exp(fit.grid.ln_time)
    weights = fit.solution.coefficient * fit.grid.scale
    omega = points.omega * 10.0 ** state.log10_aT[points.isotherm]
    x = 1j * omega[:, None] * times
    value = weights[-1] + (x / (1 + x)) @ weights[:-1]
    value = value * np.exp(state.ln_bT[points.isotherm] + 1j * points.omega * state.delay)
    return np.concatenate([value.real, value.imag]) * weight


def test_both_starts_are_near_and_the_fit_improves_them(points, maxwell_truth):
    model = model_of(maxwell_truth)
    zero = np.zeros(12)
    exact = maxwell_truth.log10_aT - maxwell_truth.log10_aT[-1]
    weight = 50 / np.concatenate([points.storage, points.loss])
    for start in (scanned_shifts, overlapped_shifts):
        shifts = start(points, model.temperature, zero)
        assert np.abs(shifts - exact).max() < 0.5
        state = model.state(np.delete(shifts - shifts[7], 7))
        first = evaluate(points, weight, grid_for(points, state, 3, 1.5), state, 100.0)
        fit = minimise(points, weight, first, model)
        assert total_cost(fit, model) < total_cost(first, model)
        truth = exact - exact[7]
        assert np.sqrt(np.mean((fit.state.log10_aT - truth) ** 2)) < 0.05


def test_expectation_is_weak_and_scales_with_the_spacing(maxwell_truth):
    temperature = np.array(maxwell_truth.temperature)
    exact = maxwell_truth.log10_aT
    known = expected_shifts(temperature, exact)
    assert known.cost(exact) < 12
    shuffled = np.random.default_rng(0).permutation(12)
    again = expected_shifts(temperature[shuffled], exact[shuffled])
    assert again.cost(exact[shuffled]) == pytest.approx(known.cost(exact))
    # A hundredth of a decade costs next to nothing against data that know it to 0.03.
    curvature = np.diag(known.rows.T @ known.rows)
    assert curvature.max() < 0.05 / 0.03**2


def test_scatter_of_sweeps_is_the_noise(maxwell_truth, fractional_truth):
    for truth in (maxwell_truth, fractional_truth):
        levels = [scatter_of_sweeps(read_sweeps(truth.sweeps(seed, 0.01, 0.05)).points) for seed in range(10)]
        assert np.mean([n.storage for n in levels]) == pytest.approx(0.01, rel=0.15)
        assert np.mean([n.loss for n in levels]) == pytest.approx(0.05, rel=0.15)


def test_misfit_beyond_the_scatter_counts_the_same_in_both_moduli():
    scatter = Scatter(0.003, 0.02, 100)
    exact = next_noise(scatter, (1.0, 1.0), scatter, None)
    assert (exact.storage, exact.loss) == pytest.approx((0.003, 0.02))
    poor = next_noise(scatter, (5.0, 2.0), scatter, None)
    misfit = poor.storage**2 - 0.003**2
    assert poor.loss**2 - 0.02**2 == pytest.approx(misfit)
    v_storage, v_loss = (5 * 0.003) ** 2, (2 * 0.02) ** 2
    assert v_storage / poor.storage**2 + v_loss / poor.loss**2 == pytest.approx(2)
    better = next_noise(scatter, (0.5, 0.5), scatter, None)
    assert (better.storage, better.loss) == pytest.approx((0.0015, 0.01))
    within = next_noise(scatter, (1.1, 0.9), scatter, None)
    assert (within.storage, within.loss) == pytest.approx((0.0033, 0.018))
    fixed = next_noise(Noise(0.01, 0.02), (1.0, 2.0), scatter, 2.0)
    assert fixed.loss / fixed.storage == pytest.approx(2)


def test_levels_are_no_parameters_of_the_law(maxwell_truth):
    n = len(maxwell_truth.temperature)
    without = model_of(maxwell_truth, vertical="rho_T")
    assert without.law_size == without.size
    held_back = model_of(maxwell_truth, vertical="rho_T", level_spread=0.02)
    assert held_back.law_size == held_back.size - n


def test_at_its_minimum_a_fit_ends_after_one_look(points, maxwell_truth, monkeypatch):
    model = model_of(maxwell_truth)
    shifts = scanned_shifts(points, model.temperature, np.zeros(12))
    state = model.state(np.delete(shifts - shifts[7], 7))
    weight = 50 / np.concatenate([points.storage, points.loss])
    fit = evaluate(points, weight, grid_for(points, state, 3, 1.5), state, 100.0)
    fit = minimise(points, weight, fit, model, tolerance=0.1)
    looks = []

    def counted(*arguments):
        looks.append(1)
        return outer_problem(*arguments)

    monkeypatch.setattr(_joint_fit, "outer_problem", counted)
    minimise(points, weight, fit, model, tolerance=0.1)
    assert len(looks) == 1


def test_spread_of_the_levels_counts_those_that_the_data_determine(points, maxwell_truth):
    """Levels known to half of their variance are half a number each, as with residuals."""
    model = model_of(maxwell_truth, level_spread=0.02)
    levels = np.linspace(-0.04, 0.05, model.level_slice.stop - model.level_slice.start)
    parameters = model.start().parameters.copy()
    parameters[model.level_slice] = levels
    fit = SimpleNamespace(state=SimpleNamespace(parameters=parameters))
    covariance = np.zeros((model.size, model.size))
    at = np.arange(model.level_slice.start, model.level_slice.stop)
    full = _with_spread(model, fit, covariance)
    expected = np.sum(model.levels(parameters) ** 2) / levels.size
    assert full.level_spread == pytest.approx(np.sqrt(expected))
    covariance[at, at] = 0.5 * 0.02**2
    half = _with_spread(model, fit, covariance)
    assert half.level_spread == pytest.approx(np.sqrt(2.0 * expected))


def test_price_of_the_vertical_law_is_half_a_parameter(points, maxwell_truth):
    """The law b ∝ T adds no number: one law and half a price over none, the fit being the same."""
    plain, with_law = (model_of(maxwell_truth, vertical=v) for v in ("none", "rho_T"))
    state = plain.state(np.delete(plain.given, 7))
    weight = 50 / np.concatenate([points.storage, points.loss])
    fit = evaluate(points, weight, grid_for(points, state, 3, 1.5), state, 100.0)
    extra = _criterion(points, fit, with_law) - _criterion(points, fit, plain)
    moved = total_cost(fit, with_law) - total_cost(fit, plain)
    price = np.log(2 * points.omega.size)
    assert extra - moved == pytest.approx(0.5 * price + STRONG_EVIDENCE)


def test_a_residual_beyond_three_deviations_counts_linearly():
    options = Options((), None, None, robust=True, noise_ratio=None, scatter=None)
    weight = _root_of_influence(np.array([-0.5, 3.0, -12.0]), options)
    np.testing.assert_allclose(weight**2, [1.0, 1.0, 0.25])
