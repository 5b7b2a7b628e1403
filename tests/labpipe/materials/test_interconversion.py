"""The conversion between relaxation and retardation terms, against 80-digit arithmetic."""

from decimal import Decimal, localcontext

import numpy as np
import pytest

from labpipe.materials.prony._interconversion import (
    Relaxation,
    Retardation,
    creep_from_relaxation,
    relaxation_from_creep,
)
from tests.rounding import rounding

DIGITS = 80


def exact_partner(constant, weight, poles):
    """Roots x of constant + Σ w x/(x − p) = 0 and weights 1/Σ w x p/(x − p)², in 80 digits.

    Plain bisection of the logarithm of the distance to the nearer pole, then Newton.
    """
    constant = Decimal(constant)
    roots, weights = [], []

    def value(x):
        return constant + sum(w * x / (x - p) for w, p in zip(weight, poles, strict=True))

    def slope(x):
        return -sum(w * p / (x - p) ** 2 for w, p in zip(weight, poles, strict=True))

    for k in range(len(poles)):
        low = poles[k - 1] if k else Decimal(0)
        half = (poles[k] - low) / 2
        sign = -1 if value(low + half) > 0 else 1
        origin = poles[k] if sign < 0 else low
        shallow, deep = Decimal(0), Decimal(-70)
        for _ in range(12):
            middle = (shallow + deep) / 2
            is_above = value(origin + sign * half * Decimal(10) ** middle) > 0
            if is_above == (sign > 0):
                deep = middle
            else:
                shallow = middle
        distance = half * Decimal(10) ** ((shallow + deep) / 2)
        for _ in range(12):
            x = origin + sign * distance
            g = distance * value(x)
            distance -= g / (value(x) + sign * distance * slope(x))
        x = origin + sign * distance
        roots.append(x)
        weights.append(1 / sum(w * x * p / (x - p) ** 2 for w, p in zip(weight, poles, strict=True)))
    return roots, weights


def worst(found, exact):
    """Largest relative error against decimals."""
    return max(abs(float((Decimal(float(f)) - e) / e)) for f, e in zip(found, exact, strict=True))


def decimals(values):
    return [Decimal(float(v)) for v in values]


def error_of_creep(solid):
    with localcontext() as context:
        context.prec = DIGITS
        rates = [1 / t for t in decimals(solid.time[::-1])]
        roots, weights = exact_partner(solid.relaxed, decimals(solid.weight[::-1]), rates)
        found = creep_from_relaxation(solid)
        times = [1 / x for x in roots[::-1]]
        return worst(found.time, times), worst(found.weight, weights[::-1])


def error_of_relaxation(solid):
    with localcontext() as context:
        context.prec = DIGITS
        roots, weights = exact_partner(solid.unrelaxed, decimals(solid.weight), decimals(solid.time))
        found = relaxation_from_creep(solid)
        return worst(found.time, roots), worst(found.weight, weights)


def lost(terms):
    """Every time and weight is found from sums over all terms, some twenty operations each."""
    return rounding(20 * terms)


def broad(terms, decades):
    time = np.logspace(-10, -10 + decades, terms)
    return time, 1e8 * np.exp(-0.5 * ((np.log10(time) + 3) / 4) ** 2)


def weak_third(terms, decades):
    time, weight = broad(terms, decades)
    weight[::3] *= 1e-10
    return time, weight


def six_decades(terms, decades):
    time, _ = broad(terms, decades)
    return time, 10 ** np.random.default_rng(7).uniform(3, 9, terms)


@pytest.mark.parametrize("terms", [broad, weak_third, six_decades])
def test_every_time_and_weight_agrees_with_eighty_digits_both_ways(terms):
    time, weight = terms(43, 14)
    solid = Relaxation(1e6, weight, time)
    assert max(error_of_creep(solid)) < lost(43)
    assert max(error_of_relaxation(creep_from_relaxation(solid))) < lost(43)


def test_a_liquid_flows_and_no_instantaneous_compliance_is_a_dashpot_each_with_one_term_fewer():
    liquid = Relaxation(0.0, np.array([1.0, 2.0]), np.array([1.0, 10.0]))
    soft = Retardation(0.0, np.array([1.0, 2.0]), np.array([1.0, 5.0]))
    creep, family = creep_from_relaxation(liquid), relaxation_from_creep(soft)
    assert creep.fluidity == pytest.approx(1 / 21)
    assert family.viscosity == pytest.approx(1 / 1.4)
    assert creep.time.size == family.time.size == 1
    for given, back in ((liquid, relaxation_from_creep(creep)), (soft, creep_from_relaxation(family))):
        np.testing.assert_allclose(back.weight, given.weight, rtol=lost(2))
        np.testing.assert_allclose(back.time, given.time, rtol=lost(2))
