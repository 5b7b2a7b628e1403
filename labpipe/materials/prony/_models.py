r"""The rheological models of springs and dashpots, as special cases of the Prony series.

Thesis section 1.3, equations (1.27) to (1.42); the generalised Maxwell model is the series itself.
Written there for a generic modulus 𝒢; the moduli here are those of tension. Every function returns a
:class:`.Prony`, so that relaxation, creep and complex modulus come from one place:

==========================  ===========================================  ====================
model                       relaxation modulus, t ≥ 0                    thesis
==========================  ===========================================  ====================
Maxwell (liquid)            ℰ exp(−t/τ), τ = μ/ℰ                         (1.33), (1.34), (1.36)
standard linear solid       ℰ₀ + ℰ₁ exp(−t/τ)                            (1.37) to (1.40)
generalised Maxwell         ℰ₀ + Σ ℰ_j exp(−t/τ_j)                       (1.41), (1.42)
==========================  ===========================================  ====================
"""

from labpipe.errors import InputError
from labpipe.materials.prony._prony import Prony
from labpipe.units import require_positive


def maxwell(modulus: float, viscosity: float, nu: float = 0.5) -> Prony:
    """Return a spring and a dashpot in series: a liquid with one relaxation time.

    Parameters
    ----------
    modulus : float [Pa]
        ℰ of the spring.
    viscosity : float [Pa s]
        μ of the dashpot; the relaxation time is μ/ℰ (1.30).
    nu : float
        Poisson's ratio.

    Examples
    --------
    Creep is J(t) = 1/ℰ + t/μ (1.34):

    >>> maxwell(2.0, 8.0).creep([0.0, 4.0])
    array([0.5, 1. ])
    """
    require_positive("Pa", modulus=modulus)
    require_positive("Pa s", viscosity=viscosity)
    return Prony(0.0, [modulus], [viscosity / modulus], nu)


def standard_linear_solid(E_relaxed: float, E_unrelaxed: float, relaxation_time: float, nu: float = 0.5) -> Prony:
    """Return a spring beside a Maxwell element (Zener): the simplest solid that relaxes.

    Parameters
    ----------
    E_relaxed, E_unrelaxed : float [Pa]
        ℰ₀ and ℰ_∞ = ℰ₀ + ℰ₁ of the thesis, E_relaxed < E_unrelaxed.
    relaxation_time : float [s]
        τ of (1.37). The retardation time is β τ with β = E_unrelaxed/E_relaxed (1.38).
    nu : float
        Poisson's ratio.

    Examples
    --------
    >>> solid = standard_linear_solid(1.0, 2.0, 3.0)
    >>> C, tau = solid.creep_terms()
    >>> float(tau[0])
    6.0
    """
    require_positive("Pa", E_relaxed=E_relaxed)
    if not E_unrelaxed > E_relaxed:
        raise InputError(
            f"E_unrelaxed = {E_unrelaxed} Pa is not above E_relaxed = {E_relaxed} Pa: a material "
            "relaxes from the larger modulus to the smaller one"
        )
    return Prony(E_relaxed, [E_unrelaxed - E_relaxed], [relaxation_time], nu)
