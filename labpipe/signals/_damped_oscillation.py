"""Decaying vibrations: frequency, damping ratio, amplitude, with uncertainties."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import least_squares

from labpipe.arrays import Floats
from labpipe.errors import InputError
from labpipe.signals._oscillation import readings_of, strongest_line
from labpipe.signals._residuals import parameter_covariance
from labpipe.uncertainty import propagated_u

_TRIAL_RATES = (0.1, 0.5, 1.5, 4.0, 10.0, 30.0)  # decay over the record, to begin the fit with
_FEWEST_CYCLES, _FEWEST_READINGS = 1.5, 14


@dataclass(frozen=True, slots=True)
class Damped:
    """``offset + drift s + amplitude exp(-2 pi zeta f0 s) sin(2 pi fd s + phase)``.

    ``s`` counts from ``start_time``; ``frequency`` is the damped fd = f0 sqrt(1 - zeta^2) in Hz,
    ``damping_ratio`` is zeta, ``amplitude`` the envelope at ``start_time``.
    """

    frequency: float
    u_frequency: float
    natural_frequency: float
    damping_ratio: float
    u_damping_ratio: float
    amplitude: float
    u_amplitude: float
    phase: float
    u_phase: float
    offset: float
    start_time: float
    residual_rms: float
    drift: float = 0.0

    def at(self, time: ArrayLike) -> Floats:
        """Return the fitted motion at times [s]."""
        s = np.asarray(time, float) - self.start_time
        rate = 2 * np.pi * self.natural_frequency * self.damping_ratio
        wave = np.exp(-rate * s) * np.sin(2 * np.pi * self.frequency * s + self.phase)
        return np.asarray(self.offset + self.drift * s + self.amplitude * wave)


def damped_oscillation(
    time: ArrayLike, signal: ArrayLike, frequency_guess: float | None = None, reference_time: float | None = None
) -> Damped:
    """Fit one decaying vibration about a slowly drifting rest position.

    Parameters
    ----------
    time : array (n,) [s]
        From the moment from which the vibration is free.
    signal : array (n,)
        NaN is left out.
    frequency_guess : float, optional [Hz]
        Default the strongest line of the spectrum.
    reference_time : float, optional [s]
        Where amplitude and phase are stated, with the uncertainty that they have there; default
        the first reading.

    Returns
    -------
    Damped

    Raises
    ------
    InputError
        Too few readings or cycles, or no vibration.

    Examples
    --------
    >>> time = np.arange(0.0, 0.1, 5e-5)
    >>> ring = 1e-5 * np.exp(-0.02 * 2 * np.pi * 300 * time) * np.cos(2 * np.pi * 299.94 * time)
    >>> fit = damped_oscillation(time, ring)
    >>> round(fit.frequency, 2), round(fit.damping_ratio, 4)
    (299.94, 0.02)
    """
    t, y = readings_of(time, signal)
    start = float(t[0]) if reference_time is None else float(reference_time)
    s, span = t - start, float(t[-1] - t[0])
    # A vibration that dies out early is all at the beginning, where a taper would hide it.
    guess = strongest_line(s, y, taper=False) if frequency_guess is None else float(frequency_guess)
    if guess * span < _FEWEST_CYCLES or len(t) < _FEWEST_READINGS:
        raise InputError(
            f"a vibration of {guess:.6g} Hz needs {_FEWEST_CYCLES} cycles and {_FEWEST_READINGS} "
            f"readings; found {guess * span:.3g} cycles in {len(t)} readings"
        )

    def columns(frequency: float, rate: float) -> Floats:
        angle, decay = 2 * np.pi * frequency * s, np.exp(-rate * s)
        return np.stack([decay * np.sin(angle), decay * np.cos(angle), np.ones_like(s), s / span], 1)

    def residual(p: Floats) -> Floats:
        design = columns(guess * p[0], p[1] / span)
        # In units of the signal, or the optimiser's absolute tolerances would end it at once.
        return (y - design @ np.linalg.lstsq(design, y, rcond=None)[0]) / scatter

    scatter = float(np.std(y))
    begin = min(_TRIAL_RATES, key=lambda rate: float(np.sum(residual(np.array([1.0, rate])) ** 2)))
    best = least_squares(residual, [1.0, begin], bounds=([0.3, -1.0], [3.0, 200.0]), x_scale=[0.01, 1.0])
    frequency, rate = guess * float(best.x[0]), float(best.x[1]) / span
    design = columns(frequency, rate)
    weights = np.linalg.lstsq(design, y, rcond=None)[0]
    sine, cosine, offset, drift = weights
    left = y - design @ weights
    wave = sine * design[:, 0] + cosine * design[:, 1]
    turned = sine * design[:, 1] - cosine * design[:, 0]
    jacobian = np.column_stack([design, 2 * np.pi * s * turned, -s * wave])
    covariances = (parameter_covariance(jacobian, left), _white(jacobian, left))

    def u_of(gradient: Floats) -> float:
        # The spectrum of a short residual is known to a fifth at best; the larger one is stated.
        return float(max(propagated_u(gradient, c) for c in covariances))

    omega, amplitude = 2 * np.pi * frequency, float(np.hypot(sine, cosine))
    natural = float(np.hypot(omega, rate))
    to_zeta = np.zeros(6)
    to_zeta[4], to_zeta[5] = -2 * np.pi * rate * omega / natural**3, omega**2 / natural**3
    to_amplitude = np.array([sine, cosine, 0, 0, 0, 0]) / amplitude
    to_phase = np.array([-cosine, sine, 0, 0, 0, 0]) / amplitude**2
    to_frequency = np.eye(6)[4]
    return Damped(
        frequency,
        u_of(to_frequency),
        natural / (2 * np.pi),
        rate / natural,
        u_of(to_zeta),
        amplitude,
        u_of(to_amplitude),
        float(np.arctan2(cosine, sine)),
        u_of(to_phase),
        float(offset),
        start,
        float(np.sqrt(np.mean(left**2))),
        float(drift) / span,
    )


def _white(jacobian: Floats, residual: Floats) -> Floats:
    """Covariance under white residuals of the same variance."""
    n, p = jacobian.shape
    scale = np.linalg.norm(jacobian, axis=0)
    inverse = np.linalg.pinv((jacobian / scale).T @ (jacobian / scale), hermitian=True)
    return np.asarray(inverse / np.outer(scale, scale) * float(residual @ residual) / max(n - p, 1))
