"""How well two curves agree: normalised error, bias, limits of agreement."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import stdtrit

from labpipe.arrays import Floats
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
    a, b = _pairs(measured, model)
    if is_constant(b):
        raise InputError("the model does not vary, so an error relative to its range is undefined")
    return round(float(np.sqrt(np.mean((a - b) ** 2)) / np.ptp(b)), 15)


def _pairs(measured: ArrayLike, model: ArrayLike) -> list[Floats]:
    pairs = readings_of(**{"the first curve": measured, "the second curve": model})
    if pairs[0].size < 2:
        raise InputError("at least two finite pairs are needed to compare two curves")
    return pairs


class Agreement(NamedTuple):
    """Agreement of two methods of measurement (Bland and Altman).

    ``bias`` is the mean of first minus second, ``sd`` the standard deviation of the differences, ``low`` and ``high``
    the 95 % limits of agreement; each ``u_`` is a standard uncertainty. ``concordance`` is Lin's coefficient.
    """

    bias: float
    u_bias: float
    sd: float
    low: float
    high: float
    u_limit: float
    concordance: float


def agreement(first: ArrayLike, second: ArrayLike) -> Agreement:
    """Return bias and limits of agreement of two methods on the same quantity.

    Parameters
    ----------
    first, second : array (n,)
        Paired values; pairs with a NaN are left out. As errors of neighbouring samples are correlated, the
        autocorrelation of the differences gives the number of independent pairs.

    Raises
    ------
    InputError
        Shapes differ or fewer than three pairs are finite.

    References
    ----------
    Bland & Altman, Lancet 327 (1986) 307, doi:10.1016/S0140-6736(86)90837-8;
    Lin, Biometrics 45 (1989) 255, doi:10.2307/2532051.
    """
    a, b = _pairs(first, second)
    if a.size < 3:
        raise InputError(f"limits of agreement need at least three pairs, found {a.size}")
    d = a - b
    n = independent_count(d)
    sd = float(d.std(ddof=1))
    # 1.96 for many pairs; wider where few are independent
    factor = float(stdtrit(max(n - 1, 1), 0.975) * np.sqrt(1 + 1 / n))
    spread = a.var() + b.var() + (a.mean() - b.mean()) ** 2
    concordance = 1.0 if spread == 0 else float(2 * np.cov(a, b, ddof=0)[0, 1] / spread)
    bias, away = float(d.mean()), factor * sd
    return Agreement(bias, sd / np.sqrt(n), sd, bias - away, bias + away, sd * np.sqrt(3 / n), concordance)


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
