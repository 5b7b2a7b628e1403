"""Polynomials of the collocated contact, compiled: their values, roots, and integrals with fading memory."""

import math

from labpipe.arrays import Floats
from labpipe.compilation import inner
from labpipe.contact.impact._records import Law, Scheme


@inner()
def moments(z: float, out: Floats) -> None:
    """Integrals of u^p exp(-z (1 - u)) over u from 0 to 1, p = 0 ... (power,)."""
    n = out.size
    if z > 6.0:
        out[0] = -math.expm1(-z) / z
        for p in range(1, n):
            out[p] = (1.0 - p * out[p - 1]) / z
        return
    term = 1.0 / n
    total = term
    k = n
    while abs(term) > 1e-18:
        k += 1
        term *= -z / k
        total += term
    out[n - 1] = total
    for p in range(n - 1, 0, -1):
        out[p - 1] = (1.0 - z * out[p]) / p


@inner()
def value_at(scheme: Scheme, values: Floats, s: float) -> float:
    """Value at ``s`` of the polynomial with ``values`` (node,) at the nodes."""
    top = bottom = 0.0
    for n in range(scheme.s.size):
        away = s - scheme.s[n]
        if away == 0.0:
            return values[n]
        share = scheme.bary[n] / away
        top += share * values[n]
        bottom += share
    return top / bottom


@inner()
def dot(left: Floats, right: Floats) -> float:
    """Scalar product of two short rows."""
    total = 0.0
    for i in range(left.size):
        total += left[i] * right[i]
    return total


@inner()
def power_sum(coefficients: Floats, u: float) -> float:
    """Polynomial without constant term."""
    total = 0.0
    for p in range(coefficients.size - 1, -1, -1):
        total = (total + coefficients[p]) * u
    return total


@inner()
def fade(law: Law, start: Floats, h: float, u: float, powers: Floats, out: Floats, room: Floats) -> None:
    """Fading integrals (maxwell,) a part ``u`` of a step on, from those at its start."""
    for j in range(law.maxwells):
        z = law.rate[j] * h * u
        moments(z, room)
        total, power = 0.0, u
        for p in range(powers.size):
            total += (p + 1) * powers[p] * power * room[p]
            power *= u
        out[j] = math.exp(-z) * start[j] + total


@inner()
def eliminate(matrix: Floats, right: Floats) -> None:
    """Gaussian elimination in place; the solution replaces ``right`` (stage, column)."""
    n = matrix.shape[0]
    for i in range(n):
        best = i
        for r in range(i + 1, n):
            if abs(matrix[r, i]) > abs(matrix[best, i]):
                best = r
        for c in range(n):
            matrix[i, c], matrix[best, c] = matrix[best, c], matrix[i, c]
        for c in range(right.shape[1]):
            right[i, c], right[best, c] = right[best, c], right[i, c]
        for r in range(i + 1, n):
            factor = matrix[r, i] / matrix[i, i]
            for c in range(i, n):
                matrix[r, c] -= factor * matrix[i, c]
            for c in range(right.shape[1]):
                right[r, c] -= factor * right[i, c]
    for i in range(n - 1, -1, -1):
        for c in range(right.shape[1]):
            for k in range(i + 1, n):
                right[i, c] -= matrix[i, k] * right[k, c]
            right[i, c] /= matrix[i, i]


@inner()
def slope(coefficients: Floats, u: float) -> float:
    total = 0.0
    for p in range(coefficients.size - 1, -1, -1):
        total = total * u + (p + 1) * coefficients[p]
    return total


@inner()
def crossing(coefficients: Floats, value: float, highest: float) -> float:
    """First u up to ``highest`` at which the polynomial, rising or falling to it, has a value."""
    rises = value > 0.0
    low = high = 0.0
    for look in range(1, 9):
        high = highest * look / 8.0
        if (power_sum(coefficients, high) >= value) == rises:
            break
        low = high
    for _ in range(50):
        middle = 0.5 * (low + high)
        if (power_sum(coefficients, middle) >= value) == rises:
            high = middle
        else:
            low = middle
    return 0.5 * (low + high)


@inner()
def summit(coefficients: Floats) -> float:
    """Part u of the step at which the polynomial first stops rising; 1 when it does not."""
    low, high = 0.0, 1.0
    for look in range(1, 17):
        high = look / 16.0
        if slope(coefficients, high) <= 0.0:
            break
        low = high
    if low == 1.0:
        return 1.0
    for _ in range(45):
        middle = 0.5 * (low + high)
        if slope(coefficients, middle) > 0.0:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)
