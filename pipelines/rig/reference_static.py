"""The virtual rig's own creep of a sphere under growing load: Lee and Radok, Laplace inverted.

The bundled simulator marches springs through exponential memory, with a creep compliance that is
converted from the Maxwell branches. This reference inverts the Laplace transform of the creep
compliance numerically and puts it into Lee and Radok's closed form for a contact that only grows,

    a³(t) = (3R/4) Σ ΔF_i J*(t − t_i),     δ = a²/R.

References
----------
E. H. Lee & J. R. M. Radok, J. Appl. Mech. 27 (1960) 438, https://doi.org/10.1115/1.3644020;
J. Abate & W. Whitt, INFORMS J. Comput. 18 (2006) 408 (fixed Talbot),
https://doi.org/10.1287/ijoc.1050.0137.
"""

import numpy as np

from labpipe.arrays import Floats

_NODES = 24  # of the Talbot contour; 14 digits in double precision at most


def creep_compliance(E_relaxed: float, E: Floats, rho: Floats, time: Floats) -> Floats:
    """Return the creep compliance [1/Pa] at times above 0, by a fixed Talbot contour.

    Parameters
    ----------
    E_relaxed, E, rho
        Maxwell branches in Pa and s.
    time : array (n,) [s]
    """
    angle = np.arange(1, _NODES) * np.pi / _NODES
    cotangent = 1 / np.tan(angle)
    r = 2 * _NODES / 5
    node = np.concatenate([[r + 0j], r * angle * (cotangent + 1j)])
    slope = 1j * angle * (1 + cotangent**2) - 1j * cotangent
    weight = np.concatenate([[0.5 * np.exp(r) + 0j], (1 + slope) * np.exp(node[1:])])
    s = node / time[:, None]
    carson = E_relaxed + (E * s[..., None] * rho / (1 + s[..., None] * rho)).sum(axis=-1)
    # L[J] = 1/(s · Carson transform of E)
    result: Floats = 0.4 / time * np.real(weight / (s * carson)).sum(axis=1)
    return result


def reference_static(
    E_relaxed: float,
    E: Floats,
    rho: Floats,
    nu: float,
    *,
    radius: float,
    load_times: Floats,
    loads: Floats,
    time: Floats,
) -> Floats:
    """Approach of a sphere on a rigid flat under loads that are only added to.

    Parameters
    ----------
    E_relaxed, E, rho, nu
        Maxwell branches in Pa and s, Poisson's ratio.
    radius : float [m]
    load_times, loads : array (load,) [s], [N]
        When each load begins, and its whole force.
    time : array (n,) [s]

    Returns
    -------
    array (n,) [m]
        0 before the first load.
    """
    compliance = np.zeros(time.size)
    for begin, step in zip(load_times, np.diff(loads, prepend=0.0), strict=True):
        after = time > begin
        compliance[after] += step * creep_compliance(E_relaxed, E, rho, time[after] - begin)
    cube = 0.75 * radius * (1 - nu**2) * compliance
    return np.asarray(cube ** (2 / 3) / radius)
