"""The virtual rig's own periodic indentation: closed-form springs with their whole history.

The bundled simulator discretises the period into boundary elements and steps the creep
compliance of a Prony series. This reference uses the closed forms of a parabolic tip on a
half-plane and the true relaxation function (:mod:`pipelines.rig.heredity`), so the two share
neither the spatial nor the temporal scheme.

References
----------
Mean-plane approach and stiffness of a periodic parabolic contact of half-width b, period λ::

    g(b) = λ²/(4π²R) [π²/6 − Li₂(cos²(πb/λ))],     S(b) = −(π/2) / ln sin(πb/λ)
"""

import numpy as np
from numpy.typing import NDArray
from scipy.special import spence

from labpipe.arrays import Floats
from labpipe.compilation import lean
from pipelines.rig.heredity import History, no_history, press, reach_of, remember
from pipelines.rig.solids import Viscoelastic

SPRINGS = 1500
WIDEST = 0.3  # of the period: the reference refuses wider contacts than it resolves


@lean()
def _march(
    time: Floats,
    depth: Floats,
    gap: Floats,
    weight: Floats,
    history: History,
    force: Floats,
    edge: NDArray[np.int64],
    room: Floats,
) -> None:
    """Step every spring through the displacement history; fills ``force`` and ``edge``; ``room`` (3, spring) is 0."""
    u, base, rise = room[0], room[1], room[2]
    reach = reach_of(u)
    for n in range(1, time.size):
        step = time[n] - time[n - 1]
        force[n], last, reach = press(history, time[n], step, depth[n], gap, weight, u, base, rise, reach, 0.0)
        edge[n] = max(last, 0)
        remember(history, time[n - 1], time[n], rise, reach)


def reference_indentation(
    solid: Viscoelastic, *, tip_radius: float, period: float, depth: float, time: Floats, displacement: Floats
) -> tuple[Floats, Floats]:
    """Force of one tip row and contact half-width under a displacement history.

    ``depth`` [m] is the contact length summed over the tips; ``displacement`` (time,) [m] begins at zero load and is as
    fine as the accuracy that is wanted. Returns force [N] and half-width [m] (time,).
    """
    edges = period * WIDEST * (np.arange(SPRINGS + 1) / SPRINGS) ** 1.5  # finer at the centre
    centre = 0.5 * (edges[1:] + edges[:-1])
    cosine = np.cos(np.pi * centre / period) ** 2
    gap = period**2 / (4 * np.pi**2 * tip_radius) * (np.pi**2 / 6 - spence(1 - cosine))
    with np.errstate(divide="ignore"):
        stiffness = -(np.pi / 2) / np.log(np.sin(np.pi * edges / period))
    force, edge = np.zeros(time.size), np.zeros(time.size, dtype=np.int64)
    _march(
        np.asarray(time, float),
        np.asarray(displacement, float),
        gap,
        np.diff(stiffness),
        no_history(solid, SPRINGS, 1 / (1 - solid.nu**2)),
        force,
        edge,
        np.zeros((3, SPRINGS)),
    )
    return force * depth, np.where(force > 0, edges[edge + 1], 0.0)
