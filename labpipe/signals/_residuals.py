"""Uncertainty of a least-squares fit whose residuals are not white.

A stage, a load cell and a laser leave residuals with memory. The covariance of the parameters then
depends on how strong the residuals are at the frequencies to which each parameter listens: the
residuals' spectrum, smoothed, is weighed with the spectrum of the parameter's own influence.
"""

import numpy as np
from scipy.ndimage import uniform_filter1d

from labpipe.arrays import Floats

_HALF_WIDTH = 6  # bins on either side over which the residuals' spectrum is averaged


def parameter_covariance(jacobian: Floats, residual: Floats) -> Floats:
    """Covariance of least-squares parameters under stationary, correlated residuals.

    ``jacobian`` (n, p) is the derivative of the model by its parameters, at (nearly) even times, ``residual`` (n,) what
    the fit leaves.

    Notes
    -----
    Sandwich ``(J'J)^-1 J'CJ (J'J)^-1`` with C the circulant covariance of the smoothed residual
    spectrum. The fit has taken power out of the bins that it listens to; the spectrum is enlarged
    by what it has taken. For white residuals this is the usual ``s^2 (J'J)^-1``.

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
