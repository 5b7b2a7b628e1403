"""Identification of random known materials: bias, coverage, width of intervals.

Truths come by a way of their own, and not from the prior: fractional solids (Cole and Cole's, Havriliak
and Negami's) with orders and strengths as published of polymers, which no sum of exponentials
equals. Forces of a hold come from the exact mean of the relaxation function over a ramp, bounces from the
virtual rig's dense reference. Every error that the problem leaves unknown (gain, tare, height, mass,
radius, trigger) is drawn from what is stated of it. The Cramér–Rao bound is that of Bayes (van
Trees): the inverse of the data's information and that of the prior.
"""

import time as clock
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.stats import norm

from labpipe import identification
from labpipe.arrays import Floats
from pipelines.bench.measure import Point, Suite
from pipelines.rig.reference_drop import CONTACT_STEP, reference_drop
from pipelines.rig.solids import Element, Viscoelastic

_Range = tuple[float, float]

_SEED = 4000
_HOLDS, _FEW_HOLDS = 100, 20
_DROPS = 100  # ten seconds each; the quick run leaves them out
_SURE = float(norm.ppf(0.975))
_RAMP, _HOLD, _AREA = 0.1, 600.0, 1.6e-6  # s, s, m2
_NOISE, _GAIN, _TARE = 2e-3, 5e-3, 5e-3  # relative, relative, N
_RADIUS, _MASS, _HEIGHT = 9.525e-3, 0.505, 1.5e-3
_U_RADIUS, _U_MASS, _U_HEIGHT = 5e-6, 5e-4, 5e-6
_U_TOUCH, _U_DURATION = 5e-6, 9e-6  # s
_BOUNCES, _RECORD = 6, 0.26  # s
_CONTACT = 1e3  # Hz, about that of an impact


class Trial(NamedTuple):
    """One truth: error over stated deviation, that deviation, and its bound, of every quantity."""

    deviation: dict[str, float]
    width: dict[str, float]
    bound: dict[str, float]
    verdict: str
    is_right: bool
    seconds: float


def random_solid(seed: int, *, is_rubber: bool) -> Viscoelastic:
    """Draw a polymer: a rubber of some megapascals or a glass of some gigapascals.

    A glass has three secondary dispersions, the loss factor at 1 kHz lies between 0.01 and 0.08; a
    rubber has its glass transition far below a millisecond and two slow dispersions. Those of even
    seeds are symmetric (Cole and Cole's); those of odd ones end steeply on one side, as Havriliak and Negami's.
    """
    rng = np.random.default_rng(seed)
    is_skewed = not is_symmetric(seed)
    if is_rubber:
        relaxed = 10.0 ** rng.uniform(6.3, 7.5)
        glass = _dispersion(relaxed, rng, (-9.0, -5.0), (1.5, 2.5), is_skewed=is_skewed)
        slow = [_dispersion(relaxed, rng, (-3.0, 3.0), (-1.5, -0.3), is_skewed=is_skewed) for _ in range(2)]
        return Viscoelastic((glass, *slow), relaxed, 0.5)
    relaxed = 10.0 ** rng.uniform(8.8, 9.5)
    while True:
        parts = [_dispersion(relaxed, rng, (-8.0, 2.0), (-1.5, 0.0), is_skewed=is_skewed) for _ in range(3)]
        solid = Viscoelastic(tuple(parts), relaxed, 0.35)
        modulus = complex(solid.modulus(_CONTACT))
        if 0.01 < modulus.imag / modulus.real < 0.08:
            return solid


def is_symmetric(seed: int) -> bool:
    """Tell whether the dispersions of the polymer of a seed are symmetric."""
    return seed % 2 == 0


def _dispersion(
    relaxed: float, rng: np.random.Generator, centres: _Range, strengths: _Range, *, is_skewed: bool
) -> Element:
    """Return a random dispersion; centres and strengths over ``relaxed`` are decadic logarithms.

    Secondary and primary dispersions of polymers have orders of 0.2 to 0.6; skewed ones are drawn
    a little broader on their other side.
    """
    order, skew = rng.uniform(0.2, 0.6), rng.uniform(0.3, 0.8)
    time, strength = 10.0 ** rng.uniform(*centres), relaxed * 10.0 ** rng.uniform(*strengths)
    return Element(strength, time, min(order / skew**0.5, 0.8), skew) if is_skewed else Element(strength, time, order)


