"""The free ringing after an impact: a damped oscillation between two impacts.

A plate that is struck moves with the impact, rings freely, and is struck again by the next bounce. Only the free
stretch is one damped oscillation: it grows, block by block, as long as the oscillation fitted so far predicts the next
block to within the noise.
"""

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from labpipe.arrays import Floats
from labpipe.errors import IN_MOTION, InputError
from labpipe.signals._noise import difference_sigma
from labpipe.signals._oscillation import Oscillation, fit_sinusoid, strongest_line, varying
from labpipe.signals._readings import LEAST

_HALF = 8  # readings in the blocks by which an onset is found; twice as many in those by which a stretch grows


class Ringing(NamedTuple):
    """An impact and the free ringing after it.

    ``onset_time`` is when the motion is first seen, ``blow_time`` when an impact of no duration would have started the
    same ringing: before the free stretch the fitted oscillation leaves its rest position downwards. ``fit`` states
    amplitude and phase there. ``free_from`` and ``free_to`` bound the stretch; ``chi_square`` is the scatter about the
    fit over the noise, squared.
    """

    onset_time: float
    blow_time: float
    u_blow_time: float
    free_from: float
    free_to: float
    fit: Oscillation
    chi_square: float


def ringing(
    time: ArrayLike, signal: ArrayLike, *, longest_impact: float, shortest_pause: float, noise: float | None = None
) -> Ringing:
    """Find the first impact in a record and fit the free ringing that follows.

    Parameters
    ----------
    time, signal : array (n,) [s, m]
        Evenly sampled displacement upwards, against the impact; the beginning is at rest. NaN is left out.
    longest_impact, shortest_pause : float [s]
        No contact lasts longer, and no second impact comes sooner after the onset.
    noise : float, optional [m]
        Standard deviation of white noise; default estimated from the quiet beginning.

    Raises
    ------
    InputError
        Nothing moves, or the motion is not a free ringing.
    """
    t, y = varying(time, signal)
    if len(t) < 8 * _HALF:
        raise InputError(f"a ringing needs {8 * _HALF} readings; found {len(t)}")
    quiet = y[: max(int(0.05 * len(y)), 4 * _HALF)]
    white, spread = difference_sigma(quiet), float(np.std(quiet))
    least = white if noise is None else max(white, noise)
    if not (np.isfinite(least) and least > LEAST):
        raise InputError(
            "neighbouring readings of the beginning do not differ (constant, or displayed too "
            "coarsely): the noise must be given"
        )
    if spread > 3.0 * least:
        raise InputError(
            f"the record begins in motion: its first {t[len(quiet) - 1] - t[0]:.3g} s spread by {spread:.2g} m with a "
            f"noise of {least:.2g} m; it must begin at rest, before the impact"
        ).because(IN_MOTION)
    sigma = noise if noise is not None else max(white, spread)
    y = y - float(np.mean(quiet))
    # The first reading of the first two blocks in a row whose means move by six standard uncertainties.
    means = y[: y.size // _HALF * _HALF].reshape(-1, _HALF).mean(axis=1)
    has_moved = np.abs(means) > 6.0 * sigma / np.sqrt(_HALF)
    found = np.flatnonzero(has_moved[:-1] & has_moved[1:])
    if not len(found):
        raise InputError(
            f"nothing moves in this record of {t[-1] - t[0]:.3g} s: no reading leaves the rest "
            f"position by more than the noise of {sigma:.2g} m"
        )
    onset = float(t[int(found[0]) * _HALF])
    stretch = slice(*_grown(t, y, sigma, _seed(t, y, onset, longest_impact, shortest_pause)))
    free = fit_sinusoid(t[stretch], y[stretch], is_damped=True)
    # Nearest to the middle of the impact, the fit leaves rest in its direction.
    at = free.reference_time + (np.pi - free.phase) / (2 * np.pi * free.frequency)
    blow = float(at + np.round((onset + 0.25 * longest_impact - at) * free.frequency) / free.frequency)
    # The uncertainties hold the changes by other ends of the stretch.
    ends = (stretch, slice(stretch.start + _HALF, stretch.stop), slice(stretch.start, stretch.stop - 2 * _HALF))
    fit, *others = (fit_sinusoid(t[s], y[s], free.frequency, is_damped=True, reference_time=blow) for s in ends)
    if fit.amplitude < 3.0 * sigma:
        raise InputError(
            f"the ringing ({fit.amplitude:.2g} m) is not larger than the noise ({sigma:.2g} m): "
            "it cannot be evaluated; drop from higher, or bring the sensor nearer"
        )
    widened: dict[str, Any] = {}
    for name in ("frequency", "damping_ratio", "amplitude"):
        changes = [getattr(other, name) - getattr(fit, name) for other in others]
        widened[f"u_{name}"] = float(np.hypot(getattr(fit, f"u_{name}"), np.linalg.norm(changes)))
    u_blow, chi_square = fit.u_phase / (2 * np.pi * fit.frequency), (fit.residual_rms / sigma) ** 2
    bounds = float(t[stretch.start]), float(t[stretch.stop - 1])
    return Ringing(onset, blow, u_blow, *bounds, replace(fit, **widened), chi_square)


def blows(
    time: Floats, signal: Floats, frequency: float, damping_ratio: float, noise: float, longest_impact: float = 4e-3
) -> tuple[Floats, Floats, float]:
    """Find the blows by which an oscillator of one frequency and damping is struck: times, sizes, and their u.

    The oscillation is fitted to one period before and one after a contact, wherever that may be; its change there, as
    an amplitude, is the size, and a blow a maximum within half a period beyond noise. ``time``, ``signal`` (n,) [s, m]
    are evenly spaced; frequency [Hz] and ``longest_impact`` [s] as in :func:`ringing`.
    """
    interval, omega = float(np.median(np.diff(time))), 2 * np.pi * frequency
    size, gap = round(1.0 / frequency / interval), round(longest_impact / interval)
    rate = omega * damping_ratio / np.sqrt(1.0 - damping_ratio**2)
    u = noise * float(np.sqrt(4.0 / max(size, 1)))
    if size < _HALF or signal.size <= 2 * size + gap:
        return np.zeros(0), np.zeros(0), u
    windows = np.lib.stride_tricks.sliding_window_view(signal, size)

    def fitted(s: Floats) -> Floats:
        wave = np.exp((1j * omega - rate) * s)
        design = np.column_stack([wave.real, wave.imag, np.ones(s.size)])
        return np.asarray(windows @ np.linalg.pinv(design)[:2].T)

    after: Floats = np.asarray((np.arange(size) + 0.5 * gap) * interval, float)
    begun, before = fitted(after)[size + gap :], fitted(np.negative(after[::-1]))[: -size - gap]
    change: Floats = np.linalg.norm(np.subtract(begun, before), axis=1)
    near = np.lib.stride_tricks.sliding_window_view(np.pad(change, size // 2), size // 2 * 2 + 1).max(axis=1)
    found = np.flatnonzero((change == near) & (change > 5.0 * u))
    return time[found + size - 1 + gap // 2], change[found], u


def _seed(t: Floats, y: Floats, onset: float, longest_impact: float, shortest_pause: float) -> tuple[int, int]:
    """Stretch that is certainly free: after the longest impact, before the shortest pause."""
    low, high = (int(place) for place in np.searchsorted(t, onset + np.array([longest_impact, shortest_pause])))
    if high >= len(t):
        raise InputError(
            f"the record ends {t[-1] - onset:.3g} s after the impact; it must last for the "
            f"shortest pause, {shortest_pause:.3g} s"
        )
    if high - low < _HALF:
        raise InputError(
            f"{high - low} readings lie between the longest impact and the shortest pause after "
            f"{onset:.6g} s; at least {_HALF} are needed"
        )
    frequency = strongest_line(t[low:high] - t[low], y[low:high], taper=False)
    cycles = frequency * (t[high - 1] - t[low])
    if cycles < 1.75:
        raise InputError(
            f"between the longest impact and the shortest pause lie {cycles:.2g} cycles of {frequency:.4g} "
            "Hz; at least 1.75 are needed: lengthen shortest_pause if the bounces allow it"
        )
    return low, high


def _grown(t: Floats, y: Floats, sigma: float, seed: tuple[int, int]) -> tuple[int, int]:
    """Extend the seed on both sides while the fit predicts the next block; give a block back.

    The impact fades out like the force of a contact, below the noise before it ends.
    """
    low, high = seed
    fit, fitted = fit_sinusoid(t[low:high], y[low:high], is_damped=True), high - low

    def is_predicted(block: slice) -> bool:
        """Fit again only when the stretch has grown by half; a mean square may exceed the noise by 4 deviations."""
        nonlocal fit, fitted
        if high - low > 1.5 * fitted:
            fit, fitted = fit_sinusoid(t[low:high], y[low:high], is_damped=True), high - low
        left = y[block] - fit.at(t[block])
        return float(np.mean(left**2)) < (1.0 + 4.0 * np.sqrt(2.0 / left.size)) * max(sigma, fit.residual_rms) ** 2

    while high + 2 * _HALF <= len(t) and is_predicted(slice(high, high + 2 * _HALF)):
        high += 2 * _HALF
    if high + 2 * _HALF <= len(t):
        high = max(seed[1], high - 2 * _HALF)
    while low >= _HALF and is_predicted(slice(low - _HALF, low)):
        low -= _HALF
    return (min(seed[0], low + 2 * _HALF) if low >= _HALF else low), high
