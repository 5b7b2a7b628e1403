"""Reduction of a Prony series to the fewest terms within a tolerance, for simulation codes."""

import numpy as np
from scipy.optimize import nnls

from labpipe.errors import InputError
from labpipe.materials.prony import Prony
from labpipe.materials.spectrum._spectrum import moduli_of_terms

_POINTS_PER_DECADE = 10
_NNLS_STEPS_PER_COLUMN = 50


def fewest_terms(material: Prony, lowest: float, highest: float, tolerance: float = 0.01) -> tuple[Prony, float]:
    """Return a series with the fewest equally spaced terms that keeps both moduli.

    Times are spaced evenly in their logarithm over the window and their weights solve a
    non-negative least-squares problem of relative errors; the number of terms rises until the
    error of either modulus is below the tolerance, or the given series is reached.

    ``lowest``, ``highest`` [Hz]: the window that matters; ``tolerance``: largest root-mean-square relative error of
    storage or loss modulus over it. Returned beside the series is the larger of the two errors; the given material
    and zero when no shorter series serves. A window or tolerance that is not positive raises InputError.

    Examples
    --------
    >>> times = np.logspace(-4, 2, 60)
    >>> few, error = fewest_terms(Prony(1e7, np.full(60, 1e6), times), 0.01, 100.0)
    >>> few.E.size < 12, error < 0.01
    (True, True)
    """
    if not (0 < lowest < highest < np.inf and tolerance > 0):
        raise InputError(
            f"window {lowest:g} to {highest:g} Hz, tolerance {tolerance:g}: expected a positive "
            "window, lowest first, and a positive tolerance"
        )
    count = max(int(np.log10(highest / lowest) * _POINTS_PER_DECADE), 2)
    omega = 2.0 * np.pi * np.geomspace(lowest, highest, count)
    exact = material.complex_modulus(omega)
    if not np.all(exact.imag > 0):
        return material, 0.0
    for terms in range(1, material.E.size):
        middle = np.array([1.0 / np.sqrt(omega[0] * omega[-1])])
        rho = np.geomspace(1.0 / omega[-1], 1.0 / omega[0], terms) if terms > 1 else middle
        rows = moduli_of_terms(np.log(omega), np.log(rho)) / np.concatenate([exact.real, exact.imag])[:, None]
        scale = 1.0 / np.linalg.norm(rows, axis=0)
        weight = scale * nnls(rows * scale, np.ones(len(rows)), maxiter=_NNLS_STEPS_PER_COLUMN * rows.shape[1])[0]
        error = max(float(np.sqrt(np.mean(part**2))) for part in np.split(rows @ weight - 1.0, 2))
        if error <= tolerance:
            kept = weight[:-1] > 0
            return Prony(weight[-1], weight[:-1][kept], rho[kept], material.nu), error
    return material, 0.0
