"""The hereditary integral of many springs at once, ∫ E(t − s) du(s), without exponential memory.

The bundled simulators carry one internal variable per term of a Prony series. Here the history of
every spring is kept as it was: displacement is linear over each step, and each step contributes
the mean of the true relaxation function over it (product integration). Steps long past are taken
together: a block of them acts by its moments about its centre and the derivatives of E there
(Taylor to third order), once it is narrower than a share of its distance from now. So a step
costs as much as the logarithm of the elapsed time, and no term of any series is formed.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Floats
from labpipe.compilation import inner
from pipelines.rig.solids import Viscoelastic

_FIRST, _LAST = np.log(1e-9), np.log(1e7)  # ln of the times between which E is tabulated
_SPACING = 0.04
_NARROW = 0.25  # width of a block over its distance: the Taylor remainder is below 1e-5 of E
_MOMENTS = 4
_BLOCKS = 512


class History(NamedTuple):
    """The history of springs until now.

    ``table`` (time, 6) holds the mean of E from 0 on, E, and t^n/n! times its first four
    derivatives. ``edges`` (block, 2) are begin and end of each block, ``moments``
    (block, moment, spring) of the increments in it, ``order`` the blocks from old to new;
    ``is_single`` marks one step. ``blocks`` (1,) is their number. ``values`` (2, 5) is room for
    values of the table.
    """

    table: Floats
    edges: Floats
    moments: Floats
    is_single: NDArray[np.bool_]
    order: NDArray[np.int64]
    blocks: NDArray[np.int64]
    values: Floats


def no_history(solid: Viscoelastic, springs: int, scale: float = 1.0) -> History:
    """Return the history of springs at rest whose modulus is ``scale`` times that of the solid."""
    time = np.exp(np.arange(_FIRST, _LAST + _SPACING, _SPACING))
    columns = [solid.mean_relaxation(time), solid.relaxation(time)]
    columns += [solid.derivative(time, order) for order in range(1, _MOMENTS + 1)]
    return History(
        np.ascontiguousarray(scale * np.column_stack(columns)),
        np.zeros((_BLOCKS, 2)),
        np.zeros((_BLOCKS, _MOMENTS, springs)),
        np.zeros(_BLOCKS, dtype=np.bool_),
        np.arange(_BLOCKS),
        np.zeros(1, dtype=np.int64),
        np.zeros((2, 5)),
    )


def copy_of(history: History, springs: int) -> History:
    """Return a copy of the history of the first springs."""
    changing = {name: getattr(history, name).copy() for name in ("edges", "is_single", "order", "blocks")}
    return history._replace(moments=history.moments[:, :, :springs].copy(), **changing)


@inner()
def reach_of(displacement: Floats) -> int:
    """Return how many springs there are up to the last that is displaced."""
    reach = displacement.size
    while reach > 0 and displacement[reach - 1] == 0.0:
        reach -= 1
    return reach


@inner()
def kernel(table: Floats, time: float, values: Floats) -> None:
    """Fill ``values`` (5,): mean of E up to a time, E, and its first three scaled derivatives."""
    x = (math.log(time) - _FIRST) / _SPACING if time > 0.0 else 0.0
    k = min(max(int(x), 0), table.shape[0] - 2)
    s = min(max(x - k, 0.0), 1.0)
    a, b = (1 + 2 * s) * (1 - s) ** 2, s * s * (3 - 2 * s)
    c, d = _SPACING * s * (1 - s) ** 2, _SPACING * s * s * (s - 1)
    low, high = table[k], table[k + 1]
    values[0] = a * low[0] + b * high[0] + c * (low[1] - low[0]) + d * (high[1] - high[0])
    for n in range(_MOMENTS):  # slope over ln t of t^n E^(n)/n!
        rise_low = n * low[n + 1] + (n + 1) * low[n + 2]
        rise_high = n * high[n + 1] + (n + 1) * high[n + 2]
        values[n + 1] = a * low[n + 1] + b * high[n + 1] + c * rise_low + d * rise_high


@inner()
def stiffness_of_step(history: History, step: float) -> float:
    """Return the stress per displacement that grows linearly over a step from now."""
    kernel(history.table, step, history.values[0])
    return float(history.values[0, 0])


@inner()
def pull(history: History, now: float, reach: int, result: Floats) -> None:
    """Fill the stress of the first ``reach`` springs at a time, if they rest from now on."""
    for i in range(reach):
        result[i] = 0.0
    first, second = history.values[0], history.values[1]
    for place in range(history.blocks[0]):
        b = history.order[place]
        begin, end = history.edges[b, 0], history.edges[b, 1]
        if history.is_single[b]:
            kernel(history.table, now - begin, first)
            kernel(history.table, now - end, second)
            weight = ((now - begin) * first[0] - (now - end) * second[0]) / (end - begin)
            increments = history.moments[b, 0]
            for i in range(reach):
                result[i] += weight * increments[i]
        else:
            distance = now - 0.5 * (begin + end)
            kernel(history.table, distance, first)
            w0, w1 = first[1], -first[2] / distance
            w2, w3 = first[3] / distance**2, -first[4] / distance**3
            m = history.moments[b]
            for i in range(reach):
                result[i] += w0 * m[0, i] + w1 * m[1, i] + w2 * m[2, i] + w3 * m[3, i]


@inner()
def press(
    history: History,
    end: float,
    step: float,
    approach: float,
    gap: Floats,
    weight: Floats,
    u: Floats,
    base: Floats,
    rise: Floats,
    reach: int,
    disc: float,
) -> tuple[float, int, int]:
    """Push springs to an approach over one step; returns their force, the last that is pushed (or -1), and the reach.

    ``u`` (spring,) is moved on; ``base`` and ``rise`` (spring,) are scratch. Behind each spring is an elastic one of
    the compliance ``disc`` [1/Pa], 0 for a rigid disc: of its push over the free end a spring takes the share
    1 / (1 + disc · stiffness).
    """
    force, edge = 0.0, -1
    stiffness = stiffness_of_step(history, step)
    share = 1.0 / (1.0 + disc * stiffness)
    pull(history, end, reach, base)
    for i in range(gap.size):
        target = approach - gap[i]
        if i >= reach and target <= 0.0:
            break
        free = u[i] - base[i] / stiffness
        new = free + share * max(target - free, 0.0)
        rise[i] = new - u[i]
        u[i] = new
        if target > free:
            force += weight[i] * (base[i] + stiffness * rise[i])
            edge = i
        reach = max(reach, i + 1)
    return force, edge, reach


@inner()
def remember(history: History, begin: float, end: float, increments: Floats, reach: int) -> None:
    """Append one step of the first ``reach`` springs and take old steps together."""
    place = history.blocks[0]
    if place >= history.order.size:
        raise RuntimeError("the history has more blocks than room")
    if end < begin or (place > 0 and begin < history.edges[history.order[place - 1], 1] * (1 - 1e-12)):
        raise RuntimeError("the history would run backwards")
    b = history.order[place]
    history.edges[b, 0], history.edges[b, 1] = begin, end
    history.is_single[b] = True
    moments = history.moments[b]
    for i in range(moments.shape[1]):
        moments[0, i] = increments[i] if i < reach else 0.0
        for n in range(1, _MOMENTS):
            moments[n, i] = 0.0
    history.blocks[0] = place + 1
    _take_together(history, end, reach)


@inner()
def _take_together(history: History, now: float, reach: int) -> None:
    order, edges = history.order, history.edges
    place = 0
    while place + 1 < history.blocks[0]:
        a, b = order[place], order[place + 1]
        if edges[b, 1] - edges[a, 0] > _NARROW * (now - edges[b, 1]):
            if now - edges[b, 1] <= 0.0:
                break
            place += 1
            continue
        centre = 0.5 * (edges[a, 0] + edges[b, 1])
        for block in (a, b):  # its moments about the common centre
            begin, end, m = edges[block, 0], edges[block, 1], history.moments[block]
            d = 0.5 * (begin + end) - centre
            for i in range(reach):
                if history.is_single[block]:
                    m[2, i] = m[0, i] * (end - begin) ** 2 / 12
                m[3, i] += 3 * d * m[2, i] + 3 * d * d * m[1, i] + d**3 * m[0, i]
                m[2, i] += 2 * d * m[1, i] + d * d * m[0, i]
                m[1, i] += d * m[0, i]
        for n in range(_MOMENTS):
            for i in range(reach):
                history.moments[a, n, i] += history.moments[b, n, i]
        edges[a, 1] = edges[b, 1]
        history.is_single[a] = False
        last = history.blocks[0] - 1
        for k in range(place + 1, last):
            order[k] = order[k + 1]
        order[last] = b
        history.blocks[0] = last
