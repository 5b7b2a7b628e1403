"""How well two curves agree, and how many of their samples are independent."""

import numpy as np
from numpy.typing import ArrayLike

from labpipe.errors import InputError
from labpipe.signals._readings import is_constant, readings_of


def nrmse(measured: ArrayLike, model: ArrayLike) -> float:
    """Root-mean-square difference over the range of the model: a wrong scale would hide in the measurement's own.

    Parameters
    ----------
    measured, model : array (n,)
        Of one quantity at the same places; pairs with a NaN are left out.

    Raises
    ------
    InputError
        Shapes differ, fewer than two pairs are finite, or the model does not vary.
    """
    a, b = readings_of(**{"the first curve": measured, "the second curve": model})
    if a.size < 2:
        raise InputError("at least two finite pairs are needed to compare two curves")
    if is_constant(b):
        raise InputError("the model does not vary, so an error relative to its range is undefined")
    return round(float(np.sqrt(np.mean((a - b) ** 2)) / np.ptp(b)), 15)


def independent_count(values: ArrayLike) -> float:
    """Effective number of independent samples of a stationary series.

    The autocorrelation is summed up to its first negative value.
    """
    x = np.asarray(values, float)
    if not np.isfinite(x).all():
        raise InputError("independent samples are counted among finite values; leave out the others")
    x = x - x.mean()
    power = float(x @ x)
    if x.size < 4 or power == 0:
        return float(x.size)
    correlation = np.fft.irfft(np.abs(np.fft.rfft(x, 2 * x.size)) ** 2)[: x.size] / power
    last = 1 + int(np.argmax(np.append(correlation[1:], 0.0) <= 0))
    return float(max(1.0, x.size / (1 + 2 * correlation[1:last].sum())))
