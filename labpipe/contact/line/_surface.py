r"""A periodic elastic surface in strips: influence coefficients, shapes of the tips, and its bed of springs.

The surface has period λ and is cut into N strips, each under a uniform pressure (thesis eqs.
2.9-2.12), for a reduced modulus E* = E/(1 − ν²) of 1; time enters elsewhere, as a factor. In Fourier
space, with z = qh for a layer of thickness h,

.. math::
    G(q) = \frac{2}{|q|} S(z), \qquad
    S = \frac{(3-4\nu)\sinh 2z - 2z}{(3-4\nu)\cosh 2z + 2z^2 + 5 - 12\nu + 8\nu^2},

S = 1 for the half-plane. The sum over all wave numbers is exact: the half-plane's part is a difference of Clausen
functions, that of a layer decays exponentially. Displacements of a half-plane are relative to the *mean surface*, with
G(0) = 0; those of a layer are absolute.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import LinAlgError, cholesky, hankel, solve_triangular, toeplitz
from scipy.special import zeta

from labpipe.arrays import Floats
from labpipe.contact._springs import EDGE_OFFSET, SpringBed
from labpipe.contact.line.westergaard import cosine_amplitude
from labpipe.errors import InputError
from labpipe.units import require_positive

# exp(-2z) is below the rounding of the half-plane part from here on; wave numbers that are summed at most.
_DEEP, _MAX_MODES = 25.0, 20_000_000
# sinh(2z) - 2z loses digits below this z; its series does not.
_SHALLOW = 0.5
# The last strips before a half-plane closes carry the logarithmic singularity of full contact.
_OPEN_STRIPS = 3
# Springs beyond the reach: two locate the edge.
_SPARE_SPRINGS = 16


def tip_height(profile: str, x: Floats, tip_radius: float, period: float, strip: float = 0.0) -> Floats:
    """Height (n,) [m] of a tip over its lowest point at ``x`` (n,) [m], |x| up to half a period.

    ``"parabola"`` is x²/(2R), ``"circle"`` is R − √(R² − x²) and infinite (no indenter) beyond R, ``"cosine"`` is
    h (1 − cos(2πx/λ)) with h = λ²/(4π²R). For strips of a width ``strip`` [m], f″/48 of its square is added.
    """
    require_positive("m", tip_radius=tip_radius)
    if not isinstance(profile, str) or profile not in ("parabola", "circle", "cosine"):
        raise InputError(f'profile "{profile}" is unknown; use one of parabola, circle, cosine')
    share = strip**2 / 48.0
    if profile == "parabola":
        return np.asarray(x**2 / (2.0 * tip_radius) + share / tip_radius)
    if profile == "cosine":
        sine = np.sin(np.pi * x / period) ** 2
        return np.asarray(2.0 * cosine_amplitude(tip_radius, period) * sine + share / tip_radius * (1.0 - 2.0 * sine))
    root = np.sqrt(np.maximum(tip_radius**2 - x**2, 0.0))
    bent = np.maximum(root, 0.25 * tip_radius)  # a strip at the end of the circle has no curvature
    height = x**2 / (tip_radius + root) + share * tip_radius**2 / bent**3
    return np.where(np.abs(x) < tip_radius, height, np.inf)


@dataclass(frozen=True, slots=True)
class LineKernel:
    """Displacements of a periodic surface under strips of unit pressure, for E* = 1.

    ``influence`` (element,) [m]: of the centre of strip m under pressure on strip 0; ``mean_compliance`` [m]: G(0).
    """

    period: float
    influence: Floats
    mean_compliance: float

    @property
    def elements(self) -> int:
        """Number of strips per period."""
        return int(self.influence.size)

    @property
    def spacing(self) -> float:
        """Width of a strip in m."""
        return self.period / self.elements

    @property
    def position(self) -> Floats:
        """Centres of the strips (element,) in m, 0 at index N/2."""
        return self.spacing * np.arange(-(self.elements // 2), self.elements - self.elements // 2, dtype=float)

    @property
    def datum(self) -> str:
        """Level from which displacements count."""
        return "mean surface" if self.mean_compliance == 0.0 else "rigid base (absolute)"

    def displacement(self, pressure: Floats) -> Floats:
        """Displacement (element,) under pressures (element,)."""
        symbol = np.fft.rfft(self.influence).real
        if self.mean_compliance == 0.0:
            symbol[0] = 0.0  # constants are the null space, without a rounding error
        return np.fft.irfft(np.fft.rfft(pressure) * symbol, n=self.elements)


def line_kernel(period: float, elements: int, thickness: float = np.inf, nu: float = 0.5) -> LineKernel:
    """Influence coefficients of a periodic half-plane, or of a layer bonded to a rigid base.

    ``period`` [m]: λ; ``elements``: strips per period, even; ``thickness`` [m]: of the layer, infinite for the
    half-plane; ``nu``: Poisson's ratio, which matters for a layer only.

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
    require_positive("m", period=period)
    if elements != int(elements) or elements < 8 or elements % 2:
        raise InputError(f"{elements} elements per period, expected an even number from 8 up")
    if not thickness > 0.0:
        raise InputError(f"the layer is {thickness} m thick, expected a positive length or infinity")
    if not 0.0 <= nu <= 0.5:
        raise InputError(f"Poisson's ratio is {nu}, expected 0 to 0.5")
    # -(2/π) ∫ ln|2 sin(πx/λ)| over one strip: Clausen's function at its edges.
    half = elements // 2
    edges = 2.0 * np.pi * (np.arange(half + 1) + 0.5) / elements
    antiderivative = clausen(edges)
    # Odd about 0; even about half a period, where the last two edges mirror each other.
    values = np.append(2.0 * antiderivative[0], np.diff(antiderivative))
    influence = period / np.pi**2 * np.concatenate([values, values[half - 1 : 0 : -1]])
    if not np.isfinite(thickness):
        return LineKernel(float(period), influence, 0.0)
    n_modes = int(np.ceil(_DEEP * period / (2.0 * np.pi * thickness))) + 1
    if n_modes > _MAX_MODES:
        raise InputError(
            f"a layer of {thickness:.3g} m is too thin for a period of {period:.3g} m: give a thicker layer"
        )
    mode = np.arange(1, n_modes + 1)
    q: Floats = 2.0 * np.pi / period * mode.astype(float)
    # Both signs of q add up to a cosine, hence a factor 2; another is that of G, and of the strip's transform.
    amplitude = 8.0 / period * np.sin(0.5 * q * period / elements) / q**2 * layer_deviation(q * thickness, nu)
    folded = np.bincount(mode % elements, weights=amplitude, minlength=elements)
    mean = thickness * (1.0 - 2.0 * nu) / (1.0 - nu) ** 2
    return LineKernel(float(period), influence + np.fft.fft(folded).real + mean / elements, float(mean))


