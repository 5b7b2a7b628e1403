"""Sinusoids: frequency, amplitude, phase, stiffness and lag, with uncertainties.

The frequency is always fitted, never taken from a header: instruments are off by up to a per cent,
and a lock-in at the wrong frequency turns by tens of degrees over twenty cycles.

Rounding is not noise: a sinusoid that runs over the same steps again in every cycle is rounded
equally in every cycle. Part of that error looks exactly like the sinusoid, is taken up by the fit and
leaves nothing in the residuals. Where the step of the readings is known, its contribution is
therefore found by rounding the fitted curve itself.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.ndimage import uniform_filter1d
from scipy.optimize import minimize_scalar

from labpipe.arrays import Floats
from labpipe.errors import InputError
from labpipe.signals._readings import checked_times, is_constant, refuse_infinite
from labpipe.uncertainty import propagated_u

_HALF_WIDTH = 6  # bins on either side over which the residuals' spectrum is averaged


def parameter_covariance(jacobian: Floats, residual: Floats) -> Floats:
    """Covariance of least-squares parameters under stationary, correlated residuals.

    ``jacobian`` (n, p) is the derivative of the model by its parameters, at (nearly) even times, ``residual`` (n,)
    that of the fit.

    Notes
    -----
    Sandwich ``(J'J)^-1 J'CJ (J'J)^-1`` with C the circulant covariance of the smoothed residual
    spectrum. The fit has taken power out of the bins that it listens to; the spectrum is enlarged
    by as much. For white residuals this is the usual ``s^2 (J'J)^-1``.

    Examples
    --------
    >>> noise = np.random.default_rng(0).standard_normal(4000)
    >>> cov = parameter_covariance(np.ones((4000, 1)), noise - noise.mean())
    >>> bool(abs(cov[0, 0] ** 0.5 * 4000**0.5 - 1) < 0.3)
    True
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
    # A parameter on which nothing depends has no uncertainty that could be told: NaN.
    return np.divide(inverse @ middle @ inverse, both, out=np.full_like(both, np.nan), where=both > 0)


_GRID = 4  # trial frequencies per 1/T in the coarse search
_REACH = 1.2  # in 1/T: the misfit has one minimum within a line's width
_FEWEST_PER_PARAMETER = 2
_TREND = 2  # degree of a relaxing mean force
# Places of the curve between two steps over which rounding is averaged: u is good to 9 %.
_OFFSETS = 64


@dataclass(frozen=True, slots=True)
class Sinusoid:
    """``trend_0 + trend_1 s + ... + sum amplitude_k sin(2 pi k frequency s + phase_k)``.

    ``s`` is the time from ``reference_time`` (the middle of the record). Amplitudes and phases are
    those of the fundamental; ``harmonic_amplitudes`` and ``harmonic_phases`` start with it.
    ``u_`` are standard uncertainties that account for autocorrelated residuals. Phases in rad,
    frequency in Hz, the rest in units of the signal.
    """

    frequency: float
    u_frequency: float
    amplitude: float
    u_amplitude: float
    phase: float
    u_phase: float
    reference_time: float
    harmonic_amplitudes: tuple[float, ...]
    harmonic_phases: tuple[float, ...]
    trend: tuple[float, ...]

    @property
    def offset(self) -> float:
        """Mean of the signal at the reference time."""
        return self.trend[0]

    def __call__(self, time: ArrayLike) -> Floats:
        """Evaluate the fitted curve."""
        s = np.asarray(time, float) - self.reference_time
        angle = 2 * np.pi * self.frequency * s
        waves = zip(self.harmonic_amplitudes, self.harmonic_phases, strict=True)
        value = np.polynomial.polynomial.polyval(s, self.trend)
        for k, (amplitude, phase) in enumerate(waves, start=1):
            value = value + amplitude * np.sin(k * angle + phase)
        return np.asarray(value)


@dataclass(frozen=True, slots=True)
class CommonFit:
    """Position and force at one frequency.

    ``phase_lag`` (rad) is how far the force leads the position, positive for a lossy solid;
    ``storage_stiffness`` and ``loss_stiffness`` are ``|F/x| cos`` and ``|F/x| sin`` of it (N/m).
    """

    position: Sinusoid
    force: Sinusoid
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
    resolution: float = 0.0,
) -> Sinusoid:
    """Fit a sinusoid of unknown frequency with harmonics and a slow trend.

    Parameters
    ----------
    time : array (n,) [s]
        Increasing, nearly even.
    signal : array (n,)
        NaN is left out.
    frequency_guess : float, optional [Hz]
        Good to about 1/T; default the strongest line of the spectrum.
    harmonics : int
        Number of waves, the fundamental included; those above the Nyquist frequency are left out.
    trend_order : int
        Degree of the polynomial trend (0 offset, 1 drift, ...).
    resolution : float
        Step to which the readings are rounded, in their unit; 0 where it is not known. It enters
        the uncertainties alone.

    Returns
    -------
    Sinusoid

    Raises
    ------
    InputError
        Too few readings, less than one cycle, or a signal that does not vary.

    Notes
    -----
    Variable projection: for a trial frequency everything else is linear, so only the frequency is
    searched; the covariance is that of all parameters together. That of rounding is the mean over
    the places of the curve between two steps; the residuals count only as far as they exceed it.
    For a slow sinusoid of amplitude A in steps q it tends to 0.11 q sqrt(q/A) of the amplitude,
    however many cycles and readings there are (the Bessel series of Blachman, IEEE Trans. Commun.
    33 (1985) 1371).

    Examples
    --------
    >>> time = np.arange(0.0, 20.0, 0.01)
    >>> fit = fit_sinusoid(time, 2.0 * np.sin(2 * np.pi * 0.4972 * time + 0.3) + 5.0)
    >>> round(fit.frequency, 6), round(fit.amplitude, 6), round(fit.offset, 6)
    (0.4972, 2.0, 5.0)
    """
    t, y = readings_of(time, signal)
    reference = 0.5 * (t[0] + t[-1])
    s = t - reference
    span = float(t[-1] - t[0])
    nyquist = 0.5 / float(np.median(np.diff(t)))
    guess = strongest_line(s, y) if frequency_guess is None else float(frequency_guess)
    if not 0.0 < guess < nyquist or guess * span < 1.0 - 1e-9:
        raise InputError(
            f"a sinusoid of {guess:.6g} Hz cannot be fitted to {span:.6g} s at "
            f"{2 * nyquist:.6g} readings per s: at least one cycle and two readings per cycle"
        )
    n_waves = max(min(harmonics, int(0.98 * nyquist / guess)), 1)
    n_parameters = trend_order + 2 + 2 * n_waves
    if len(t) < _FEWEST_PER_PARAMETER * n_parameters:
        raise InputError(f"{len(t)} readings cannot determine {n_parameters} parameters of a sinusoid")

    def misfit(frequency: float) -> float:
        return float(np.sum(_linear(s, y, frequency, n_waves, trend_order)[1] ** 2))

    reach = _REACH / span
    bounds = (max(guess - reach, 0.2 * guess), min(guess + reach, nyquist))
    if frequency_guess is not None:
        # A guess may lie a line's width off: the best of a few trials brackets the minimum.
        grid = np.linspace(*bounds, 4 * _GRID + 1)
        best = int(np.argmin([misfit(f) for f in grid]))
        bounds = (grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)])
    else:
        bounds = (max(guess - 0.5 * reach, bounds[0]), min(guess + 0.5 * reach, bounds[1]))
    tolerance = {"xatol": 1e-9 * guess}
    found = minimize_scalar(misfit, bounds=bounds, method="bounded", options=tolerance)
    return _described(s, y, float(found.x), n_waves, trend_order, reference, step=resolution)


