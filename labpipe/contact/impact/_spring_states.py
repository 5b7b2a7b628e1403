"""The springs of a contact at its nodes, compiled: when each is touched and let go, what it holds, its energy."""

import math

from labpipe.arrays import Floats
from labpipe.compilation import inner
from labpipe.contact.impact._edge import gap
from labpipe.contact.impact._polynomials import crossing, fade, power_sum, value_at
from labpipe.contact.impact._records import Fall, Law, Nodes, Path, Room, Scheme


@inner()
def sample_touch(
    law: Law, scheme: Scheme, fall: Fall, room: Room, path: Path, peak: int, dent: Floats, outer: float, nodes: Nodes
) -> None:
    """Note for each node when it was touched, and its Maxwell elements less the fading integral."""
    K, J, N = law.elements, law.maxwells, scheme.s.size
    largest = path.state[peak, 3]
    step = 0
    for n in range(N - 1, -1, -1):
        square = largest**2 * (1.0 - scheme.s[n] ** 2)
        while step < peak - 1 and path.state[step + 1, 3] ** 2 < square:
            step += 1
        u, h = 1.0, path.time[step + 1] - path.time[step]
        if n == N - 1:
            u = 0.0
        elif n > 0:
            u = crossing(path.edge[step], square - path.state[step, 3] ** 2, 1.0)
        time = path.time[step] + u * h
        nodes.touch[n] = time
        fade(law, path.fading[step], h, u, path.powers[step], nodes.fading, room.short)
        inside = 0.0 if outer <= 0.0 else 1.0 - square / outer**2
        s = math.sqrt(inside) if inside > 0.0 else 0.0
        for k in range(K):
            nodes.before[k, n] = 0.0
            if outer > 0.0:
                nodes.before[k, n] = value_at(scheme, dent[k], s)
        for j in range(J):
            total = -nodes.fading[j]
            if outer > 0.0:
                for k in range(K):
                    total += law.mixed[j, k] * nodes.before[k, n] * math.exp(-law.creep_rate[k] * time)
            nodes.base[j, n] = total


@inner()
def _kelvin(law: Law, displacement: float, maxwell: Floats, load: float, out: Floats) -> None:
    """Kelvin elements (element,) of a spring from its Maxwell elements."""
    K = law.elements
    rest = displacement - law.instantaneous * load
    for k in range(K):
        if law.is_liquid and k == K - 1:
            out[k] = rest
            return
        total = law.E_relaxed * displacement
        for j in range(law.maxwells):
            total += law.E[j] * law.mixed[j, k] * maxwell[j]
        out[k] = law.C[k] * total
        rest -= out[k]


@inner()
def sample_release(
    law: Law, scheme: Scheme, fall: Fall, room: Room, path: Path, peak: int, last: int, nodes: Nodes
) -> None:
    """Note for each node when it lets go, and its Kelvin elements then."""
    N = scheme.s.size
    largest = path.state[peak, 3]
    step, reached = peak, 0.0
    for n in range(N):
        place = scheme.s[n]
        while step < last - 1 and reached + power_sum(path.edge[step], 1.0) < place:
            reached += power_sum(path.edge[step], 1.0)
            step += 1
        u, h = 1.0, path.time[step + 1] - path.time[step]
        if n == 0:
            u = 0.0
        elif n < N - 1:
            u = crossing(path.edge[step], place - reached, 1.0)
        time = path.time[step] + u * h
        nodes.release[n] = time
        fade(law, path.fading[step], h, u, path.powers[step], nodes.fading, room.short)
        x = largest * math.sqrt(max(1.0 - place**2, 0.0))
        depth = path.approach[step] + power_sum(path.powers[step], u) - gap(fall, x)
        for j in range(law.maxwells):
            nodes.fading[j] += nodes.base[j, n] * math.exp(-law.rate[j] * (time - nodes.touch[n]))
        _kelvin(law, depth, nodes.fading, 0.0, nodes.element)
        for k in range(law.elements):
            nodes.after[k, n] = nodes.element[k]


@inner()
def store(
    law: Law, scheme: Scheme, fall: Fall, center: Floats, path: Path, last: int, largest: float, nodes: Nodes
) -> None:
    """Energy held by the springs within the largest contact at the end of every step."""
    N, K = scheme.s.size, law.elements
    for i in range(last + 1):
        time, total = path.time[i], 0.0
        for n in range(N):
            load = 0.0
            if time < nodes.touch[n] or (time == nodes.touch[n] and n == 0):
                for k in range(K):
                    nodes.element[k] = nodes.before[k, n] * math.exp(-law.creep_rate[k] * time)
            elif time < nodes.release[n]:
                x = largest * math.sqrt(max(1.0 - scheme.s[n] ** 2, 0.0))
                depth = path.approach[i] - gap(fall, x)
                load = law.E_relaxed * depth
                for j in range(law.maxwells):
                    left = math.exp(-law.rate[j] * (time - nodes.touch[n]))
                    nodes.fading[j] = path.fading[i, j] + nodes.base[j, n] * left
                    load += law.E[j] * nodes.fading[j]
                _kelvin(law, depth, nodes.fading, load, nodes.element)
            else:
                for k in range(K):
                    left = math.exp(-law.creep_rate[k] * (time - nodes.release[n]))
                    nodes.element[k] = nodes.after[k, n] * left
            energy = 0.5 * law.instantaneous * load**2
            for k in range(law.kelvins):
                whole = nodes.element[k] + center[k] * math.exp(-law.creep_rate[k] * time)
                energy += 0.5 * whole**2 / law.C[k]
            total += scheme.means[0, n] * largest * energy
        path.stored[i] = total


@inner()
def recover(law: Law, scheme: Scheme, center: Floats, path: Path, last: int, nodes: Nodes) -> None:
    """Let the springs recover from their release to the end of the contact, and count from the undeformed surface."""
    for n in range(scheme.s.size):
        for k in range(law.elements):
            left = math.exp(-law.creep_rate[k] * (path.time[last] - nodes.release[n]))
            nodes.after[k, n] *= left
            nodes.after[k, n] += center[k] * math.exp(-law.creep_rate[k] * path.time[last])