def clausen(angle: Floats) -> Floats:
    """Clausen's function Cl2(θ) = −∫ ln|2 sin(t/2)| dt from 0 to θ.

    By a series, which is a fiftieth of the time of the dilogarithm of complex numbers.

    Examples
    --------
    >>> float(np.round(clausen(np.array(np.pi / 2)), 12))  # Catalan's constant
    0.915965594177
    """
    # Odd and periodic: fold onto |θ| <= π, where the series gains a factor 4 a term.
    theta = np.remainder(np.asarray(angle, dtype=float) + np.pi, 2.0 * np.pi) - np.pi
    square, series, n = (theta / (2.0 * np.pi)) ** 2, np.zeros_like(theta), np.arange(24, 0, -1)
    for coefficient in zeta(2.0 * n) / (n * (2.0 * n + 1.0)):
        series = (series + coefficient) * square
    return np.asarray(theta * (1.0 - np.log(np.maximum(np.abs(theta), np.finfo(float).tiny)) + series))


def layer_deviation(z: Floats, nu: float) -> Floats:
    """S(z) − 1 of a bonded layer, without cancellation at either end."""
    c = 5.0 - 12.0 * nu + 8.0 * nu**2
    k = 3.0 - 4.0 * nu
    deep = np.exp(-2.0 * np.minimum(z, 350.0))
    below = k * (1.0 + deep**2) + 2.0 * deep * (2.0 * z**2 + c)
    above = -2.0 * k * deep**2 - 2.0 * deep * (2.0 * z + 2.0 * z**2 + c)
    x = 2.0 * np.minimum(z, _SHALLOW)
    # sinh x - x = x^3/6 (1 + x^2/(4*5) (1 + x^2/(6*7) (1 + x^2/(8*9) ...)))
    rest = np.ones_like(x)
    for divisor in (272.0, 210.0, 156.0, 110.0, 72.0, 42.0, 20.0):
        rest = 1.0 + x**2 / divisor * rest
    factor = (k * x**3 / 6.0 * rest + (2.0 - 4.0 * nu) * x) / (k * np.cosh(x) + x**2 / 2.0 + c)
    return np.where(z < _SHALLOW, factor - 1.0, above / below)