def common_fit(
    time: ArrayLike,
    position: ArrayLike,
    force: ArrayLike,
    frequency_guess: float | None = None,
    *,
    response: Callable[[float], complex] | None = None,
    resolutions: tuple[float, float] = (0.0, 0.0),
) -> CommonFit:
    """Fit position and force at the position's frequency: stiffness and phase lag.

    Parameters
    ----------
    time, position, force : array (n,) [s, m, N]
        Compression and indentation positive. Samples where either is NaN are left out.
    frequency_guess : float, optional [Hz]
        As in :func:`fit_sinusoid`.
    response : callable, optional
        Complex response of the force channel at a frequency in Hz, by whose fundamental the force
        is divided (a load cell's low-pass filter).
    resolutions : pair of float [m, N]
        Steps to which position and force are rounded; 0 where they are not known.

    Returns
    -------
    CommonFit

    Notes
    -----
    A parabolic trend leaves room for a relaxing mean force. An uneven stage moves force and position alike: only the
    part of the force that does not follow the position, delayed by the lag, makes their ratio uncertain.

    Examples
    --------
    >>> time = np.arange(0.0, 20.0, 0.01)
    >>> angle = 2 * np.pi * 0.5 * time
    >>> fit = common_fit(time, 1e-4 * np.sin(angle), 2.0 * np.sin(angle + 0.1))
    >>> round(fit.phase_lag, 6), round(fit.storage_stiffness, 3)
    (0.1, 19900.083)
    """
    t, x, load = (np.asarray(a, float) for a in (time, position, force))
    if not t.shape == x.shape == load.shape:
        raise InputError(f"time, position and force differ in shape: {t.shape}, {x.shape}, {load.shape}")
    refuse_infinite(x, "position")
    refuse_infinite(load, "force")
    both = np.isfinite(x) & np.isfinite(load)
    t, x, load = t[both], x[both], load[both]
    readings_of(t, load)  # a constant force has no phase
    moved = fit_sinusoid(t, x, frequency_guess, trend_order=_TREND, resolution=resolutions[0])
    s, n_waves = t - moved.reference_time, len(moved.harmonic_amplitudes)
    pushed = recorded = _described(
        s, load, moved.frequency, n_waves, _TREND, moved.reference_time, fixed=True, step=resolutions[1]
    )
    if response is not None:
        factor = response(moved.frequency)
        gain, amplitude = abs(factor), recorded.amplitude / abs(factor)
        phase = recorded.phase - float(np.angle(factor))
        pushed = replace(
            recorded,
            amplitude=amplitude,
            u_amplitude=recorded.u_amplitude / gain,
            phase=phase,
            harmonic_amplitudes=(amplitude, *recorded.harmonic_amplitudes[1:]),
            harmonic_phases=(phase, *recorded.harmonic_phases[1:]),
        )
    lag = float(np.angle(np.exp(1j * (pushed.phase - moved.phase))))
    stiffness = pushed.amplitude / moved.amplitude
    omega, delayed = 2 * np.pi * moved.frequency, float(np.angle(np.exp(1j * (recorded.phase - moved.phase))))
    followed = np.interp(t + delayed / omega, t, x - moved(t))
    own = (load - recorded(t)) / recorded.amplitude - followed / moved.amplitude
    angle = omega * s + recorded.phase
    covariance = parameter_covariance(np.column_stack([np.sin(angle), np.cos(angle), np.ones_like(t)]), own)
    relative, u_lag = np.sqrt(np.diag(covariance)[:2]).tolist()
    cosine, sine = float(np.cos(lag)), float(np.sin(lag))
    u_storage = stiffness * float(np.hypot(relative * cosine, u_lag * sine))
    u_loss = stiffness * float(np.hypot(relative * sine, u_lag * cosine))
    return CommonFit(moved, pushed, lag, u_lag, stiffness * cosine, u_storage, stiffness * sine, u_loss)


