"""Ten records as laboratories have them, each with known shifts: what is easy, and what misleads."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from labpipe.arrays import Complexes, Floats
from pipelines.bench.rheology_truth import Measured, Truth, recorded

_ZERO_CELSIUS = 273.15
_GAS_LN10 = 8.314462618 * float(np.log(10.0))


@dataclass(frozen=True, slots=True)
class Scene:
    """One kind of record.

    ``build``: Record made with a seed. ``superposes``: Whether time-temperature superposition is true of it.
    """

    name: str
    build: Callable[[int], Measured]
    superposes: bool = True


def dispersion(omega: Floats, time: float, alpha: float, gamma: float) -> Complexes:
    """Havriliak and Negami's function of a modulus: zero far below the dispersion, one far above.

    References
    ----------
    Havriliak & Negami, Polymer 8 (1967) 161, doi:10.1016/0032-3861(67)90021-3.
    """
    return np.asarray((1.0 + (1j * omega * time) ** -alpha) ** -gamma)


def scenes() -> Iterator[Scene]:
    """Yield the scenes in the order in which they are shown."""
    yield Scene("Havriliak-Negami, loss ten times as noisy", _unequal_noise)
    yield Scene("entangled melt, b_T of density", _melt)
    yield Scene("two processes that shift apart", _two_processes, superposes=False)
    yield Scene("three-point sweeps", lambda seed: _network(seed, points=3))
    yield Scene("200-point sweeps at 40 temperatures", lambda seed: _network(seed, temperatures=40, points=200))
    yield Scene("outliers of ten and a hundred times", _outliers)
    yield Scene("repeated temperatures", _repeats)
    yield Scene("missing temperatures", _gaps)
    yield Scene("stiff glass, tan δ 0.01", stiff_glass)
    yield Scene("liquid of short chains, b_T of density", _liquid)


def _wlf(c1: float, c2: float, about: float) -> Callable[[Floats], Floats]:
    return lambda T: np.asarray(-c1 * (T - about) / (c2 + T - about))


def _rubber(omega: Floats) -> Complexes:
    return np.asarray(6e6 + 1.2e9 * dispersion(omega, 2e-4, 0.55, 0.6))


def _network(
    seed: int, temperatures: int = 12, points: int = 11, noise: tuple[float, float] = (0.02, 0.02)
) -> Measured:
    truth = Truth("network", 40.0, _rubber, _wlf(9.0, 110.0, 40.0))
    temperature, frequency = np.linspace(0.0, 90.0, temperatures), np.logspace(-1.0, 1.5, points)
    return recorded(truth, temperature, frequency, np.random.default_rng(seed), noise)


def _unequal_noise(seed: int) -> Measured:
    return _network(seed, noise=(0.005, 0.05))


def _spectrum(weight: Callable[[Floats], Floats], shortest: float, longest: float) -> Callable[[Floats], Complexes]:
    """Sum a continuous spectrum H(τ) finely over ln τ."""
    time = np.exp(np.arange(np.log(shortest), np.log(longest), 0.02))
    share = 0.02 * weight(time)

    def modulus(omega: Floats) -> Complexes:
        z = 1j * omega[..., None] * time
        return np.asarray((z / (1.0 + z)) @ share)

    return modulus


def _density(T: Floats) -> Floats:
    """Return b_T = ρT/(ρT)_ref of a melt whose density falls by 0.06 % per kelvin."""
    return np.asarray((T + _ZERO_CELSIUS) / (25.0 + _ZERO_CELSIUS) * (1.0 - 6e-4 * (T - 25.0)))


def _bsw(longest: float, plateau: float) -> Callable[[Floats], Complexes]:
    """Baumgaertel, Schausberger and Winter's spectrum: an entangled flow over a transition to glass.

    References
    ----------
    Baumgaertel, Schausberger & Winter, Rheol. Acta 29 (1990) 400, doi:10.1007/BF01376790.
    """

    def weight(time: Floats) -> Floats:
        flow = 0.22 * plateau * (time / longest) ** 0.22
        return np.asarray((flow + 0.22 * plateau * (time / 1e-5) ** -0.67) * (time <= longest))

    return _spectrum(weight, 1e-11, longest)


def _melt(seed: int) -> Measured:
    truth = Truth("melt", 25.0, _bsw(0.8, 4.4e5), _wlf(4.9, 150.0, 25.0))
    temperature, frequency = np.linspace(-35.0, 65.0, 7), np.logspace(-1.0, 2.0, 16)
    return recorded(truth, temperature, frequency, np.random.default_rng(seed), (0.02, 0.02), _density)


def _liquid(seed: int) -> Measured:
    """Short chains flow at nearly every temperature: the slopes are one and two, nothing bends."""
    truth = Truth("liquid", 25.0, _bsw(2e-4, 4.4e5), _wlf(4.9, 150.0, 25.0))
    temperature, frequency = np.linspace(-45.0, 25.0, 8), np.logspace(-0.5, 2.0, 14)
    return recorded(truth, temperature, frequency, np.random.default_rng(seed), (0.02, 0.02), _density)


def _two_processes(seed: int) -> Measured:
    """Let the second dispersion shift by half of the first one's decades; the first one's are the truth."""
    shift = _wlf(10.0, 150.0, 50.0)
    temperature, frequency = np.linspace(0.0, 100.0, 11), np.logspace(-1.0, 2.0, 16)
    truth = Truth("two", 50.0, lambda omega: 6e8 * dispersion(omega, 0.1, 0.5, 0.7) + 8e6, shift)
    made = recorded(truth, temperature, frequency, np.random.default_rng(seed), (0.0, 0.0))
    second = 2.0 * np.pi * frequency * 10.0 ** (0.5 * shift(temperature))[:, None]
    exact = made.exact + 4e8 * dispersion(second, 1e-4, 0.4, 1.0)
    rng = np.random.default_rng(seed)
    noisy = (part * (1.0 + 0.02 * rng.standard_normal(exact.shape)) for part in (exact.real, exact.imag))
    sweeps = made.sweeps.copy()
    for name, values in zip(("storage", "loss"), noisy, strict=True):
        sweeps[name] = sweeps[name].copy(data=values)
    return replace(made, sweeps=sweeps, exact=exact)


def _outliers(seed: int) -> Measured:
    """Put one reading of ten times, one of a hundred times and one of a tenth into each modulus."""
    made = _network(seed)
    rng = np.random.default_rng((seed, 1))
    sweeps = made.sweeps.copy(deep=True)
    for name in ("storage", "loss"):
        flat = sweeps[name].values.reshape(-1)
        flat[rng.choice(flat.size, 3, replace=False)] *= np.array([10.0, 100.0, 0.1])
    return replace(made, sweeps=sweeps)


def _repeats(seed: int) -> Measured:
    """Measure every other temperature twice; every sweep was 0.3 K from where its thermometer says."""
    truth = Truth("network", 40.0, _rubber, _wlf(9.0, 110.0, 40.0))
    rng = np.random.default_rng(seed)
    nominal = np.sort(np.concatenate([np.linspace(0.0, 90.0, 10), np.linspace(0.0, 80.0, 5)]))
    made = recorded(truth, nominal + 0.3 * rng.standard_normal(nominal.size), np.logspace(-1.0, 1.5, 11), rng)
    at = int(np.argmin(np.abs(nominal - 40.0)))
    law = truth.shift(nominal)
    sweeps = made.sweeps.assign_coords(temperature=("temperature", nominal, {"units": "degC"}))
    return replace(made, sweeps=sweeps, reference=float(nominal[at]), log10_aT=law - law[at])


def _gaps(seed: int) -> Measured:
    """Leave three temperatures of twelve out: neighbours there share no frequency."""
    made = _network(seed)
    kept = [0, 1, 2, 5, 6, 8, 9, 10, 11]
    return replace(
        made, sweeps=made.sweeps.isel(temperature=kept), log10_aT=made.log10_aT[kept], exact=made.exact[kept]
    )


def stiff_glass(seed: int) -> Measured:
    """Sweep a glass far below its transition: it loses a hundredth, and hardly changes with frequency."""

    def shift(T: Floats) -> Floats:
        return np.asarray(250e3 / _GAS_LN10 * (1.0 / (T + _ZERO_CELSIUS) - 1.0 / (60.0 + _ZERO_CELSIUS)))

    def modulus(omega: Floats) -> Complexes:
        return np.asarray(2.4e9 * dispersion(omega, 1e4, 0.3, 1.0) + 1.4e9 * dispersion(omega, 1e-3, 0.05, 1.0) + 2e8)

    truth = Truth("glass", 60.0, modulus, shift)
    temperature, frequency = np.linspace(20.0, 100.0, 9), np.logspace(-1.0, 1.5, 11)
    return recorded(truth, temperature, frequency, np.random.default_rng(seed), (0.002, 0.02))
