r"""A modulus that depends on the amplitude of strain: Kraus's model of the Payne effect.

Filled rubber softens when it is sheared to and fro by more than about a thousandth: links between
the particles of the filler break and form again. Kraus [1]_ takes their breaking proportional to
γ^m and their forming to γ^{−m}, so that in a steady oscillation of the amplitude γ a share
1/(1 + x²) of them is whole, x = (γ/γ_c)^m:

.. math::
    G' = G'_\infty + \frac{G'_0 - G'_\infty}{1 + x^2}, \qquad
    G'' = G''_\infty + \frac{2 (G''_m - G''_\infty)\, x}{1 + x^2} +
          \frac{G''_0 - G''_\infty}{1 + x^2},

the last term after Ulmer [2]_, who lets the loss differ between very small and very large
strains. Here all are relative to the linear material, so that its limit γ → 0 is exact.

Validity: steady sinusoidal strain, one amplitude, isothermal; γ_c and m are taken as independent of
frequency (they nearly are) and must be measured. An unfilled polymer needs none of it below a
strain of a hundredth.

References
----------
.. [1] G. Kraus, J. Appl. Polym. Sci., Appl. Polym. Symp. 39 (1984) 75.
.. [2] J. D. Ulmer, Rubber Chem. Technol. 69 (1996) 15, https://doi.org/10.5254/1.3538359.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from labpipe.arrays import Complexes, Floats
from labpipe.errors import InputError
from labpipe.units import require_positive


@dataclass(frozen=True, slots=True)
class Kraus:
    """Kraus's dependence on the amplitude of shear strain, relative to the linear material.

    Attributes
    ----------
    critical_strain : float
        γ_c, the amplitude at which half the drop has happened.
    storage_floor : float
        G'_∞/G'_0 in (0, 1], the share of the storage modulus left at large amplitudes; 1 is linear.
    loss_peak : float
        G''_m/G''_0, not negative: loss at γ_c were it alone; above 1 where links break most.
    loss_floor : float
        G''_∞/G''_0, not negative.
    exponent : float
        m; 0.5 to 0.7 for carbon black.

    Examples
    --------
    >>> rubber = Kraus(0.01, storage_floor=0.4, loss_peak=1.5, loss_floor=0.5)
    >>> float(rubber.storage_share(0.01).round(12)), float(rubber.storage_share(0.0))
    (0.7, 1.0)
    """

    critical_strain: float
    storage_floor: float
    loss_peak: float = 1.0
    loss_floor: float = 1.0
    exponent: float = 0.6

    def __post_init__(self) -> None:
        require_positive(critical_strain=self.critical_strain, exponent=self.exponent, storage_floor=self.storage_floor)
        for name in ("loss_peak", "loss_floor"):
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) >= 0.0):
                raise InputError(f"{name} is {getattr(self, name)}, expected a number from 0 up")
        if self.storage_floor > 1.0:
            raise InputError(f"storage_floor is {self.storage_floor}; a Payne effect softens: at most 1")

    def whole_links(self, strain: ArrayLike) -> Floats:
        """Share 1/(1 + x²) of the links that are whole at amplitudes of shear strain (n,)."""
        return np.asarray(1.0 / (1.0 + self._ratio(strain) ** 2))

    def storage_share(self, strain: ArrayLike) -> Floats:
        """G'(γ)/G'_0 at amplitudes of shear strain (n,)."""
        return self.storage_floor + (1.0 - self.storage_floor) * self.whole_links(strain)

    def loss_share(self, strain: ArrayLike) -> Floats:
        """G''(γ)/G''_0 at amplitudes of shear strain (n,)."""
        whole = self.whole_links(strain)
        breaking = 2.0 * (self.loss_peak - self.loss_floor) * self._ratio(strain) * whole
        return np.asarray(self.loss_floor + breaking + (1.0 - self.loss_floor) * whole)

    def modulus(self, linear: ArrayLike, strain: ArrayLike) -> Complexes:
        """Complex modulus at an amplitude, from the linear one (same frequency, same unit)."""
        small = np.asarray(linear, dtype=complex)
        return np.asarray(small.real * self.storage_share(strain) + 1j * small.imag * self.loss_share(strain))

    def _ratio(self, strain: ArrayLike) -> Floats:
        amplitude = np.asarray(strain, dtype=float)
        if not np.all((amplitude >= 0.0) & np.isfinite(amplitude)):
            raise InputError(f"strain amplitude is {amplitude}, expected finite numbers from 0 up")
        return np.asarray((amplitude / self.critical_strain) ** self.exponent)