def readings_of(time: ArrayLike, signal: ArrayLike) -> tuple[Floats, Floats]:
    """Return the finite readings of an oscillation, or say why there are none.

    ``time``, ``signal`` (n,): NaN in the signal is left out. Raises InputError: fewer than six readings, times that do
    not increase, infinite values, or a signal that does not vary.
    """
    t, y = np.array(time, float), np.array(signal, float)
    if t.ndim != 1 or t.shape != y.shape:
        raise InputError(f"time and signal must be one-dimensional and alike: {t.shape} and {y.shape}")
    checked_times(t)
    refuse_infinite(y, "the signal")
    finite = np.isfinite(y)
    t, y = t[finite], y[finite]
    if len(t) < 6:
        raise InputError(f"an oscillation needs 6 readings; found {len(t)}")
    if is_constant(y):
        raise InputError("the signal does not vary: no oscillation in it")
    return t, y


def strongest_line(s: Floats, y: Floats, *, taper: bool = True) -> float:
    """Return the frequency of the strongest spectral line, good to a fraction of 1/T.

    ``s``, ``y`` (n,): Times and finite readings. ``taper``: Weigh the ends down, which resolves close lines.
    """
    even = np.linspace(s[0], s[-1], len(s))
    values = np.interp(even, s, y)
    values = values - np.polynomial.polynomial.polyval(even, np.polynomial.polynomial.polyfit(even, values, 1))
    size = _GRID * len(s)
    window = np.hanning(len(s)) if taper else np.ones(len(s))
    power = np.abs(np.fft.rfft(values * window, size))
    frequency = np.fft.rfftfreq(size, float(even[1] - even[0]))
    possible = frequency * float(s[-1] - s[0]) >= 1.0
    return float(frequency[possible][np.argmax(power[possible])])


