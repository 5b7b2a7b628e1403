"""First touch of a slow approach: the position at which the force begins to rise."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import least_squares

from labpipe.arrays import Floats
from labpipe.errors import InputError
from labpipe.signals._readings import is_constant, refuse_infinite

_FEWEST = 10  # readings on either side, below which a level or a slope has no meaning
_CLEAR = 5.0  # standard deviations by which the force must rise, by all readings behind the touch


class FirstTouch(NamedTuple):
    """Where an approach touches.

    ``position`` [m] of first touch and ``level``, the force of the free approach [N], with their
    standard uncertainties; ``stiffness`` [N/m] just after touch; ``noise`` [N] of a reading.
    """

    position: float
    u_position: float
    level: float
    u_level: float
    stiffness: float
    noise: float


def first_touch(position: ArrayLike, force: ArrayLike) -> FirstTouch:
    """Fit a broken line to force over position.

    Parameters
    ----------
    position : array (n,) [m]
        Of a slow approach, growing towards the sample.
    force : array (n,) [N]
        Compression positive, any offset.

    Returns
    -------
    FirstTouch

    Raises
    ------
    InputError
        Too few readings, or the force does not rise.

    Notes
    -----
    Behind the touch the force is taken as linear, which a line contact nearly is over the few
    micrometres of an approach; a sphere's force would begin more softly.

    Examples
    --------
    >>> z = np.linspace(0, 1e-4, 101)
    >>> touch = first_touch(z, np.maximum(0.0, z - 6.25e-5) * 1e5 + 0.3)
    >>> round(touch.position * 1e6, 3), round(touch.level, 6)
    (62.5, 0.3)
    """
    z, f = np.asarray(position, float), np.asarray(force, float)
    if z.ndim != 1 or z.shape != f.shape:
        raise InputError(f"position and force must be one-dimensional and alike: {z.shape} and {f.shape}")
    refuse_infinite(z, "position")
    refuse_infinite(f, "force")
    finite = np.isfinite(z) & np.isfinite(f)
    z, f = z[finite], f[finite]
    if z.size < 2 * _FEWEST:
        raise InputError(f"an approach needs at least {2 * _FEWEST} readings, found {z.size}")
    if is_constant(z):
        raise InputError("the position does not change: no approach")
    # Second differences: a force that rises evenly, by any step a reading, has none.
    noise = float(1.4826 * np.median(np.abs(np.diff(f, 2))) / np.sqrt(6))
    start, end = float(np.median(f[:_FEWEST])), float(f[-3:].mean())
    flat = (
        f"the force does not rise over the approach: {start:.4g} N at its beginning, "
        f"{end:.4g} N at its end; give the position of first touch in the settings"
    )
    if not end - start > 1e-12:
        raise InputError(flat)
    span = float(np.ptp(z))
    rising = np.flatnonzero(f > start + 0.5 * (end - start))
    guess = float(z[rising[0]]) - 0.05 * span

    scatter = max(noise, 1e-9 * (end - start))

    def residual(p: Floats) -> Floats:
        touch, slope, level = p
        bent = level + slope * np.maximum(0.0, z - touch * span)
        return np.asarray((f - bent) / scatter)

    slope = (end - start) / max(float(z[-1]) - guess, 1e-3 * span)
    trials = [
        least_squares(residual, [(guess - back * span) / span, slope, start], x_scale="jac")
        for back in (0.0, 0.02, 0.1)
    ]
    best = min(trials, key=lambda trial: float(trial.cost))
    chi_square = 2 * best.cost / max(z.size - 3, 1)
    level = np.sum(((f - f.mean()) / scatter) ** 2)
    if not (best.x[1] > 0.0 and level - 2.0 * best.cost > _CLEAR**2 * max(chi_square, 1.0)):
        raise InputError(flat)
    covariance = np.linalg.pinv(best.jac.T @ best.jac) * max(chi_square, 1.0)
    u_time, u_level = (float(np.sqrt(covariance[i, i])) for i in (0, 2))
    when, u_when = float(best.x[0] * span), u_time * span
    return FirstTouch(when, u_when, float(best.x[2]), u_level, float(best.x[1]), noise)
