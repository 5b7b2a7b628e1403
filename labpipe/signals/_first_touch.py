"""First touch of a slow approach: the position at which the force begins to rise."""

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import least_squares

from labpipe.errors import InputError
from labpipe.signals._readings import is_constant, readings_of

_FEWEST = 10  # readings on either side, below which a level or a slope has no meaning
_CLEAR = 5.0  # standard deviations by which the force must rise, by all readings behind the touch


def first_touch(position: ArrayLike, force: ArrayLike) -> float:
    """Fit a broken line to force over position.

    Parameters
    ----------
    position, force : array (n,) [m, N]
        Of a slow approach, growing towards the sample, compression positive at any offset; NaN is left out.

    Returns
    -------
    float
        Position of first touch [m].

    Raises
    ------
    InputError
        Too few readings, or the force does not rise.

    Notes
    -----
    Behind the touch the force is taken as linear, as that of a line contact nearly is over a few micrometres.
    """
    z, f = readings_of(position=position, force=force)
    if z.size < 2 * _FEWEST:
        raise InputError(f"an approach needs at least {2 * _FEWEST} readings, found {z.size}")
    if is_constant(z):
        raise InputError("the position does not change: no approach")
    start, end, span = float(np.median(f[:_FEWEST])), float(f[-3:].mean()), float(np.ptp(z))
    flat = InputError(
        f"the force does not rise over the approach: {start:.4g} N at its beginning, {end:.4g} N at its end; give the "
        "position of first touch in the settings"
    )
    if not end - start > 1e-12:
        raise flat
    guess = float(z[np.flatnonzero(f > start + 0.5 * (end - start))[0]]) / span - 0.05
    slope, rise = (end - start) / max(float(z[-1]) - guess * span, 1e-3 * span), end - start

    def residual(p: np.ndarray) -> np.ndarray:
        return np.asarray((f - p[2] - p[1] * np.maximum(0.0, z - p[0] * span)) / rise)

    trials = [least_squares(residual, [guess - back, slope, start], x_scale="jac") for back in (0.0, 0.02, 0.1)]
    best = min(trials, key=lambda trial: float(trial.cost))
    gain = float(np.sum(((f - f.mean()) / rise) ** 2)) - 2.0 * best.cost
    if not (best.x[1] > 0.0 and gain > _CLEAR**2 * 2.0 * best.cost / (z.size - 3)):
        raise flat
    return float(best.x[0] * span)
