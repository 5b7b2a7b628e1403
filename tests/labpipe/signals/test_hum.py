"""Hum of the mains: found where nothing else can swing, and nowhere else."""

import numpy as np
import pytest

from labpipe.arrays import Floats
from labpipe.signals import Hum, hum_at_rest
from labpipe.signals._hum import Stretch, hum_of

_INTERVAL = 5e-5
_TIME = np.arange(7000) * _INTERVAL
_NOISE = 1e-6
_PARTS = [Stretch(slice(0, 380), 1), Stretch(slice(420, 1000), 2), Stretch(slice(1050, 2600), 2)]
_PARTS += [Stretch(slice(2660, 4000), 2), Stretch(slice(4070, 5200), 2), Stretch(slice(5280, 6900), 2)]


def _record(rng: np.random.Generator) -> Floats:
    """Noise on arcs, and between them contacts that nothing of the fit may touch."""
    values = _NOISE * rng.standard_normal(_TIME.size) + 3e-3
    inside = np.zeros(_TIME.size, bool)
    for part, degree in _PARTS:
        s = _TIME[part] - _TIME[part].mean()
        values[part] += rng.normal(0.0, 0.1) * s - (4.905 * s**2 if degree == 2 else 0.0)
        inside[part] = True
    return np.where(inside, values, 1.0)


@pytest.mark.parametrize("line", [50.0, 60.0])
def test_hum_is_found_as_well_as_it_says(line: float) -> None:
    rng = np.random.default_rng(int(line))
    errors, amplitudes = [], []
    for _ in range(20):
        amplitude, frequency = rng.uniform(0.3e-6, 4e-6), line + rng.normal(0.0, 0.03)
        true = amplitude * np.sin(2 * np.pi * frequency * _TIME + rng.uniform(0.0, 6.3))
        found = hum_of(_TIME, _record(rng) + true, _NOISE, _PARTS)
        assert found is not None
        errors.append(((found.at(_TIME) - true) / np.linalg.norm(found.modes(_TIME), axis=1))[::500])
        amplitudes.append(found.amplitude / amplitude - 1.0)
    assert 0.7 < np.sqrt(np.mean(np.square(errors))) < 1.3
    assert np.median(np.abs(amplitudes)) < 0.1


def test_noise_and_other_oscillations_are_no_hum() -> None:
    rng = np.random.default_rng(1)
    for number in range(8):
        values = _record(rng)
        assert hum_of(_TIME, values, _NOISE, _PARTS) is None
        # a vibration beside the mains, and one that dies out after each contact
        near = 3e-6 * np.sin(2 * np.pi * (44.0 + 2 * (number % 2) * 5.0) * _TIME)
        assert hum_of(_TIME, values + near, _NOISE, _PARTS) is None
        rung = np.zeros(_TIME.size)
        for part, _ in _PARTS[1:]:
            s = _TIME[part] - _TIME[part][0]
            rung[part] = 4e-6 * np.exp(-200.0 * s) * np.sin(2 * np.pi * 180.0 * s + rng.uniform(0.0, 6.3))
        assert hum_of(_TIME, values + rung, _NOISE, _PARTS) is None


def test_a_short_rest_tells_a_hum_and_says_whether_it_knows_the_mains() -> None:
    rng = np.random.default_rng(2)
    t = _TIME[:400]
    noise = _NOISE * rng.standard_normal(400) + 1e-3 * t
    assert hum_at_rest(t, noise, _NOISE) is None
    strong, weak = (hum_at_rest(t, noise + a * np.sin(2 * np.pi * 50.0 * t + 1.0), _NOISE) for a in (8e-6, 1.2e-6))
    assert strong is not None
    assert weak is not None
    assert (strong[1], weak[1]) == (True, False)
    assert strong[0].amplitude == pytest.approx(8e-6, rel=0.05)
    assert hum_at_rest(t[:100], noise[:100], _NOISE) is None  # a quarter of a period may be a drift


def test_a_hum_survives_being_written_and_another_unit() -> None:
    hum = Hum(50.01, 0.1, np.array([1.0, 2.0]), np.diag([1e-2, 2e-2, 1e-4]))
    again = Hum.of_text(hum.to_text())
    assert again is not None
    assert np.array_equal(again.at(_TIME), hum.at(_TIME))
    assert hum.scaled(-3.0).at(_TIME) == pytest.approx(-3.0 * hum.at(_TIME))
