"""A wrong model cannot pass: two processes, impossible vertical factors, rough residuals, repeats."""

import warnings

import numpy as np
import pytest
import xarray as xr

from labpipe.materials import kramers_kronig, master_curve
from labpipe.materials.superposition import _master_curve
from labpipe.materials.superposition._anchoring import repeatability
from labpipe.materials.superposition._work import Work
from tests.by_day import by_day, crossed

TEMPERATURES = np.arange(0.0, 101.0, 10.0)


def dispersion(omega, tau, alpha, gamma):
    """Havriliak and Negami's function of the modulus, zero below the dispersion and one above."""
    return (1 + (1j * omega * tau) ** -alpha) ** -gamma


def shift(T):
    return -10 * (T - 50.0) / (150.0 + T - 50.0)


def sweeps(seed, share=1.0, factor=lambda T: 1.0, delay=0.0, noise=0.02):
    """Two dispersions, the second of which shifts by a share of the first one's decades."""
    rng = np.random.default_rng(seed)
    frequency = np.logspace(-1, 2, 16)
    omega = 2 * np.pi * frequency
    modulus = np.array(
        [
            factor(T)
            * (
                8e6
                + 6e8 * dispersion(omega, 0.1 * 10 ** shift(T), 0.5, 0.7)
                + 4e8 * dispersion(omega, 1e-4 * 10 ** (share * shift(T)), 0.4, 1.0)
            )
            * np.exp(1j * omega * delay)
            for T in TEMPERATURES
        ]
    )
    return noisy(rng, TEMPERATURES, frequency, modulus, noise, noise)


def scattered(temperature, frequency, modulus, of_storage, of_loss):
    """Sweeps of a complex modulus (temperature, frequency), with relative errors of either part."""
    dims = ("temperature", "frequency")
    return xr.Dataset(
        {
            "storage": (dims, modulus.real * (1 + of_storage), {"units": "Pa"}),
            "loss": (dims, modulus.imag * (1 + of_loss), {"units": "Pa"}),
        },
        coords={"temperature": temperature, "frequency": frequency},
    )


def noisy(rng, temperature, frequency, modulus, of_storage, of_loss):
    storage, loss = rng.standard_normal((2, *modulus.shape))
    return scattered(temperature, frequency, modulus, of_storage * storage, of_loss * loss)