@dataclass(frozen=True, slots=True)
class StripBed:
    """The bed of springs of a line contact; the pressure per load of the springs is ``factor^-T (scale * load)``."""

    springs: SpringBed
    factor: Floats
    scale: Floats

    def pressure(self, kernel: LineKernel, load: Floats) -> Floats:
        """Pressure (element,), centred on x = 0 at index N/2, from spring loads (spring,)."""
        half = solve_triangular(self.factor, load * self.scale, lower=True, trans="T", check_finite=False)
        n, centre = half.size, kernel.elements // 2
        full = np.zeros(kernel.elements)
        full[centre : centre + min(n, centre)] = half[:centre]
        full[centre - n + 1 : centre + 1] = half[::-1]
        return full


def strip_bed(kernel: LineKernel, profile: Floats, reach: float) -> StripBed:
    """Factor the half period of a symmetric profile from the centre outwards.

    ``profile`` (n,) [m] is the height of the indenter above its lowest point at x = 0, Δx, 2Δx, ..., fewer values than
    ``elements/2 + 1`` when it ends before; only strips that an approach of ``reach`` [m] can touch are factored.
    """
    half = kernel.elements // 2
    is_half_plane = kernel.mean_compliance == 0.0
    # Constants are in the null space of a half-plane: the last strip has no spring.
    available = min(half if is_half_plane else half + 1, profile.size)
    # Contact grows monotonically on a half-plane; a layer may bulge, so there every strip has to be looked at.
    near = int(1.3 * np.count_nonzero(profile[:available] <= reach)) + _SPARE_SPRINGS
    n = min(available, near) if is_half_plane else available
    while True:
        matrix, counts = folded_matrix(kernel, n)
        try:
            factor = cholesky(matrix.T, lower=True, overwrite_a=True, check_finite=False)  # as LAPACK stores it
        except LinAlgError:
            raise InputError(
                "the influence matrix is not positive definite in double precision: the layer is too "
                "thin (or too nearly incompressible) for this period; give a thicker layer"
            ) from None
        both = np.stack([counts, counts * profile[:n]], axis=1)
        solved: Floats = solve_triangular(factor, both, lower=True, check_finite=False)
        scale, gap = solved[:, 0], solved[:, 1] / solved[:, 0]
        if n == available or gap[-1] > reach:
            break
        n = min(available, 2 * n)
    reached = np.flatnonzero(gap <= reach)
    keep = min(n, (int(reached[-1]) if reached.size else 0) + _SPARE_SPRINGS)
    springs = SpringBed(
        gap[:keep],
        kernel.spacing * scale[:keep] ** 2,
        kernel.spacing * np.maximum(np.arange(keep) - EDGE_OFFSET, 0.0),
        # Where strips beyond the reach were left out, running into them would be a mistake of this module.
        1 if keep < available else 0 if n == half + 1 else _OPEN_STRIPS,
        full_width=min((keep - 0.5) * kernel.spacing, 0.5 * kernel.period),
    )
    return StripBed(springs, factor[:keep, :keep], scale[:keep])


def folded_matrix(kernel: LineKernel, n: int) -> tuple[Floats, Floats]:
    """Influence matrix (n, n) of the folded half period, made symmetric, and how often (n,) each strip occurs."""
    influence, counts = kernel.influence, np.full(n, 2.0)
    matrix = toeplitz(influence[:n])
    matrix += hankel(influence[:n], np.take(influence, range(n - 1, 2 * n - 1), mode="wrap"))
    matrix *= 2.0
    for strip in (0, n - 1) if n == kernel.elements // 2 + 1 else (0,):
        counts[strip] = 1.0
        matrix[strip] *= 0.5
        matrix[:, strip] *= 0.5
    return matrix, counts
