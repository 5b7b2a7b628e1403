"""First estimates of the shifts: narrow dips are found, torn chains are not taken."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from labpipe.materials.superposition._first_shifts import _best_chain, _Scan, scanned_shifts
from labpipe.materials.superposition._shift_parameters import CHANGE, CHANGE_SHARE
from labpipe.materials.superposition._sweep_data import read_sweeps


def largest_error(truth, seed):
    data = read_sweeps(truth.sweeps(seed))
    found = scanned_shifts(data.points, data.temperature, np.zeros(data.points.count))
    return float(np.max(np.abs(np.diff(found) - np.diff(truth.log10_aT))))


def with_terms(truth, relaxed, times, weights):
    """A material of single relaxation times."""
    rho, E = np.array(times), np.array(weights)

    def modulus(omega):
        z = 1j * omega[..., None] * rho
        return relaxed + (z / (1 + z)) @ E

    return replace(truth, modulus=modulus)


@pytest.mark.parametrize("seed", range(41, 45))
def test_every_step_of_a_broad_material_is_found(maxwell_truth, seed):
    """Steps of 0.52 to 1.74 decades: found to 0.06 where trials half a decade apart had 0.26."""
    assert largest_error(maxwell_truth, seed) < 0.1


@pytest.mark.parametrize("seed", range(41, 44))
def test_steps_of_two_single_times_are_not_torn_apart(maxwell_truth, seed):
    """Where the loss only falls as 1/ω, two sweeps fit at any distance; the chain decides."""
    solid = with_terms(maxwell_truth, 1e7, [1e-3, 3e-2], [1e9, 3e8])
    assert largest_error(solid, seed) < 0.3


def test_a_power_law_step_is_found_without_overlap(fractional_truth):
    far = replace(fractional_truth, temperature=(0.0, 10.0, 45.0, 55.0))
    data = read_sweeps(far.sweeps(3))
    found = scanned_shifts(data.points, data.temperature, np.zeros(4))
    np.testing.assert_allclose(np.diff(found), np.diff(far.log10_aT), atol=0.6)


@pytest.mark.parametrize("seed", range(20))
def test_the_chain_is_the_best_of_all(seed):
    """Against every combination of steps; changes count per mean spacing of two pairs."""
    random = np.random.default_rng(seed)
    scans = [_Scan(random.uniform(0, 3, 4), random.uniform(0, 6, 4)) for _ in range(4)]
    spacing = np.array([3.0, 12.0, 5.0, 20.0])

    def cost(chosen):
        steps = [scan.step[i] for scan, i in zip(scans, chosen, strict=True)]
        total = sum(scan.score[i] for scan, i in zip(scans, chosen, strict=True))
        for k in range(3):
            mean = 0.5 * (spacing[k] + spacing[k + 1])
            one, two = steps[k] / spacing[k] * mean, steps[k + 1] / spacing[k + 1] * mean
            total += ((one - two) / (CHANGE + CHANGE_SHARE * min(one, two))) ** 2
        return total

    best = min(itertools.product(range(4), repeat=4), key=cost)
    assert _best_chain(scans, spacing) == [s.step[i] for s, i in zip(scans, best, strict=True)]
