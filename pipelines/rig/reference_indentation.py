"""The virtual rig's own periodic indentation: closed-form springs in relaxation form.

The bundled simulator discretises the period into boundary elements and steps the creep
compliance. This reference uses the closed forms of a parabolic tip on a half-plane and steps
the relaxation modulus, so the two share neither the spatial nor the temporal scheme.

References
----------
Mean-plane approach and stiffness of a periodic parabolic contact of half-width b, period λ::

    g(b) = λ²/(4π²R) [π²/6 − Li₂(cos²(πb/λ))],     S(b) = −(π/2) / ln sin(πb/λ)
"""

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.special import spence

from labpipe.arrays import Floats

SPRINGS = 1500
WIDEST = 0.3  # of the period: the reference refuses wider contacts than it resolves


@numba.njit(cache=True)
def _march(
    time: Floats,
    depth: Floats,
    gap: Floats,
    weight: Floats,
    E_relaxed: float,
    E: Floats,
    rho: Floats,
    force: Floats,
    edge: NDArray[np.int64],
) -> None:
    """Step every spring through the displacement history; fills ``force`` and ``edge``."""
    n_springs, n_terms = gap.size, E.size
    u, h = np.zeros(n_springs), np.zeros((n_springs, n_terms))
    decay, phi = np.empty(n_terms), np.empty(n_terms)
    reach = 0
    for n in range(1, time.size):
        step = time[n] - time[n - 1]
        stiffness = E_relaxed
        for j in range(n_terms):
            x = step / rho[j]
            decay[j] = np.exp(-x)
            phi[j] = -np.expm1(-x) / x
            stiffness += E[j] * phi[j]
        for i in range(n_springs):
            target = depth[n] - gap[i]
            if i >= reach and target <= 0.0:
                break
            base = E_relaxed * u[i]
            for j in range(n_terms):
                base += E[j] * decay[j] * h[i, j]
            free = u[i] - base / stiffness
            new = max(free, target)
            rise = new - u[i]
            if target > free:
                force[n] += weight[i] * (base + stiffness * rise)
                edge[n] = i
            for j in range(n_terms):
                h[i, j] = decay[j] * h[i, j] + phi[j] * rise
            u[i] = new
            reach = max(reach, i + 1)


def reference_indentation(
    E_relaxed: float,
    E: Floats,
    rho: Floats,
    nu: float,
    *,
    tip_radius: float,
    period: float,
    depth: float,
    time: Floats,
    displacement: Floats,
) -> tuple[Floats, Floats]:
    """Force of one tip row and contact half-width under a displacement history.

    Parameters
    ----------
    E_relaxed, E, rho, nu
        Maxwell branches of the substrate in Pa and s, Poisson's ratio.
    tip_radius, period, depth : float [m]
        Geometry; ``depth`` is the contact length summed over the tips.
    time, displacement : array (time,) [s], [m]
        History, from zero load; as fine as the accuracy that is wanted.

    Returns
    -------
    force, half_width : array (time,) [N], [m]
    """
    edges = period * WIDEST * (np.arange(SPRINGS + 1) / SPRINGS) ** 1.5  # finer at the centre
    centre = 0.5 * (edges[1:] + edges[:-1])
    cosine = np.cos(np.pi * centre / period) ** 2
    gap = period**2 / (4 * np.pi**2 * tip_radius) * (np.pi**2 / 6 - spence(1 - cosine))
    with np.errstate(divide="ignore"):
        stiffness = -(np.pi / 2) / np.log(np.sin(np.pi * edges / period))
    force, edge = np.zeros(time.size), np.zeros(time.size, dtype=np.int64)
    plane = 1 / (1 - nu**2)
    _march(
        np.asarray(time, float),
        np.asarray(displacement, float),
        gap,
        np.diff(stiffness),
        E_relaxed * plane,
        np.asarray(E, float) * plane,
        np.asarray(rho, float),
        force,
        edge,
    )
    return force * depth, np.where(force > 0, edges[edge + 1], 0.0)
