r"""Influence of one loaded strip on a periodic elastic surface: half-plane or bonded layer.

The surface has period λ and is cut into N strips, each under a uniform pressure (thesis eqs.
2.9-2.12). All kernels are for a reduced modulus E* = E/(1 − ν²) of 1; time enters elsewhere, as a
factor (the material is separable). In Fourier space, with z = qh,

.. math::
    G(q) = \frac{2}{|q|} S(z), \qquad
    S = \frac{(3-4\nu)\sinh 2z - 2z}{(3-4\nu)\cosh 2z + 2z^2 + 5 - 12\nu + 8\nu^2},

S = 1 for the half-plane. The sum over all wave numbers is taken exactly: the half-plane part is a
difference of Clausen functions, and the contribution of a layer decays exponentially.

The mean displacement of a periodically loaded half-plane is infinite. There G(0) is 0, so that
displacements are relative to the *mean surface*; a layer has a finite G(0) and its displacements
are absolute.
"""

from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
from scipy.special import zeta

from labpipe.arrays import Floats
from labpipe.errors import InputError

_MIN_ELEMENTS = 8
# exp(-2z) is below the rounding of the half-plane part from here on.
_DEEP = 25.0
# A thinner layer (relative to its period) would need more Fourier terms than is sensible.
_MAX_MODES = 20_000_000
# sinh(2z) - 2z loses digits below this z; its series does not.
_SHALLOW = 0.5
_CLAUSEN_TERMS = 24


@dataclass(frozen=True)
class LineKernel:
    """Displacements of a periodic surface under strips of unit pressure, for E* = 1.

    ``period`` [m]: Period λ. ``influence`` (element,) [m]: Displacement at the centre of strip m under unit pressure
    on strip 0. ``mean_compliance`` [m]: G(0): 0 for the half-plane, whose displacements are relative to the mean
    surface.
    """

    period: float
    influence: Floats
    mean_compliance: float

    @cached_property
    def symbol(self) -> Floats:
        """Real Fourier transform (wave number,) of the influence in m."""
        symbol: Floats = np.fft.rfft(self.influence).real
        if self.mean_compliance == 0.0:
            # Exactly zero, not the rounding error of a sum: constants are the null space.
            symbol[0] = 0.0
        return symbol

    @property
    def elements(self) -> int:
        """Number of strips per period."""
        return int(self.influence.size)

    @property
    def spacing(self) -> float:
        """Width of a strip in m."""
        return self.period / self.elements

    @property
    def datum(self) -> str:
        """Level from which displacements count."""
        return "mean surface" if self.mean_compliance == 0.0 else "rigid base (absolute)"

    def displacement(self, pressure: Floats) -> Floats:
        """Displacement (..., element) under the pressures (..., element), by one FFT product."""
        spectrum = np.fft.rfft(pressure, axis=-1)
        return np.fft.irfft(spectrum * self.symbol, n=self.elements, axis=-1)


def line_kernel(period: float, elements: int, thickness: float = np.inf, nu: float = 0.5) -> LineKernel:
    """Influence coefficients of a periodic half-plane, or of a layer bonded to a rigid base.

    ``period`` [m]: Period λ. ``elements``: Strips per period; even. ``thickness`` [m]: Thickness h of the layer;
    infinite for the half-plane. ``nu``: Poisson's ratio; matters for a layer only. Raises InputError: A length is not
    positive, ``elements`` is odd or too small, Poisson's ratio is outside 0 to 0.5, or the layer is so thin that the
    sum over its wave numbers is out of reach.

    References
    ----------
    Thesis eqs. (2.9)-(2.12); Carbone and Mangialardi, J. Mech. Phys. Solids 56 (2008) 684,
    https://doi.org/10.1016/j.jmps.2007.05.021.

    Examples
    --------
    >>> line_kernel(8e-3, 64).datum
    'mean surface'
    >>> line_kernel(8e-3, 64, thickness=1e-3, nu=0.35).datum
    'rigid base (absolute)'
    """
    if not (np.isfinite(period) and period > 0.0):
        raise InputError(f"the period is {period} m, expected a positive length")
    if elements != int(elements) or elements < _MIN_ELEMENTS or elements % 2:
        raise InputError(f"{elements} elements per period, expected an even number from {_MIN_ELEMENTS} up")
    if not thickness > 0.0:
        raise InputError(f"the layer is {thickness} m thick, expected a positive length or infinity")
    if not 0.0 <= nu <= 0.5:
        raise InputError(f"Poisson's ratio is {nu}, expected 0 to 0.5")
    influence = _half_plane(period, elements)
    mean = 0.0
    if np.isfinite(thickness):
        mean = thickness * (1.0 - 2.0 * nu) / (1.0 - nu) ** 2
        influence = influence + _layer_excess(period, elements, thickness, nu)
        influence = influence + mean / elements
    return LineKernel(float(period), influence, float(mean))


