"""Oscillations, steady or decaying: frequency, damping, amplitude, phase, stiffness and lag, with uncertainties.

The frequency is always fitted, never taken from a header: instruments are off by up to a per cent,
and a lock-in at the wrong frequency turns by tens of degrees over twenty cycles.

Variable projection: at a trial frequency and decay everything else is linear, so only these are
searched; the covariance is that of all parameters together.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.ndimage import uniform_filter1d
from scipy.optimize import least_squares

from labpipe.arrays import Floats
from labpipe.errors import InputError
from labpipe.signals._readings import is_constant, readings_of
from labpipe.uncertainty import propagated_u

_HALF_WIDTH = 6  # bins on either side over which the residuals' spectrum is averaged


def parameter_covariance(jacobian: Floats, residual: Floats) -> Floats:
    """Covariance of least-squares parameters under stationary, correlated residuals.

    ``jacobian`` (n, p) is the derivative of the model by its parameters at (nearly) even times, ``residual`` (n,)
    that of the fit: ``(J'J)^-1 J'CJ (J'J)^-1`` with C the circulant covariance of the smoothed residual spectrum, which
    is enlarged by the power that the fit has taken out of its bins. Of white residuals it is ``s^2 (J'J)^-1``.
    """
    n = len(jacobian)
    scale = np.linalg.norm(jacobian, axis=0)
    columns = jacobian / np.where(scale > 0, scale, 1.0)
    inverse = np.linalg.pinv(columns.T @ columns, hermitian=True)
    spectra = np.fft.fft(columns, axis=0)
    taken = np.real(np.sum((spectra.conj() @ inverse) * spectra, axis=1)) / n
    width = min(2 * _HALF_WIDTH + 1, n)
    power = uniform_filter1d(np.abs(np.fft.fft(residual)) ** 2 / n, width, mode="wrap")
    left = np.maximum(1.0 - uniform_filter1d(taken, width, mode="wrap"), 1.0 / width)
    middle = np.real(spectra.conj().T @ ((power / left)[:, None] * spectra)) / n
    both = np.outer(scale, scale)
    # A parameter on which nothing depends has no uncertainty: NaN.
    return np.divide(inverse @ middle @ inverse, both, out=np.full_like(both, np.nan), where=both > 0)


_TRIAL_RATES = np.geomspace(0.1, 30.0, 6)  # decay over the record, to begin the fit with
_FEWEST_CYCLES = 1.5  # of a decaying vibration


@dataclass(frozen=True, slots=True)
class Oscillation:
    """``sum of trend_k s^k + exp(-rate s) sum of amplitude_k sin(2 pi k frequency s + phase_k)``.

    ``s`` is the time from ``reference_time``. ``frequency`` is the damped one fd = f0 sqrt(1 - zeta^2) in Hz, ``rate``
    2 pi f0 zeta in 1/s and ``damping_ratio`` zeta. Amplitude and phase are those of the fundamental, at the reference
    time; ``waves`` are amplitude_k exp(i phase_k). Phases in rad, the rest in units of the signal.
    """

    frequency: float
    u_frequency: float
    damping_ratio: float
    u_damping_ratio: float
    amplitude: float
    u_amplitude: float
    phase: float
    u_phase: float
    reference_time: float
    rate: float
    waves: tuple[complex, ...]
    trend: tuple[float, ...]
    residual_rms: float

    @property
    def offset(self) -> float:
        """Mean of the signal at the reference time."""
        return self.trend[0]

    @property
    def natural_frequency(self) -> float:
        """Frequency without damping [Hz]."""
        return float(np.hypot(self.frequency, self.rate / (2 * np.pi)))

    def at(self, time: ArrayLike) -> Floats:
        """Return the fitted curve at times [s]."""
        s = np.asarray(time, float) - self.reference_time
        turns = np.exp((2j * np.pi * self.frequency * np.arange(1, len(self.waves) + 1)[:, None] - self.rate) * s)
        return np.asarray(np.polynomial.polynomial.polyval(s, self.trend) + (np.array(self.waves) @ turns).imag)


class CommonFit(NamedTuple):
    """Position and force at one frequency.

    ``phase_lag`` (rad) is how far the force leads the position, positive for a lossy solid;
    ``storage_stiffness`` and ``loss_stiffness`` are ``|F/x| cos`` and ``|F/x| sin`` of it (N/m).
    """

    position: Oscillation
    force: Oscillation
    phase_lag: float
    u_phase_lag: float
    storage_stiffness: float
    u_storage_stiffness: float
    loss_stiffness: float
    u_loss_stiffness: float


def fit_sinusoid(
    time: ArrayLike,
    signal: ArrayLike,
    frequency_guess: float | None = None,
    *,
    harmonics: int = 3,
    trend_order: int = 1,
    is_damped: bool = False,
    reference_time: float | None = None,
) -> Oscillation:
    """Fit a sinusoid of unknown frequency, steady with harmonics or decaying, and a slow trend.

    Parameters
    ----------
    time, signal : array (n,) [s, any unit]
        Increasing, nearly even times; NaN of the signal is left out.
    frequency_guess : float, optional [Hz]
        Good to about 1/T; default the strongest line of the spectrum.
    harmonics : int
        Number of waves of a steady one, the fundamental included; those above the Nyquist frequency are left out.
    trend_order : int
        Degree of the polynomial trend of a steady one (0 offset, 1 drift, ...).
    is_damped : bool
        Whether the vibration decays, free from the first reading on.
    reference_time : float, optional [s]
        Where amplitude and phase are stated; default the middle of a steady one, the first reading of a decaying one.

    Raises
    ------
    InputError
        Too few readings, less than one cycle (1.5 of a decaying one), or a signal that does not vary.

    Examples
    --------
    >>> time = np.arange(0.0, 20.0, 0.01)
    >>> fit = fit_sinusoid(time, 2.0 * np.sin(2 * np.pi * 0.4972 * time + 0.3) + 5.0)
    >>> round(fit.frequency, 6), round(fit.amplitude, 6), round(fit.offset, 6)
    (0.4972, 2.0, 5.0)
    """
    t, y = varying(time, signal)
    reference = float(0.5 * (t[0] + t[-1]) if not is_damped else t[0]) if reference_time is None else reference_time
    s, span, nyquist = t - reference, float(t[-1] - t[0]), 0.5 / float(np.median(np.diff(t)))
    # A vibration that dies out early is all at the beginning, where a taper would hide it.
    guess = strongest_line(s, y, taper=not is_damped) if frequency_guess is None else float(frequency_guess)
    least = _FEWEST_CYCLES if is_damped else 1.0
    if not 0.0 < guess < nyquist or guess * span < least - 1e-9:
        raise InputError(
            f"a sinusoid of {guess:.6g} Hz cannot be fitted to {span:.6g} s at {2 * nyquist:.6g} readings per s: "
            f"at least {'1.5 cycles' if is_damped else 'one cycle'} and two readings per cycle are needed"
        )
    n_waves = 1 if is_damped else max(min(harmonics, int(0.98 * nyquist / guess)), 1)
    degree = 1 if is_damped else trend_order
    n_parameters = degree + 2 + is_damped + 2 * n_waves
    if len(t) < 2 * n_parameters:
        raise InputError(f"{len(t)} readings cannot determine {n_parameters} parameters of a sinusoid")
    # In units of the signal, or the optimiser's absolute tolerances would end it at once.
    model, scatter = _Model(s, y, n_waves, degree), float(np.std(y))

    def residual(p: Floats) -> Floats:
        return model.linear(guess * p[0], p[1] / span if is_damped else 0.0)[1] / scatter

    if is_damped:
        trials, low, high = np.array([[1.0, rate] for rate in _TRIAL_RATES]), [0.3, -1.0], [3.0, 200.0]
    else:
        # The misfit has one minimum within 1.2 / T. A guess may be as far off, the strongest line half as far.
        reach = (1.2 if frequency_guess is not None else 0.6) / (span * guess)
        low, high = [max(1.0 - reach, 0.2)], [min(1.0 + reach, nyquist / guess)]
        trials = np.linspace(low, high, 19)[1:-1]
    begin = min(trials, key=lambda p: float(np.sum(residual(p) ** 2)))
    accuracy = {"ftol": 1e-12, "xtol": 1e-12, "gtol": 1e-12}
    found = least_squares(
        residual, begin, bounds=(low, high), x_scale=[0.1 / (guess * span), 1.0][: begin.size], **accuracy
    )
    rate = float(found.x[1]) / span if is_damped else 0.0
    return model.described(guess * float(found.x[0]), rate, reference, begin.size)


def common_fit(
    time: ArrayLike,
    position: ArrayLike,
    force: ArrayLike,
    frequency_guess: float | None = None,
    *,
    response: Callable[[float], complex] | None = None,
) -> CommonFit:
    """Fit position and force at the position's frequency: stiffness and phase lag.

    Parameters
    ----------
    time, position, force : array (n,) [s, m, N]
        Compression and indentation positive; NaN is left out.
    frequency_guess : float, optional [Hz]
        As in :func:`fit_sinusoid`.
    response : callable, optional
        Complex response of the force channel at a frequency [Hz], by which its fundamental is divided.

    Notes
    -----
    A parabolic trend leaves room for a relaxing mean force. An uneven stage moves force and position together: only the
    part of the force that does not follow the position, delayed by the lag, makes their ratio uncertain.
    """
    t, x, load = readings_of(time=time, position=position, force=force)
    varying(t, load)  # a constant force has no phase
    moved = fit_sinusoid(t, x, frequency_guess, trend_order=2)
    s, omega = t - moved.reference_time, 2 * np.pi * moved.frequency
    recorded = _Model(s, load, len(moved.waves), 2).described(moved.frequency, 0.0, moved.reference_time, 0)
    factor = 1.0 + 0.0j if response is None else response(moved.frequency)
    wave = recorded.waves[0] / factor
    pushed = replace(
        recorded,
        amplitude=abs(wave),
        u_amplitude=recorded.u_amplitude / abs(factor),
        phase=float(np.angle(wave)),
        waves=(wave, *recorded.waves[1:]),
    )
    ratio = wave / moved.waves[0]
    delayed = float(np.angle(recorded.waves[0] / moved.waves[0]))
    followed = np.interp(t + delayed / omega, t, x - moved.at(t))
    own = (load - recorded.at(t)) / recorded.amplitude - followed / moved.amplitude
    angle = omega * s + recorded.phase
    covariance = parameter_covariance(np.column_stack([np.sin(angle), np.cos(angle), np.ones_like(t)]), own)
    relative, u_lag = np.sqrt(np.diag(covariance)[:2]).tolist()
    u_storage = float(np.hypot(relative * ratio.real, u_lag * ratio.imag))
    u_loss = float(np.hypot(relative * ratio.imag, u_lag * ratio.real))
    return CommonFit(moved, pushed, float(np.angle(ratio)), u_lag, ratio.real, u_storage, ratio.imag, u_loss)


def varying(time: ArrayLike, signal: ArrayLike) -> list[Floats]:
    """Return the finite readings of an oscillation (n,); InputError: fewer than six, or a signal that does not vary."""
    t, y = readings_of(time=time, signal=signal)
    if len(t) < 6:
        raise InputError(f"an oscillation needs 6 readings; found {len(t)}")
    if is_constant(y):
        raise InputError("the signal does not vary: no oscillation in it")
    return [t, y]


def strongest_line(s: Floats, y: Floats, *, taper: bool = True) -> float:
    """Return the frequency of the strongest line, good to a fraction of 1/T; a taper resolves close lines."""
    even = np.linspace(s[0], s[-1], len(s))
    values = np.interp(even, s, y)
    values = values - np.polynomial.polynomial.polyval(even, np.polynomial.polynomial.polyfit(even, values, 1))
    size = 4 * len(s)
    window = np.hanning(len(s)) if taper else np.ones(len(s))
    power = np.abs(np.fft.rfft(values * window, size))
    frequency = np.fft.rfftfreq(size, float(even[1] - even[0]))
    possible = frequency * float(s[-1] - s[0]) >= 1.0
    return float(frequency[possible][np.argmax(power[possible])])


class _Model:
    """A fit of waves with harmonics about a polynomial trend, linear but for their frequency and rate."""

    def __init__(self, s: Floats, y: Floats, n_waves: int = 1, degree: int = 1) -> None:
        self.s, self.y, self.n_waves, self.mean = s, y, n_waves, float(np.mean(y))
        self.half = float(np.max(np.abs(s)))
        self.powers = np.vander(s / self.half, degree + 1, increasing=True).T

    def linear(self, frequency: float, rate: float = 0.0) -> tuple[Floats, Floats, Floats]:
        """Return coefficients, residuals and columns: sin and cos of every wave, then powers of the time."""
        turns = np.exp(2j * np.pi * frequency * self.s)[None]
        if self.n_waves > 1:
            turns = np.cumprod(np.repeat(turns, self.n_waves, axis=0), axis=0)
        turns = turns * np.exp(-rate * self.s) if rate else turns
        columns = np.concatenate([turns.imag, turns.real, self.powers])
        # Waves over a cycle or more and low powers are well conditioned: normal equations suffice.
        coefficients = np.linalg.lstsq(columns @ columns.T, columns @ (self.y - self.mean), rcond=None)[0]
        left = self.y - self.mean - coefficients @ columns
        coefficients[2 * self.n_waves] += self.mean
        return coefficients, left, columns.T

    def described(self, frequency: float, rate: float, reference: float, n_free: int) -> Oscillation:
        """Describe the fit at its best frequency and rate, of which the first ``n_free`` were fitted."""
        s, n_waves = self.s, self.n_waves
        coefficients, left, design = self.linear(frequency, rate)
        waves = coefficients[:n_waves] + 1j * coefficients[n_waves : 2 * n_waves]
        curves = waves * (design[:, n_waves : 2 * n_waves] + 1j * design[:, :n_waves])
        by_frequency, by_rate = 2 * np.pi * s * (curves.real @ np.arange(1, n_waves + 1)), -s * curves.imag.sum(axis=1)
        jacobian = np.column_stack([design, *[by_frequency, by_rate][:n_free]])
        covariances = [parameter_covariance(jacobian, left)]
        if n_free == 2:
            # The spectrum of a short residual is known to a fifth at best; the larger u is stated.
            scale = np.linalg.norm(jacobian, axis=0)
            white = np.linalg.pinv((jacobian / scale).T @ (jacobian / scale), hermitian=True) / np.outer(scale, scale)
            covariances.append(float(left @ left) / max(len(left) - jacobian.shape[1], 1) * white)

        def u_of(gradient: dict[int, float]) -> float:
            along = np.zeros(jacobian.shape[1])
            along[list(gradient)] = list(gradient.values())
            return max(float(propagated_u(along, covariance)) for covariance in covariances)

        amplitude, unit = abs(waves[0]), waves[0] / max(abs(waves[0]), np.finfo(float).tiny)
        omega, m = 2 * np.pi * frequency, design.shape[1]
        natural = float(np.hypot(omega, rate))
        by_both = {m: -2 * np.pi * rate * omega / natural**3, m + 1: omega**2 / natural**3}
        return Oscillation(
            frequency=frequency,
            u_frequency=u_of({m: 1.0}) if n_free else 0.0,
            damping_ratio=rate / natural,
            u_damping_ratio=u_of(by_both) if n_free == 2 else 0.0,
            amplitude=float(amplitude),
            u_amplitude=u_of({0: unit.real, n_waves: unit.imag}),
            phase=float(np.angle(waves[0])),
            u_phase=u_of({0: -unit.imag, n_waves: unit.real}) / float(amplitude),
            reference_time=reference,
            rate=rate,
            waves=tuple(waves.tolist()),
            trend=tuple((coefficients[2 * n_waves :] / self.half ** np.arange(len(self.powers))).tolist()),
            residual_rms=float(np.sqrt(np.mean(left**2))),
        )
