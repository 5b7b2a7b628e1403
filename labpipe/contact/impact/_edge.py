"""Where the contact of a sphere ends, compiled: on a fresh surface, on one with dents, and while it recedes."""

import math

from labpipe.compilation import inner
from labpipe.contact.impact._polynomials import value_at
from labpipe.contact.impact._records import Fall, Law, Room, Scheme

_EDGE_LIMIT = 60


@inner()
def gap(fall: Fall, x: float) -> float:
    """Approach at which an undeformed spring at ``x`` [m] touches."""
    if fall.is_sphere:
        return x * math.atanh(min(x / fall.radius, 0.999999))
    return x * x / fall.radius


@inner()
def _steepness(fall: Fall, x: float) -> float:
    """Return the derivative of the gap by ``x``."""
    ratio = x / fall.radius
    return math.atanh(ratio) + ratio / (1.0 - ratio**2) if fall.is_sphere else 2.0 * ratio


@inner()
def gap_area(fall: Fall, x: float) -> float:
    """Integral of the gap from the centre to ``x`` [m]."""
    r = fall.radius
    ratio = x / r
    if not fall.is_sphere or ratio < 1e-3:
        return x**3 / (3.0 * r) * (1.0 + (0.2 * ratio**2 if fall.is_sphere else 0.0))
    ratio = min(ratio, 0.999999)
    return 0.5 * r * r * ((ratio**2 - 1.0) * math.atanh(ratio) + ratio)


@inner()
def inverse_gap(fall: Fall, depth: float) -> float:
    """Contact radius at which the gap is ``depth`` [m]."""
    if depth <= 0.0:
        return 0.0
    x = math.sqrt(fall.radius * depth)
    if fall.is_sphere:
        x = min(x, 0.99 * fall.radius)
        for _ in range(30):
            change = (gap(fall, x) - depth) / _steepness(fall, x)
            x = min(x - change, 0.5 * (x + 0.999 * fall.radius))
            if abs(change) < 1e-15 * x:
                break
    return x


@inner()
def dented_edge(scheme: Scheme, fall: Fall, room: Room, i: int, depth: float, outer: float, guess: float) -> float:
    """Radius where a surface with dents, out to ``outer``, lies at ``depth``; it rises outwards."""
    if depth <= 0.0:
        return 0.0
    low, high = 0.0, 0.999 * fall.radius
    x = min(max(guess, 1e-6 * outer), high)
    for _ in range(_EDGE_LIMIT):
        inside = 1.0 - (x / outer) ** 2
        s = math.sqrt(inside) if inside > 0.0 else 0.0
        rise = gap(fall, x) + value_at(scheme, room.field[i], s) - depth
        slope = _steepness(fall, x)
        if s > 1e-5:
            slope -= value_at(scheme, room.slope[i], s) * x / (s * outer**2)
        if rise > 0.0:
            high = x
        else:
            low = x
        step = rise / slope if slope > 0.0 else 2.0 * high
        new = x - step
        if not low < new < high:
            new = 0.5 * (low + high)
        if abs(new - x) <= 1e-15 * x:
            return new
        x = new
    return x


@inner()
def receding_edge(
    law: Law, scheme: Scheme, fall: Fall, room: Room, i: int, depth: float, density: float, outer: float, guess: float
) -> float:
    """Place s where the load is 0; 1 when there is none left."""
    last = scheme.s.size - 1
    if law.E_relaxed * depth + room.field[i, last] + density <= 0.0:
        return 1.0
    low, high, s = 0.0, 1.0, guess
    for _ in range(_EDGE_LIMIT):
        x = outer * math.sqrt(max(1.0 - s * s, 0.0))
        load = law.E_relaxed * (depth - gap(fall, x)) + value_at(scheme, room.field[i], s) + density
        slope = 2.0 * s * outer**2 / fall.radius
        if fall.is_sphere and x > 0.0:
            slope = _steepness(fall, x) * s * outer**2 / x
        slope = law.E_relaxed * slope + value_at(scheme, room.slope[i], s)
        if load > 0.0:
            high = s
        else:
            low = s
        new = s - load / slope if slope > 0.0 else 2.0
        if not low < new < high:
            new = 0.5 * (low + high)
        if abs(new - s) <= 1e-15:
            return new
        s = new
    return s
