"""Decaying vibrations: frequency, damping ratio, amplitude, with uncertainties."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import least_squares

from labpipe.errors import InputError
from labpipe.signals.oscillation import readings_of, strongest_line
from labpipe.signals.residuals import parameter_covariance

Array = NDArray[np.float64]

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
    n_samples: int


def damped_oscillation(
    time: ArrayLike, signal: ArrayLike, frequency_guess: float | None = None
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
    s, span = t - t[0], float(t[-1] - t[0])
    # A vibration that dies out early is all at the beginning, where a taper would hide it.
    guess = strongest_line(s, y, taper=False) if frequency_guess is None else float(frequency_guess)
    if guess * span < _FEWEST_CYCLES or len(t) < _FEWEST_READINGS:
        message = (
            f"a vibration of {guess:.6g} Hz needs {_FEWEST_CYCLES} cycles and {_FEWEST_READINGS} "
            f"readings; found {guess * span:.3g} cycles in {len(t)} readings"
        )
        raise InputError(message)

    def columns(frequency: float, rate: float) -> Array:
        angle, decay = 2 * np.pi * frequency * s, np.exp(-rate * s)
        return np.stack(
            [decay * np.sin(angle), decay * np.cos(angle), np.ones_like(s), s / span], 1
        )

    def residual(p: Array) -> Array:
        design = columns(guess * p[0], p[1] / span)
        # In units of the signal, or the optimiser's absolute tolerances would end it at once.
        return (y - design @ np.linalg.lstsq(design, y, rcond=None)[0]) / scatter

    scatter = float(np.std(y))
    trials = [
        least_squares(
            residual, [1.0, rate], bounds=([0.3, -1.0], [3.0, 200.0]), x_scale=[0.01, 1.0]
        )
        for rate in (0.1, 3.0, 30.0)
    ]
    best = min(trials, key=lambda trial: float(trial.cost))
    frequency, rate = guess * float(best.x[0]), float(best.x[1]) / span
    design = columns(frequency, rate)
    sine, cosine, offset, _ = np.linalg.lstsq(design, y, rcond=None)[0]
    left = y - design @ np.linalg.lstsq(design, y, rcond=None)[0]
    wave = sine * design[:, 0] + cosine * design[:, 1]
    turned = sine * design[:, 1] - cosine * design[:, 0]
    jacobian = np.column_stack([design, 2 * np.pi * s * turned, -s * wave])
    covariance = parameter_covariance(jacobian, left)
    omega, amplitude = 2 * np.pi * frequency, float(np.hypot(sine, cosine))
    natural = float(np.hypot(omega, rate))
    to_zeta = np.zeros(6)
    to_zeta[4], to_zeta[5] = -2 * np.pi * rate * omega / natural**3, omega**2 / natural**3
    to_amplitude = np.array([sine, cosine, 0, 0, 0, 0]) / amplitude
    to_phase = np.array([-cosine, sine, 0, 0, 0, 0]) / amplitude**2
    u_zeta, u_amplitude, u_phase = (
        float(np.sqrt(g @ covariance @ g)) for g in (to_zeta, to_amplitude, to_phase)
    )
    return Damped(
        frequency,
        float(np.sqrt(covariance[4, 4])),
        natural / (2 * np.pi),
        rate / natural,
        u_zeta,
        amplitude,
        u_amplitude,
        float(np.arctan2(cosine, sine)),
        u_phase,
        float(offset),
        float(t[0]),
        float(np.sqrt(np.mean(left**2))),
        len(t),
    )
