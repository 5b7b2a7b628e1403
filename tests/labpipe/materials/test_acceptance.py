"""Errors and coverage of master curves against the truth, on the sample sessions and on materials drawn here."""

import json
import warnings
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from scipy.interpolate import CubicSpline

import instruments
from labpipe.materials import master_curve

SAMPLES = Path(__file__).parents[3] / "sample_data"
T_REF = 20.0


def quiet(sweeps, T_ref=T_REF, **options):
    with warnings.catch_warnings(action="ignore", category=UserWarning):
        return master_curve(sweeps, T_ref, **options)


def of_session(session, name):
    """Return a master curve of a sample session and its errors (decades)."""
    truth = json.loads((SAMPLES / session / "truth" / f"{name}.json").read_text())
    readings = instruments.read(SAMPLES / session / "dma" / f"{name}.csv")
    found = quiet(readings, mode=truth["mode"], nu=truth["nu"])
    law = CubicSpline(truth["temperature"], truth["log10_aT"])
    return found, found.log10_aT.values - law(found.log10_aT["temperature"].values) + law(T_REF)


@pytest.mark.parametrize(
    ("session", "name", "error"),
    [
        ("thesis-small", "acrylic_dma", 0.050),
        ("thesis-small", "nylon_dma", 0.025),
        ("thesis-small", "peek_dma", 0.125),
        ("thesis-small", "ptfe_dma", 0.095),
        ("thesis-small", "nbr_dma", 0.042),
        ("core", "acrylic_dma", 0.056),
        ("core", "nbr_dma", 0.070),
        ("films", "ptfe_dma", 0.040),
    ],
)
def test_shifts_of_the_sample_sessions(session, name, error):
    found, off = of_session(session, name)
    z = off / np.maximum(found.u_log10_aT.values, 1e-9)
    assert np.sqrt(np.mean(off**2)) < error
    assert np.sqrt(np.mean(z**2)) < 1.6
    assert np.all(np.abs(z) < 3.5)
    assert found.verdict.level == "pass", found.verdict.reasons
    assert found.kramers_kronig.verdict == "pass"


def dispersion(omega, time, alpha, gamma):
    """Havriliak and Negami's function of a modulus: zero far below the dispersion, one far above."""
    return (1 + (1j * omega * time) ** -alpha) ** -gamma


def made(rng, temperature, frequency, modulus, noise):
    """Sweeps of a complex modulus (temperature, frequency) with relative noise of storage and loss."""
    storage, loss = rng.standard_normal((2, *modulus.shape))
    dims = ("temperature", "frequency")
    return xr.Dataset(
        {
            "storage": (dims, modulus.real * (1 + noise[0] * storage), {"units": "Pa"}),
            "loss": (dims, modulus.imag * (1 + noise[1] * loss), {"units": "Pa"}),
        },
        coords={"temperature": temperature, "frequency": frequency},
    )


def drawn(seed):
    """A random plastic or rubber: sweeps, and log10 a_T from T_REF."""
    rng = np.random.default_rng((20261128, seed))
    temperature = np.sort(T_REF + np.linspace(-45.0, 45.0, int(rng.integers(6, 14))) + rng.uniform(-3, 3))
    C1, C2 = rng.uniform(6, 14), rng.uniform(100, 250)
    shifts = -C1 * (temperature - T_REF) / (C2 + temperature - T_REF)
    frequency = np.logspace(-1, rng.uniform(1, 2), int(rng.integers(8, 20)))
    omega = 2 * np.pi * frequency * 10.0 ** shifts[:, None]
    if seed % 2:
        modulus = rng.uniform(3e6, 1e7) + 1.2e9 * dispersion(
            omega, 10 ** rng.uniform(-5, -2), *rng.uniform(0.4, 0.7, 2)
        )
        modulus = modulus * ((temperature + 273.15) / (T_REF + 273.15))[:, None]
    else:
        modulus = 6e8 + 2e9 * dispersion(omega, 10 ** rng.uniform(-4, 0), rng.uniform(0.2, 0.4), 1.0)
        modulus = modulus * (1 - rng.uniform(0, 6e-4) * (temperature - T_REF))[:, None]
    late = np.exp(2j * np.pi * frequency * rng.uniform(0, 6e-5))
    return made(rng, temperature, frequency, modulus * late, (0.01, 0.02)), shifts


def test_stated_uncertainties_hold_for_materials_drawn_at_random(amount):
    z, errors = [], []
    for seed in range(amount(8, 60)):
        sweeps, shifts = drawn(seed)
        found = quiet(sweeps)
        off = found.log10_aT.values - shifts
        errors.append(np.sqrt(np.mean(off**2)))
        z.append(off / found.u_log10_aT.values)
    z = np.concatenate(z)
    assert np.median(errors) < 0.035
    assert np.mean(np.abs(z) < 2) > 0.92
    assert np.sqrt(np.mean(z**2)) > 0.5