def _linear(s: Floats, y: Floats, frequency: float, n_waves: int, trend_order: int) -> tuple[Floats, Floats, Floats]:
    """Coefficients, residuals and columns at a given frequency.

    Columns are sin and cos of every wave, then powers of the time in units of half the record.
    """
    columns = np.empty((2 * n_waves + trend_order + 1, len(s)))
    fundamental = np.exp(2j * np.pi * frequency * s)
    wave = np.ones_like(fundamental)
    for k in range(n_waves):
        wave = wave * fundamental
        columns[k], columns[n_waves + k] = wave.imag, wave.real
    half = max(float(s[-1]), float(-s[0]))
    for power in range(trend_order + 1):
        columns[2 * n_waves + power] = (s / half) ** power
    # Waves over a cycle or more and low powers are well conditioned: normal equations suffice.
    coefficients = np.asarray(np.linalg.solve(columns @ columns.T, columns @ y))
    return coefficients, y - coefficients @ columns, columns.T


def _described(
    s: Floats,
    y: Floats,
    frequency: float,
    n_waves: int,
    trend_order: int,
    reference: float,
    *,
    fixed: bool = False,
    step: float = 0.0,
) -> Sinusoid:
    """Everything about the fit at its best frequency, or at a fixed one."""
    coefficients, left, design = _linear(s, y, frequency, n_waves, trend_order)
    sines, cosines = coefficients[:n_waves], coefficients[n_waves : 2 * n_waves]
    waves = np.arange(1, n_waves + 1)
    turned = (design[:, n_waves : 2 * n_waves] * sines - design[:, :n_waves] * cosines) * waves
    by_frequency = 2 * np.pi * s * turned.sum(axis=1)
    jacobian = design if fixed else np.column_stack([design, by_frequency])
    covariance = parameter_covariance(jacobian, left)
    if step > 0.0:
        scatter = float(left @ left) / max(len(left) - jacobian.shape[1], 1)
        beyond = max(1.0 - step**2 / 12 / scatter, 0.0) if scatter > 0.0 else 0.0
        covariance = beyond * covariance + _rounding_covariance(jacobian, y - left, step)
    amplitude = float(np.hypot(sines[0], cosines[0]))
    pair = np.ix_([0, n_waves], [0, n_waves])
    along = np.array([sines[0], cosines[0]]) / max(amplitude, np.finfo(float).tiny)
    across = np.array([-along[1], along[0]])
    half = max(float(s[-1]), float(-s[0]))
    trend = coefficients[2 * n_waves :] / half ** np.arange(trend_order + 1)
    return Sinusoid(
        frequency=frequency,
        u_frequency=0.0 if fixed else float(np.sqrt(max(covariance[-1, -1], 0.0))),
        amplitude=amplitude,
        u_amplitude=float(propagated_u(along, covariance[pair])),
        phase=float(np.arctan2(cosines[0], sines[0])),
        u_phase=float(propagated_u(across, covariance[pair])) / amplitude,
        reference_time=reference,
        harmonic_amplitudes=tuple(np.hypot(sines, cosines).tolist()),
        harmonic_phases=tuple(np.arctan2(cosines, sines).tolist()),
        trend=tuple(trend.tolist()),
    )


def _rounding_covariance(jacobian: Floats, curve: Floats, step: float) -> Floats:
    """Covariance of the parameters when the curve is rounded to steps, wherever these lie."""
    scale = np.linalg.norm(jacobian, axis=0)
    columns = jacobian / np.where(scale > 0, scale, 1.0)
    moved = np.empty((jacobian.shape[1], _OFFSETS))
    for k in range(_OFFSETS):
        shifted = curve + step * (k + 0.5) / _OFFSETS
        moved[:, k] = columns.T @ (step * np.round(shifted / step) - shifted)
    moved = np.linalg.solve(columns.T @ columns, moved) / scale[:, None]
    return np.asarray(moved @ moved.T) / _OFFSETS