def run(quick: bool) -> Suite:
    """Identify random truths and count; few of them in a quick run."""
    holds = _FEW_HOLDS if quick else _HOLDS
    points = _both_kinds("hold", [hold_trial(_SEED + i) for i in range(holds)])
    if not quick:
        points += _both_kinds("drop", [drop_trial(_SEED + i) for i in range(_DROPS)])
    return Suite(
        "identification",
        "Identification of random known materials from synthetic observations",
        "RMS error over the stated uncertainty",
        points,
        notes=(
            "bound: that of van Trees for the most probable structure of the spectrum, at its most probable point; the "
            "stated uncertainty includes that of the structure; coverage of 95 % intervals",
            f"holds of {_HOLD:g} s of rubbers; {_BOUNCES + 1} touches of glassy spheres, "
            f"{_HEIGHT * 1e3:g} mm" + (" (left out of the quick run)" if quick else ""),
        ),
        has_diagram=False,
    )


def _both_kinds(name: str, trials: list[Trial]) -> list[Point]:
    """Return the points of all truths, and those of symmetric and of skewed dispersions apart."""
    symmetric = [t for i, t in enumerate(trials) if is_symmetric(_SEED + i)]
    skewed = [t for i, t in enumerate(trials) if not is_symmetric(_SEED + i)]
    return [
        *_moduli_points(f"{name}, symmetric dispersions", symmetric),
        *_moduli_points(f"{name}, skewed dispersions", skewed),
        *_points(name, trials),
    ]


def _moduli_points(name: str, trials: list[Trial]) -> list[Point]:
    points = []
    for quantity in trials[0].deviation:
        errors = np.array([t.deviation[quantity] for t in trials])
        widths = np.array([t.width[quantity] for t in trials])
        bounds = np.array([t.bound[quantity] for t in trials])
        points.append(
            Point(
                f"{name}: {quantity}",
                float(np.sqrt(np.mean(errors**2))),
                float(np.median([t.seconds for t in trials])),
                is_default=True,
                extra={
                    "truths": len(trials),
                    "coverage (%)": 100.0 * float(np.mean(np.abs(errors) < _SURE)),
                    "bias over uncertainty": float(np.mean(errors)),
                    "uncertainty over bound, median": float(np.median(widths / bounds)),
                    "standard uncertainty, median (%)": 100.0 * float(np.median(widths)),
                },
            )
        )
    return points


def _points(name: str, trials: list[Trial]) -> list[Point]:
    points = _moduli_points(name, trials)
    right = float(np.mean([t.is_right for t in trials]))
    said = float(np.mean([t.verdict == "identified" for t in trials]))
    shares = {"limits hold the truth (%)": 100.0 * right, "called identified (%)": 100.0 * said}
    extra = {"truths": len(trials), **shares}
    points.append(Point(f"{name}: verdict on E_relaxed", 1.0 - right, float("nan"), is_default=True, extra=extra))
    return points


def hold_trial(seed: int) -> Trial:
    """Identify one rubber from a hold with an uncertain gain and zero."""
    solid = random_solid(seed, is_rubber=True)
    rng = np.random.default_rng(seed + 1)
    lag = np.geomspace(0.2, _HOLD, 42)
    end = lag + _RAMP
    clean = (end * solid.mean_relaxation(end) - lag * solid.mean_relaxation(lag)) / _RAMP
    clean *= _AREA / (1.0 - solid.nu**2)
    u = _NOISE * clean
    force = clean * (1.0 + _GAIN * rng.standard_normal()) + _TARE * rng.standard_normal()
    force += u * rng.standard_normal(lag.size)
    data = float(lag[0]), float(lag[-1])
    spectrum = identification.SmoothSpectrum(identification.relaxation_times(*data), solid.nu)
    time = np.concatenate([np.linspace(0.0, _RAMP, 41), _RAMP + lag])
    area = _AREA * np.minimum(time / _RAMP, 1.0)

    def rebuilt(rho: Floats) -> tuple[identification.Evidence, ...]:
        basis = identification.lee_radok_basis(time, area, rho, solid.nu)[41:]
        return (identification.force_evidence("hold", lag, force, u, basis, factors=("gain",), offsets=("tare",)),)

    unknowns = (
        identification.Parameter("gain", 1.0, _GAIN, "1", "gain", is_nuisance=True),
        identification.Parameter("tare", 0.0, _TARE, "N", "tare", is_nuisance=True),
    )
    frequency = np.array([3e-3, 3e-2, 3e-1])
    problem = identification.Problem(spectrum, rebuilt(spectrum.rho), unknowns)
    return _trial(problem, rebuilt, solid, frequency)