def test_nothing_but_the_zero_of_the_shifts_depends_on_the_reference_temperature():
    sweeps, _ = drawn(1)
    first, *others = [quiet(sweeps, T_ref) for T_ref in (T_REF, T_REF + 25.0)]
    for other in others:
        np.testing.assert_allclose(np.diff(other.log10_aT), np.diff(first.log10_aT), atol=1e-9)
        np.testing.assert_allclose(other.overlap["u_step"], first.overlap["u_step"], rtol=1e-6)
        np.testing.assert_allclose(other.b_T / other.b_T[0], first.b_T / first.b_T[0], rtol=1e-9)
        assert other.verdict == first.verdict
        assert other.nearest_law.name == first.nearest_law.name
        assert other.nearest_law.chi_square == pytest.approx(first.nearest_law.chi_square, rel=1e-6)
        warm = first.at(other.T_ref)
        storage = [solid.complex_modulus(100.0).real for solid in (warm, other.prony)]
        assert storage[0] == pytest.approx(storage[1], rel=0.01)


TEMPERATURES = np.arange(0.0, 101.0, 10.0)


def two_processes(seed, share=1.0, factor=lambda T: 1.0, delay=0.0, noise=0.02):
    """Two dispersions, the second of which shifts by a share of the first one's decades."""
    frequency = np.logspace(-1, 2, 16)
    omega = 2 * np.pi * frequency
    a = -10 * (TEMPERATURES - 50.0) / (100.0 + TEMPERATURES)
    parts = [
        6e8 * dispersion(omega * 10.0 ** a[:, None], 0.1, 0.5, 0.7),
        4e8 * dispersion(omega * 10.0 ** (share * a[:, None]), 1e-4, 0.4, 1.0),
    ]
    modulus = (8e6 + sum(parts)) * np.array([factor(T) for T in TEMPERATURES])[:, None] * np.exp(1j * omega * delay)
    return made(np.random.default_rng(seed), TEMPERATURES, frequency, modulus, (noise, noise)), a


def test_two_processes_that_shift_apart_do_not_pass():
    found = quiet(two_processes(11, 0.4)[0], 50.0)
    assert found.verdict.level != "pass"
    assert "does not hold to the noise" in found.verdict.reasons[0]


@pytest.mark.parametrize(
    "change",
    [
        {},
        {"factor": lambda T: (T + 273.15) / 323.15},
        {"factor": lambda T: 1 - 0.003 * (T - 50.0)},
        {"factor": lambda T: 1 + 0.03 * np.sin(12.9898 * T)},
        {"delay": 60e-6},
        {"noise": 0.04},
    ],
    ids=["plain", "entropic", "softening glass", "levels", "delay", "noisy"],
)
def test_one_process_passes_with_every_law_that_it_may_need(change):
    sweeps, shifts = two_processes(12, **change)
    found = quiet(sweeps, 50.0)
    assert found.verdict.level == "pass", found.verdict.reasons
    assert np.sqrt(np.mean((found.log10_aT.values - shifts) ** 2)) < 0.08


def test_a_vertical_factor_of_no_material_is_not_taken():
    found = quiet(two_processes(13, factor=lambda T: 1 + 4e-4 * (T - 50.0) ** 2)[0], 50.0)
    assert np.all(np.abs(np.log(found.b_T.values)) <= 0.006 * np.abs(TEMPERATURES - 50.0) + 0.1)
    assert found.verdict.level != "pass"


def test_repeats_that_disagree_widen_every_uncertainty():
    measured, _ = two_processes(15)
    shifted = measured.assign_coords(frequency=measured["frequency"] * 10**0.3).isel(temperature=[5])
    again = shifted.interp(frequency=measured["frequency"], kwargs={"fill_value": np.nan})
    twice = quiet(xr.concat([measured, again], "temperature"), 50.0)
    assert np.all(np.delete(twice.u_log10_aT.values[: TEMPERATURES.size], 5) > 0.1)
    assert np.max(quiet(measured, 50.0).u_log10_aT.values) < 0.1


def test_a_softening_glass_of_little_loss_is_covered():
    temperature, frequency = np.linspace(-40.0, 120.0, 10), np.logspace(-1, 1, 11)
    shifts = 4200.0 * (1 / (temperature + 273.15) - 1 / (temperature[4] + 273.15))
    omega = 2 * np.pi * frequency * 10.0 ** shifts[:, None]
    softening = (1 - 4e-4 * (temperature - temperature[4]))[:, None]
    modulus = softening * (3e9 + 0.5e9 * dispersion(omega, 0.05, 0.12, 1.0))
    found = quiet(made(np.random.default_rng(3), temperature, frequency, modulus, (0.003, 0.03)), temperature[4])
    off = np.abs(found.log10_aT.values - shifts)
    assert np.all(off <= 3.0 * found.u_log10_aT.values + 1e-3)
