"""The virtual rig's own creep of a sphere under growing load: Lee and Radok, Laplace inverted.

The bundled simulator marches springs through exponential memory, with a creep compliance that is
converted from a Prony series. This reference inverts the Laplace transform of the true creep
compliance numerically and puts it into Lee and Radok's closed form for a contact that only grows,

    a³(t) = (3R/4) Σ ΔF_i J*(t − t_i),     δ = a²/R.

References
----------
E. H. Lee & J. R. M. Radok, J. Appl. Mech. 27 (1960) 438, https://doi.org/10.1115/1.3644020.
"""

import numpy as np

from labpipe.arrays import Floats
from pipelines.rig.solids import Viscoelastic


def reference_static(
    solid: Viscoelastic, *, radius: float, load_times: Floats, loads: Floats, time: Floats, disc: float = 0.0
) -> Floats:
    """Approach (n,) [m] of a sphere on a flat under loads that are only added to; 0 before the first load.

    ``load_times`` and ``loads`` (load,) [s], [N] say when each load begins, and its whole force; ``disc`` [1/Pa] is the
    compliance (1 − ν²)/E of the flat, 0 for a rigid one.
    """
    compliance = np.zeros(time.size)
    for begin, step in zip(load_times, np.diff(loads, prepend=0.0), strict=True):
        after = time > begin
        compliance[after] += step * ((1 - solid.nu**2) * solid.creep(time[after] - begin) + disc)
    cube = 0.75 * radius * compliance
    return np.asarray(cube ** (2 / 3) / radius)
