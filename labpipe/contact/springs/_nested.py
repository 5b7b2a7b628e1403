"""What nested springs answer, compiled: which are touched, where between two the edge lies, what it adds.

In all functions ``gap`` [m], ``stiffness`` and ``edge`` [m] are those of a bed, array (spring,), and
``trial`` (spring,) is what each spring would carry, below zero where it is not touched.
"""

import math

from labpipe.arrays import Floats
from labpipe.compilation import inner, lean

# Pressures may differ from nested order by rounding only.
NESTED_TOLERANCE = 1e-9
# The edge's share of the force needs so many springs in contact.
_EDGE_SPRINGS = 2
# Second Bernoulli number, B2 = B2(0).
_B2 = 1.0 / 6.0


@lean()
def pressed(
    gap: Floats,
    stiffness: Floats,
    edge: Floats,
    history: Floats,
    compliance: float,
    displacement: float,
    shrinks: bool,
    load: Floats,
) -> tuple[int, float, float]:
    """Press the springs to a displacement [m] and write their ``load`` (spring,).

    Returns: Springs in contact; -1 if they are not nested. Returns [N per reduced modulus and depth]. Returns [m]:
    NaN where every spring is in contact.
    """
    size, touched = gap.size, 0
    for j in range(size):
        load[j] = (displacement - history[j] - gap[j]) / compliance
        if load[j] > 0.0:
            touched += 1
    force, half_width = 0.0, 0.0
    for j in range(touched):
        rises = j > 0 and load[j] - load[j - 1] > NESTED_TOLERANCE * load[0]
        if load[j] <= 0.0 or rises:
            return -1, force, half_width
        force += stiffness[j] * load[j]
    if touched == size:
        half_width = math.nan
    elif touched > 0:
        share = _share(gap, load, touched, shrinks)
        force += _edge_force(gap, stiffness, edge, load, touched, share)
        half_width = _width(edge, touched, share)
    for j in range(touched, size):
        load[j] = 0.0
    return touched, force, half_width


@lean()
def smooth_edge_force(gap: Floats, stiffness: Floats, edge: Floats, trial: Floats, touched: int) -> float:
    """Force of the edge as :func:`pressed` adds it, but continuous as springs come and go.

    The share is the place between the inner and the outer spring where the loads of either side,
    linear in the gap, reach zero; the two add up to the cell in a contact that neither relaxes nor
    recovers. Less accurate than the share of one side, which jumps where springs come and go.
    """
    inside, outside = touched - 1, touched
    if touched < _EDGE_SPRINGS or outside + 1 == gap.size:
        share = trial[inside] / (trial[inside] - trial[outside])
    else:
        before = _rest(gap, trial, inside - 1, inside)
        behind = -_rest(gap, trial, outside, outside + 1)
        share = before / max(before + behind, 1e-300)
    return _edge_force(gap, stiffness, edge, trial, touched, share)


@inner()
def _share(gap: Floats, trial: Floats, touched: int, shrinks: bool) -> float:
    """Where between two springs (0 to 1 in the gap) the load, linear in the gap, reaches zero.

    While the contact grows, the springs outside tell (those inside have just begun to relax,
    at different rates); while it shrinks, the springs inside do (those outside have just begun
    to recover).
    """
    inside, outside = touched - 1, touched
    cell = gap[outside] - gap[inside]
    if cell <= 0.0:
        share = trial[inside] / (trial[inside] - trial[outside])
    elif shrinks and inside > 0:
        share = _rest(gap, trial, inside - 1, inside) / cell
    elif outside + 1 < gap.size:
        share = 1.0 + _rest(gap, trial, outside, outside + 1) / cell
    else:
        share = _rest(gap, trial, inside, outside) / cell
    return min(max(share, 0.0), 1.0)


@inner()
def _width(edge: Floats, touched: int, share: float) -> float:
    """Contact half width of an edge between two springs; the gap grows with its square."""
    inside, outside = edge[touched - 1] ** 2, edge[touched] ** 2
    return math.sqrt(inside + share * (outside - inside))


@inner()
def _edge_force(gap: Floats, stiffness: Floats, edge: Floats, trial: Floats, touched: int, share: float) -> float:
    """Force between the plain sum over the springs of a smooth profile and the integral up to the edge.

    Continuous as springs come and go, if ``share`` is.
    """
    if touched < _EDGE_SPRINGS:
        return 0.0
    inside, outside = touched - 1, touched
    place = (_width(edge, touched, share) - edge[inside]) / (edge[outside] - edge[inside])
    weight = (1.0 - place) * stiffness[inside] + place * stiffness[outside]
    half_bernoulli = 0.5 * (place * (place - 1.0) + _B2) * weight
    if touched == _EDGE_SPRINGS:
        # It comes in without a jump of force.
        half_bernoulli *= share
    # Loads inside, continued outwards: springs outside answer with the step's own compliance.
    cell = gap[outside] - gap[inside]
    slope = (trial[inside - 1] - trial[inside]) / (gap[inside] - gap[inside - 1])
    return half_bernoulli * ((1.0 - share) * slope * cell + trial[inside])


@inner()
def _rest(gap: Floats, trial: Floats, first: int, second: int) -> float:
    """Gap [m] from the pair's nearer end to where its loads, on one line, are zero."""
    near = second if trial[second] > 0.0 else first
    return trial[near] * (gap[second] - gap[first]) / max(trial[first] - trial[second], 1e-300)