def drop_trial(seed: int) -> Trial:
    """Identify one glassy polymer from a few bounces, and follow its long-time modulus."""
    solid = random_solid(seed, is_rubber=False)
    rng = np.random.default_rng(seed + 1)
    radius, mass, height = (
        best + u * rng.standard_normal() for best, u in ((_RADIUS, _U_RADIUS), (_MASS, _U_MASS), (_HEIGHT, _U_HEIGHT))
    )
    made = reference_drop(solid, radius=radius, mass=mass, height=height, duration=_RECORD)
    count = min(_BOUNCES + 1, made.liftoff.size)
    touch = made.touch[:count] + _U_TOUCH * rng.standard_normal(count)
    # the reference tells the end of the step in which the sphere left
    left = made.liftoff[:count] - 0.5 * CONTACT_STEP
    duration = left - made.touch[:count] + _U_DURATION * rng.standard_normal(count)
    none = np.full(count, np.nan)
    seen = identification.Bounces(
        touch - touch[0], np.full(count, _U_TOUCH), duration, np.full(count, _U_DURATION), none, none
    )
    unknowns = tuple(
        identification.Parameter(name, mean, u, unit, name, is_nuisance=True)
        for name, mean, u, unit in (
            ("radius", _RADIUS, _U_RADIUS, "m"),
            ("mass", _MASS, _U_MASS, "kg"),
            ("height", _HEIGHT, _U_HEIGHT, "m"),
            ("trigger", 0.0, _U_TOUCH, "s"),
        )
    )
    empty = np.empty(0, dtype=np.int64)
    model = identification.DropModel(
        _RADIUS, _MASS, _HEIGHT, 9.81, empty, empty, empty, 0.0, 0.0, {p.name: p.name for p in unknowns}
    )
    evidence = identification.drop_evidence("drop", seen, model)
    data = evidence.model.window
    spectrum = identification.SmoothSpectrum(identification.relaxation_times(*data), solid.nu)
    frequency = np.array([0.5 / float(np.median(duration))])
    problem = identification.Problem(spectrum, (evidence,), unknowns)
    return _trial(problem, lambda _: (evidence,), solid, frequency)


def _trial(
    problem: identification.Problem,
    rebuilt: Callable[[Floats], tuple[identification.Evidence, ...]],
    solid: Viscoelastic,
    frequency: Floats,
) -> Trial:
    started = clock.perf_counter()
    known = identification.infer(problem, rebuilt)
    seconds = clock.perf_counter() - started
    found = identification.moduli(known, frequency)
    exact = solid.modulus(frequency)
    bounds = np.sqrt(np.diag(known.covariance_of(found.derivatives)))
    deviation, width, bound = {}, {}, {}
    names = [f" at {f:.3g} Hz" for f in frequency] if frequency.size > 1 else [" of the contact"]
    for i, at in enumerate(names):
        for text, value, u, least, true in (
            ("storage modulus", found.storage[i], found.u_ln_storage[i], bounds[i], exact.real[i]),
            (
                "loss factor",
                found.loss_factor[i],
                found.u_ln_loss_factor[i],
                bounds[frequency.size + i],
                exact.imag[i] / exact.real[i],
            ),
        ):
            deviation[text + at] = float(np.log(value / true) / u)
            width[text + at] = float(u)
            bound[text + at] = float(least)
    relaxed = identification.long_time_modulus(known)
    is_right = relaxed.low <= solid.relaxed <= relaxed.high
    return Trial(deviation, width, bound, relaxed.verdict, is_right, seconds)