def _layer_deviation(z: Floats, nu: float) -> Floats:
    """S(z) − 1, without cancellation at either end."""
    c = 5.0 - 12.0 * nu + 8.0 * nu**2
    k = 3.0 - 4.0 * nu
    deep = np.exp(-2.0 * np.minimum(z, 350.0))
    below = k * (1.0 + deep**2) + 2.0 * deep * (2.0 * z**2 + c)
    above = -2.0 * k * deep**2 - 2.0 * deep * (2.0 * z + 2.0 * z**2 + c)
    deviation = above / below
    shallow = z < _SHALLOW
    if np.any(shallow):
        x = 2.0 * np.where(shallow, z, 0.0)
        # sinh x - x = x^3/6 (1 + x^2/(4*5) (1 + x^2/(6*7) (1 + x^2/(8*9) ...)))
        rest = np.ones_like(x)
        for divisor in (272.0, 210.0, 156.0, 110.0, 72.0, 42.0, 20.0):
            rest = 1.0 + x**2 / divisor * rest
        factor = (k * x**3 / 6.0 * rest + (2.0 - 4.0 * nu) * x) / (k * np.cosh(x) + x**2 / 2.0 + c)
        deviation = np.where(shallow, factor - 1.0, deviation)
    return np.asarray(deviation)


def clausen(angle: Floats) -> Floats:
    """Clausen's function Cl2(θ) = −∫ ln|2 sin(t/2)| dt from 0 to θ.

    Examples
    --------
    >>> float(np.round(clausen(np.array(np.pi / 2)), 12))  # Catalan's constant
    0.915965594177
    """
    # Odd and periodic: fold onto |θ| <= π, where the series gains a factor 4 a term.
    theta = np.remainder(np.asarray(angle, dtype=float) + np.pi, 2.0 * np.pi) - np.pi
    square = (theta / (2.0 * np.pi)) ** 2
    series = np.zeros_like(theta)
    for coefficient in _clausen_series():
        series += coefficient
        series *= square
    logarithm = np.log(np.maximum(np.abs(theta), np.finfo(float).tiny))
    return np.asarray(theta * (1.0 - logarithm + series))


@cache
def _clausen_series() -> tuple[float, ...]:
    """Coefficients of the even powers of θ/2π, the highest first."""
    return tuple(float(zeta(2 * n)) / (n * (2 * n + 1)) for n in range(_CLAUSEN_TERMS, 0, -1))


def _half_plane(period: float, elements: int) -> Floats:
    """−(2/π) ∫ ln|2 sin(πx/λ)| over one strip, seen from the centre of every strip."""
    half = elements // 2
    edges = 2.0 * np.pi * (np.arange(half + 1) + 0.5) / elements
    antiderivative = clausen(edges)
    # Odd about 0; even about half a period, where the last two edges mirror each other.
    values = np.append(2.0 * antiderivative[0], np.diff(antiderivative))
    return period / np.pi**2 * np.concatenate([values, values[half - 1 : 0 : -1]])


def _layer_excess(period: float, elements: int, thickness: float, nu: float) -> Floats:
    """Return the contribution of a layer to the half-plane's influence, its mean (q = 0) left out."""
    q0 = 2.0 * np.pi / period
    n_modes = int(np.ceil(_DEEP / (q0 * thickness))) + 1
    if n_modes > _MAX_MODES:
        raise InputError(
            f"a layer of {thickness:.3g} m under a period of {period:.3g} m needs {n_modes} wave "
            f"numbers, at most {_MAX_MODES} are summed; give a thicker layer or a shorter period"
        )
    k = np.arange(1, n_modes + 1, dtype=float)
    q = k * q0
    strip = 2.0 * np.sin(0.5 * q * period / elements) / q
    # Both signs of q add up to a cosine, hence the factor 2.
    amplitude = 2.0 / period * (2.0 / q) * _layer_deviation(q * thickness, nu) * strip
    folded = np.bincount(np.arange(1, n_modes + 1) % elements, weights=amplitude, minlength=elements)
    return np.asarray(np.fft.fft(folded).real)
