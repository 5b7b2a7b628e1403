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
        raise InputError(f"position and force must be one-dimensional, of one shape: {z.shape} and {f.shape}")
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
    start, end, span = float(np.median(f[:_FEWEST])), float(f[-3:].mean()), float(np.ptp(z))
    flat = InputError(
        f"the force does not rise over the approach: {start:.4g} N at its beginning, "
        f"{end:.4g} N at its end; give the position of first touch in the settings"
    )
    if not end - start > 1e-12:
        raise flat
    guess = float(z[np.flatnonzero(f > start + 0.5 * (end - start))[0]]) / span - 0.05
    slope = (end - start) / max(float(z[-1]) - guess * span, 1e-3 * span)
    scatter = max(noise, 1e-9 * (end - start))

    def residual(p: Floats) -> Floats:
        return np.asarray((f - p[2] - p[1] * np.maximum(0.0, z - p[0] * span)) / scatter)

    trials = [least_squares(residual, [guess - back, slope, start], x_scale="jac") for back in (0.0, 0.02, 0.1)]
    best = min(trials, key=lambda trial: float(trial.cost))
    chi_square = max(2 * best.cost / max(z.size - 3, 1), 1.0)
    gain = np.sum(((f - f.mean()) / scatter) ** 2) - 2.0 * best.cost
    if not (best.x[1] > 0.0 and gain > _CLEAR**2 * chi_square):
        raise flat
    (touch, stiffness, level), u = best.x, np.sqrt(np.diag(np.linalg.pinv(best.jac.T @ best.jac)) * chi_square)
    return FirstTouch(float(touch * span), float(u[0] * span), float(level), float(u[2]), float(stiffness), noise)