def quiet(measured, at=50.0, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        return master_curve(measured, at, **options)


def check_two(share, seed):
    found = quiet(sweeps(seed, share))
    assert found.verdict.level == "fail"
    assert "two processes that shift apart" in " ".join(found.verdict.reasons)
    error = np.abs(found.log10_aT.values - shift(TEMPERATURES))
    assert np.all(error <= 3.0 * found.u_log10_aT.values + 0.02)


@pytest.mark.parametrize("share", [0.7, 0.4])
def test_two_processes_that_shift_apart_do_not_pass_and_widen_the_uncertainties(share):
    check_two(share, 11)


@pytest.mark.parametrize(("share", "seed"), crossed([0.75, 0.65, 0.5, 0.3], range(20, 24), 0, 5))
def test_two_processes_over_more_shares(share, seed):
    check_two(share, seed)


HONEST = {
    "plain": {},
    "entropic": {"factor": lambda T: (T + 273.15) / 323.15},
    "softening glass": {"factor": lambda T: 1 - 0.003 * (T - 50.0)},
    "levels": {"factor": lambda T: 1 + 0.03 * np.sin(12.9898 * T)},
    "delay": {"delay": 60e-6},
    "noisy": {"noise": 0.04},
}


@pytest.mark.parametrize("name", HONEST)
def test_one_process_passes_with_every_law_that_it_may_need(name):
    found = quiet(sweeps(12, **HONEST[name]))
    assert found.verdict.level == "pass", found.verdict.reasons
    error = found.log10_aT.values - shift(TEMPERATURES)
    assert np.sqrt(np.mean(error**2)) < 0.08


@pytest.mark.parametrize(("name", "seed"), crossed(HONEST, range(30, 36), 0, 12))
def test_one_process_passes_over_more_seeds(name, seed):
    assert quiet(sweeps(seed, **HONEST[name])).verdict.level == "pass"


@pytest.mark.slow
def test_a_vertical_factor_of_no_material_is_not_taken():
    found = quiet(sweeps(13, factor=lambda T: 1 + 4e-4 * (T - 50.0) ** 2))
    step = np.abs(TEMPERATURES - 50.0)
    assert np.all(np.abs(np.log(found.b_T.values)) <= 0.006 * step + 0.1)
    assert found.verdict.level != "pass"


def test_residuals_count_in_absolute_terms_too():
    frequency = np.logspace(-2, 2, 60)
    rng = np.random.default_rng(14)
    modulus = dispersion(2 * np.pi * frequency, 0.1, 0.5, 1.0) * 1e9 + 1e6
    rough = np.exp(0.5 * rng.standard_normal((2, 60)))
    assert kramers_kronig(frequency, modulus.real, modulus.imag).verdict == "pass"
    assert kramers_kronig(frequency, modulus.real * rough[0], modulus.imag * rough[1]).verdict == "fail"


def test_repeats_that_disagree_widen_every_uncertainty():
    measured = sweeps(15)
    shifted = measured.assign_coords(frequency=measured["frequency"] * 10**0.3).isel(temperature=[5])
    again = shifted.interp(frequency=measured["frequency"], kwargs={"fill_value": np.nan})
    alone = quiet(measured)
    twice = quiet(xr.concat([measured, again], "temperature"))
    u = twice.u_log10_aT.values[: TEMPERATURES.size]
    assert np.all(np.delete(u, 5) > 0.1)
    assert np.max(alone.u_log10_aT.values) < 0.1


def test_repeats_tell_an_error_of_temperature_that_counts_where_shifts_are_steep():
    cold = repeatability(
        TEMPERATURES[[0, 1, 2, 3, 3, *range(4, 11)]],
        shift(TEMPERATURES[[0, 1, 2, 3, 3, *range(4, 11)]]) + 0.1 * (np.arange(12) == 4),
        1e-4 * np.eye(12),
    )
    assert cold[0] > 2 * cold[-1] > 0.0
    assert not repeatability(TEMPERATURES, shift(TEMPERATURES), 1e-4 * np.eye(11)).any()


def few(seed, factor, count=3):
    """Sweeps of a few readings, one of which is wrong."""
    measured = sweeps(seed).isel(frequency=np.linspace(1, 14, count, dtype=int))
    rng = np.random.default_rng(seed)
    name, row, column = rng.choice(["storage", "loss"]), rng.integers(1, 10), rng.integers(count)
    measured[name].values[row, column] *= factor
    return measured, (row, column)


@pytest.mark.parametrize("factor", [10.0, 0.1, 3.0])
def test_a_wrong_reading_of_a_short_sweep_shows_on_the_curve_of_all(factor):
    measured, place = few(16, factor)
    with pytest.warns(UserWarning, match="1 readings lie far off the master curve of all others"):
        found = master_curve(measured, 50.0)
    assert np.isnan(found.data["storage_fitted"].values[place])
    off = np.abs(found.log10_aT.values - shift(TEMPERATURES))
    assert np.all(off <= 3.0 * found.u_log10_aT.values + 1e-3)


def test_a_short_sweep_that_nothing_holds_in_its_place_does_not_pass():
    measured = sweeps(17).isel(frequency=[1, 8, 14], temperature=slice(2, None))
    measured["loss"].values[0] *= 0.1
    found = quiet(measured)
    off = np.abs(found.log10_aT.values - shift(TEMPERATURES[2:]))
    assert found.verdict.level != "pass" or np.all(off <= 3.0 * found.u_log10_aT.values)


@pytest.mark.parametrize("seed", [5010, 5024, 5036])
def test_the_vertical_factor_of_a_liquid_is_not_taken_for_a_delay(seed):
    rng = np.random.default_rng(seed)
    temperature, frequency = np.linspace(-45.0, 25.0, 6), np.logspace(-0.5, 2, 12)
    shifts = -5.5 * (temperature - 25.0) / (125.0 + temperature)
    z = 1j * 2 * np.pi * frequency[:, None] * 10 ** shifts[:, None, None] * np.array([1e-7, 1e-6, 1e-5])
    factor = ((temperature + 273.15) / 298.15 * (1 - 6e-4 * (temperature - 25.0)))[:, None]
    modulus = factor * ((z / (1 + z)) @ np.array([4e5, 2e5, 1e5]))
    measured = noisy(rng, temperature, frequency, modulus, 0.02, 0.02)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        found = master_curve(measured, 25.0)
    assert found.delay == 0.0
    assert np.all(np.abs(found.log10_aT.values - shifts) <= 3.0 * found.u_log10_aT.values + 1e-3)


def broad(seed, slope):
    """Five sweeps of one broad relaxation of a stiff plastic, as rarely tell a vertical slope."""
    rng = np.random.default_rng(seed)
    temperature, frequency = np.linspace(-40.0, 40.0, 5), np.logspace(-1, 1, 9)
    omega = 2 * np.pi * frequency
    shifts = 4200.0 * (1 / (temperature + 273.15) - 1 / 273.15)
    modulus = np.array(
        [
            (1 + slope * T) * (0.5e9 + 3e9 * dispersion(omega, 0.05 * 10**a, 0.3, 1.0))
            for T, a in zip(temperature, shifts, strict=True)
        ]
    )
    measured = noisy(rng, temperature, frequency, modulus, 0.01, 0.02)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        found = master_curve(measured, 0.0)
    other = np.arange(5) != 2
    off = (found.log10_aT.values - shifts)[other]
    return found, off / found.u_log10_aT.values[other], off / shifts[other]


def test_a_slope_that_sweeps_hardly_tell_is_fitted_all_the_same():
    """Left out where the criterion does not ask for it, it makes all shifts too large by a share (2.8 %)."""
    for slope in (0.0, -4e-4):
        parts = [broad(seed, slope) for seed in range(6)]
        assert all(found.verdict.level != "fail" for found, _, _ in parts)
        assert 0.4 < np.sqrt(np.mean([z**2 for _, z, _ in parts])) < 1.5
        assert abs(np.mean([share for _, _, share in parts])) < 0.018


def test_noise_that_lasts_from_reading_to_reading_makes_all_less_certain():
    """Four readings are worth one where neighbours err alike by 0.6: twice the uncertainty."""
    temperature, frequency = np.linspace(-40.0, 40.0, 5), np.logspace(-1, 1, 15)
    shifts = 4200.0 * (1 / (temperature + 273.15) - 1 / 273.15)
    modulus = 0.5e9 + 3e9 * dispersion(2 * np.pi * frequency * 10 ** shifts[:, None], 0.05, 0.3, 1.0)
    sizes = []
    for lasting in (0.0, 0.6):
        for seed in range(4):
            noise = np.random.default_rng(seed).standard_normal((2, *modulus.shape))
            for i in range(1, frequency.size):
                noise[..., i] = lasting * noise[..., i - 1] + np.sqrt(1 - lasting**2) * noise[..., i]
            measured = scattered(temperature, frequency, modulus, 0.01 * noise[0], 0.02 * noise[1])
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", UserWarning)
                found = master_curve(measured, 0.0, vertical="linear")
            sizes.append(float(np.mean(found.curve["u_storage"] / found.curve["storage"])))
    white, coloured = np.mean(np.reshape(sizes, (2, 4)), axis=1)
    assert 1.5 < coloured / white < 3.0, sizes


def softening_glass(seed, slope, width):
    """Ten sweeps of a plastic far below its transition: it loses a hundredth, at every frequency alike."""
    rng = np.random.default_rng(seed)
    temperature, frequency = np.linspace(-40.0, 120.0, 10), np.logspace(-1, 1, 11)
    shifts = 4200.0 * (1 / (temperature + 273.15) - 1 / (temperature[4] + 273.15))
    modulus = np.array(
        [
            (1 + slope * (T - temperature[4]))
            * (3e9 + 0.5e9 * dispersion(2 * np.pi * frequency, 0.05 * 10**a, width, 1.0))
            for T, a in zip(temperature, shifts, strict=True)
        ]
    )
    measured = noisy(rng, temperature, frequency, modulus, 0.003, 0.03)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        found = master_curve(measured, float(temperature[4]))
    off = np.abs(found.log10_aT.values - shifts)
    return found, off, np.all(off <= 3.0 * found.u_log10_aT.values + 1e-3)


@pytest.mark.parametrize("slope", by_day([-2e-4, -4e-4, -8e-4], 2))
def test_a_softening_glass_of_little_loss_is_not_decades_off(slope):
    found, off, is_covered = softening_glass(3, slope, 0.12)
    assert is_covered, (off, found.u_log10_aT.values)
    assert np.max(off) < 1.0 or found.verdict.level != "pass"
    assert found.vertical != "none"


@pytest.mark.parametrize("fall", [0.0, 6e-4])
def test_the_density_of_a_liquid_that_flows_may_fall_or_not(fall):
    z = []
    for seed in range(3):
        rng = np.random.default_rng((7, seed))
        temperature, frequency = np.linspace(-45.0, 25.0, 8), np.logspace(-0.5, 2, 14)
        shifts = -5.5 * (temperature - 25.0) / (125.0 + temperature)
        z_of = 1j * 2 * np.pi * frequency[:, None] * 10 ** shifts[:, None, None] * np.array([1e-6, 1e-5, 1e-4])
        factor = ((temperature + 273.15) / 298.15 * (1 - fall * (temperature - 25.0)))[:, None]
        modulus = factor * ((z_of / (1 + z_of)) @ np.array([4e5, 2e5, 1e5]))
        found = quiet(noisy(rng, temperature, frequency, modulus, 0.02, 0.02), at=25.0)
        z.append(((found.log10_aT.values - shifts) / np.maximum(found.u_log10_aT.values, 1e-9))[:-1])
    assert np.sqrt(np.mean(np.square(z))) < 1.5


def glass_and_rubber(seed, count=25):
    """Sweeps from glass to rubber with a delay, levels of their own and clamps that lose energy."""
    rng = np.random.default_rng(seed)
    temperature, frequency = np.linspace(-40.0, 160.0, count), np.logspace(-1.5, 1.5, 31)
    omega, T_g = 2 * np.pi * frequency, 50.0
    shifts = np.where(
        temperature < T_g,
        1.3e4 * (1 / (temperature + 273.15) - 1 / (T_g + 273.15)),
        -12 * (temperature - T_g) / (90 + np.maximum(temperature, T_g) - T_g),
    )
    modulus = np.array([1e7 + 1.5e9 * dispersion(omega, 10**a, 0.35, 0.5) for a in shifts])
    modulus = modulus * np.exp(1j * omega * 1.2e-4) * np.exp(0.03 * rng.standard_normal(count))[:, None]
    modulus = modulus + 0.015j * modulus.real * (omega / (2 * np.pi)) ** 0.2
    return noisy(rng, temperature, frequency, modulus, 0.01, 0.02)


@pytest.mark.slow
def test_a_hard_search_ends_after_its_work_and_says_so(monkeypatch):
    seen = []

    def watched(*args):
        seen.append(read(*args))
        return seen[-1]

    read = _master_curve.read_sweeps
    monkeypatch.setattr(_master_curve, "read_sweeps", watched)
    found = quiet(glass_and_rubber(1), at=60.0)
    work = seen[0].points.work
    assert work.spent < 80e6
    assert found.verdict.level != "pass"
    assert work.is_cut == any("fixed amount of work" in reason for reason in found.verdict.reasons)


def test_work_is_cut_only_where_something_was_left_out():
    work = Work()
    assert work.goes_on()
    work.spent = 30_000_000
    assert work.goes_on()
    assert not work.is_cut
    assert not work.goes_on(times=2)
    assert work.is_cut
