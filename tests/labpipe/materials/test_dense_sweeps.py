"""Very many readings: what their means keep, and what is said of every reading all the same."""

import warnings

import numpy as np
import pytest

from labpipe.materials import master_curve
from labpipe.materials.superposition._dense_sweeps import means_of
from labpipe.materials.superposition._joint_fit import evaluate, grid_for, outer_problem, sensitivity
from labpipe.materials.superposition._shift_parameters import OuterModel
from labpipe.materials.superposition._sweep_data import read_sweeps
from pipelines.bench.rheology_scenes import scenes
from pipelines.bench.rheology_truth import FRACTIONAL, MAXWELL, measured

DENSE = next(scene for scene in scenes() if scene.name.startswith("200-point"))


@pytest.mark.parametrize("truth", [MAXWELL, FRACTIONAL])
def test_a_mean_is_the_modulus_in_the_middle_of_its_window(truth):
    found = read_sweeps(measured(truth, 1, noise=0.0, points=200).sweeps)
    means = found.points
    assert means.omega.size < found.readings.omega.size / 4
    assert means.readings.sum() == found.readings.omega.size
    temperature = found.temperature[means.isotherm]
    exact = truth.modulus(means.omega * 10 ** (truth.shift(temperature) - truth.shift(np.array([truth.T_ref]))))
    np.testing.assert_allclose(means.storage, exact.real, rtol=5e-4)
    np.testing.assert_allclose(means.loss, exact.imag, rtol=5e-4)


def test_few_readings_stay_as_they_are():
    readings = read_sweeps(measured(MAXWELL, 1, points=21).sweeps).readings
    assert means_of(readings) is readings


def test_many_readings_tell_the_shifts_as_well_as_they_can():
    made = DENSE.build(3)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        curve = master_curve(made.sweeps, T_ref=made.reference)
    error = curve.log10_aT.values - made.log10_aT
    other = curve.u_log10_aT.values > 0
    assert made.error(curve.log10_aT.values) < 0.004
    assert np.mean(np.abs(error[other]) < 2 * curve.u_log10_aT.values[other]) > 0.85
    assert curve.noise["storage"] == pytest.approx(0.02, rel=0.05)  # that of a reading, not of a mean
    assert curve.work["points"] == 8000
    residual = curve.data["storage_residual"].values
    assert np.isfinite(residual).all()
    assert np.std(residual) == pytest.approx(0.02, rel=0.05)


def test_sums_over_isotherms_are_the_normal_matrix_of_all_readings():
    points = read_sweeps(measured(MAXWELL, 2).sweeps).points
    temperature = np.linspace(-40, 120, 12)
    given = MAXWELL.shift(temperature)
    model = OuterModel(
        temperature, 60.0, 7, given - given[7], 1 / 63.0, vertical="linear", has_delay=True, level_spread=0.02
    )
    state = model.start()
    weight = 50.0 / np.concatenate([points.storage, points.loss])
    fit = evaluate(points, weight, grid_for(points, state, 3, 0.7), state, 10.0)
    change = sensitivity(points, fit, model)
    coupling = fit.rows.T @ change
    expected = change.T @ change - coupling.T @ np.linalg.solve(fit.normal, coupling)
    pull, lean = model.pull(state)
    normal, gradient = outer_problem(points, fit, model)
    np.testing.assert_allclose(normal, expected + pull, rtol=1e-9, atol=1e-9 * np.abs(expected).max())
    np.testing.assert_allclose(gradient, change.T @ fit.residual + lean, rtol=1e-9, atol=1e-9 * np.abs(gradient).max())
