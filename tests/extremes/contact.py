"""Extreme cases of contact mechanics, each checked against an independent method.

Every family is a function of a random generator. It makes one case far outside the ordinary, asks
for the answer, and returns how far that is from an independent one in units of what is allowed. A
refusal (:class:`~labpipe.errors.InputError`) is an answer too; anything else that is raised is a
defect and is let through.
"""

from collections.abc import Mapping
from math import pi
from typing import Any

import numpy as np

from labpipe import contact
from labpipe.arrays import Floats
from labpipe.contact._memory import Creep, advance, history, step_weights
from labpipe.contact.line import dissipation, westergaard
from labpipe.contact.sphere import hertz
from labpipe.materials import Prony
from tests.extremes.inputs import Random, below_zero, extreme_material, extreme_times
from tests.extremes.outcome import Case, Outcome, worst
from tests.labpipe.contact.ting_solution import ting

_QUADRATURE = np.polynomial.legendre.leggauss(12)


# -- springs and steppers --------------------------------------------------------------------------


def memory_of_a_spring(random: Random) -> Outcome:
    """Compare, for loads linear in time, the recursion with the hereditary integral."""
    creep = Creep.of(extreme_material(random))
    time = extreme_times(random, int(random.integers(2, 25)))
    load = random.uniform(0.0, 1.0, time.size)
    memory, past = creep.rest(1), np.array([0.0])
    weights = step_weights(creep, 0.0)
    for n, now in enumerate(time):
        weights = step_weights(creep, float(now - time[n - 1]) if n else 0.0)
        unloaded = history(weights, memory, past)
        memory = advance(weights, memory, past, load[n : n + 1])
        past = load[n : n + 1]
    found = float(unloaded[0] + weights.compliance * load[-1])
    exact = _hereditary(creep, time, load)
    return Outcome(abs(found / exact - 1.0) / 1e-12, "relative error of a displacement 1e-12")


def _hereditary(creep: Creep, time: Floats, load: Floats) -> float:
    """Displacement at the last time by integrating ``J(t - s) dq(s)`` over the linear segments."""
    end = float(time[-1])
    jumps = np.diff(load)
    total = creep.instantaneous * float(load[-1])
    lag = (end - time)[:, None] / creep.tau
    # The first load is a jump at the first time.
    total += float(load[0] * (creep.C @ -np.expm1(-lag[0])))
    for n, jump in enumerate(jumps):
        span = float(time[n + 1] - time[n])
        if span == 0.0:
            total += float(jump * (creep.C @ -np.expm1(-lag[n])))
            continue
        total += float(jump * (creep.C @ _mean_creep(lag[n + 1], span / creep.tau)))
    return total


def _mean_creep(lag: Floats, span: Floats) -> Floats:
    """Mean of ``1 - exp(-s)`` over a span that ends at a lag (all in units of tau)."""
    nodes, weights = _QUADRATURE
    points = lag[:, None] + 0.5 * span[:, None] * (1.0 + nodes)
    smooth = 0.5 * (-np.expm1(-points) @ weights)
    direct = 1.0 + np.exp(-lag) * np.expm1(-span) / span
    return np.where(span < 1.0, smooth, direct)


def relaxation_of_a_sphere(random: Random) -> Outcome:
    """Step and hold: the force is the elastic one times E(t)/E(0), at any time."""
    material = extreme_material(random, 20)
    radius = 10 ** random.uniform(-4, 0)
    depth = radius * 10 ** random.uniform(-8, -2)
    time = np.concatenate([[0.0], np.sort(10 ** random.uniform(-12, 6, 12))])
    found = contact.press_sphere(material, radius, time, np.full(13, depth), springs=24, rtol=1e-4).force.values
    exact = found[0] * material.relaxation(time) / material.E_unrelaxed
    errors = np.abs(found / exact - 1.0)
    return worst(
        (float(errors.max()) / 5e-3, "relative error of a relaxed force 5e-3 at rtol = 1e-4"),
        (-float(found.min()) / max(exact.max(), 1e-300), "a force below zero"),
    )


def rise_and_fall(random: Random) -> Outcome:
    """One triangle or half sine of approach against Ting's integral."""
    material = extreme_material(random, 8)
    radius = 10 ** random.uniform(-4, 0)
    depth = radius * 10 ** random.uniform(-7, -2)
    span = 10 ** random.uniform(-6, 4)
    time = np.linspace(0.0, span, 41)
    if random.random() < 0.5:
        peak = random.uniform(0.15, 0.85) * span
        approach = np.interp(time, [0.0, peak, span], [0.0, depth, 0.0])
    else:
        approach = depth * np.sin(pi * time / span)
        approach[-1] = 0.0
    exact = ting(material, radius, time, approach).force
    found = contact.press_sphere(material, radius, time, approach).force.values
    error = float(np.abs(found - exact).max() / exact.max())
    return worst(
        (error / 1e-3, "error of a sphere's force 1e-3 of the peak"),
        (-float(found.min()) / exact.max(), "a force below zero"),
    )


# -- the periodic line -----------------------------------------------------------------------------


def elastic_line(random: Random) -> Outcome:
    """Any modulus, tip and period, from a few strips to nearly full contact: the closed form."""
    modulus, nu = 10 ** random.uniform(3, 12), float(random.uniform(0.0, 0.4999))
    period = 10 ** random.uniform(-6, 0)
    radius = period * 10 ** random.uniform(-0.5, 3)
    profile = str(random.choice(["parabola", "cosine"]))
    share = float(random.uniform(0.06, 0.47))
    reduced = modulus / (1.0 - nu**2)
    exact = westergaard.from_half_width(share * period, radius, period, reduced, profile)  # type: ignore[arg-type]
    solid = Prony(modulus, [], [], nu=nu)
    options: dict[str, Any] = {"profile": profile, "elements": 256}
    pressed = contact.indent(
        solid, radius, period, 1.0, [0.0], [float(exact.displacement)], outputs=("pressure",), **options
    )
    pushed = contact.indent_load(solid, radius, period, 1.0, [0.0], [float(exact.force)], **options)
    force = abs(float(pressed.force[0]) / float(exact.force) - 1.0)
    width = abs(float(pressed.contact_half_width[0]) / period - share) * 256
    depth = abs(float(pushed.displacement[0]) / float(exact.displacement) - 1.0)
    return worst(
        (force / 5e-5, "relative error of a line's force 5e-5"),
        (width / 0.05, "error of a half width 0.05 strips"),
        (depth / 5e-5, "relative error of a line's approach 5e-5"),
        (-float(pressed.pressure.min()), "a pressure below zero"),
    )


def line_history(random: Random) -> Outcome:
    """Press by a hostile history: second law, no negative pressure, finer steps agree."""
    material = extreme_material(random, 30)
    time = extreme_times(random, int(random.integers(2, 7)))
    thickness = float(random.choice([np.inf, 1e-3]))
    deepest = min(10 ** random.uniform(-6, -3.2), 0.3 * thickness)
    depth = deepest * random.uniform(-0.5, 1.0, time.size)
    profile = str(random.choice(["parabola", "circle", "cosine"]))

    def run(rtol: float) -> Any:
        return contact.indent(
            material, 2e-3, 8e-3, 1.0, time, depth, profile, thickness, 128, rtol=rtol, outputs=("energy", "pressure")
        )

    found, finer = run(1e-3), run(1e-5)
    force = found.force.values
    scale = max(float(force.max()), 1e-300)
    heat = found.dissipated_energy.values
    return worst(
        (
            float(np.abs(finer.force.values - force).max()) / scale / 5e-3,
            "difference to a hundredfold tolerance 5e-3 of the peak",
        ),
        (below_zero(found.pressure.values), "a pressure below zero"),
        (below_zero(force), "a force below zero"),
        (below_zero(np.diff(heat, prepend=0.0)), "dissipation that falls"),
        (0.0 if np.all(np.isfinite(force)) else np.inf, "a force that is no number"),
    )


def line_loads(random: Random) -> Outcome:
    """Push by a hostile history of load; pressing by the approach found gives the load again."""
    material = extreme_material(random, 12)
    time = extreme_times(random, int(random.integers(2, 6)))
    radius, period = 2e-3, 8e-3
    # The softest answer stays far from full contact.
    softest = float(Creep.of(material).compliance(float(time[-1])))
    most = 0.3 * period**2 / (16.0 * pi * radius * softest)
    load = most * np.maximum(random.uniform(-0.3, 1.0, time.size), 0.0)
    pushed = contact.indent_load(
        material, radius, period, 1.0, time, load, elements=128, rtol=1e-5, outputs=("energy",)
    )
    depth = pushed.displacement.values
    jumps = time[np.flatnonzero(np.diff(time) == 0.0)]
    first = contact.indent(material, radius, period, 1.0, time[:1], depth[:1], elements=128, rtol=1e-5)
    miss = abs(float(first.force[0]) - load[0]) / max(float(load.max()), 1e-300)
    return worst(
        (miss / 1e-6, "a first load that is missed by 1e-6 of the largest"),
        (below_zero(np.diff(pushed.dissipated_energy.values, prepend=0.0)), "dissipation that falls"),
        (0.0 if np.all(np.isfinite(depth)) or jumps.size else np.inf, "an approach that is not finite"),
    )


# -- closed forms ----------------------------------------------------------------------------------


def inverse_closed_forms(random: Random) -> Outcome:
    """Approach and width of the closed forms lead back to one another."""
    period, radius = 10 ** random.uniform(-6, 0), 10 ** random.uniform(-6, 0)
    reduced = 10 ** random.uniform(3, 12)
    profile: Any = str(random.choice(["parabola", "cosine"]))
    share = 0.5 * random.uniform(1e-6, 0.999)
    state = westergaard.from_half_width(share * period, radius, period, reduced, profile)
    by_depth = westergaard.from_displacement(state.displacement, radius, period, reduced, profile)
    load = 10 ** random.uniform(-9, 6)
    sphere = hertz.static_load(load, radius, reduced)
    again = hertz.static_approach(sphere.approach, radius, reduced)
    return worst(
        (abs(float(by_depth.force / state.force) - 1.0) / 1e-6, "force by the approach 1e-6"),
        (abs(float(again.force) / load - 1.0) / 1e-12, "Hertz there and back 1e-12"),
    )


def harmonic_work(random: Random) -> Outcome:
    """Dissipated work is not negative and the tapping front falls with the frequency."""
    material = extreme_material(random)
    frequency = np.sort(10 ** random.uniform(-9, 12, 30))
    geometry = (1e-4 * random.uniform(0.01, 3.0), 2e-3, 8e-3)
    work = dissipation.dissipated_work(material, frequency, 1e-6, *geometry)
    front = dissipation.tapping_amplitude(material, frequency, *geometry)
    ratio = material.E_unrelaxed / material.E_relaxed
    return worst(
        (below_zero(work), "dissipated work below zero"),
        (float(np.diff(front).max()) / float(front.max()) / 1e-12, "a front that rises by 1e-12"),
        ((float(front[0] / front[-1]) / ratio - 1.0) / 1e-9, "a front beyond the two moduli 1e-9"),
    )


# -- invalid input ----------------------------------------------------------------------------

_BAD = (np.nan, np.inf, -np.inf, -1.0, 0.0)
_SOLID = Prony(2e9, [2e9], [0.5e-3], nu=0.35)
_DROP: Mapping[str, float] = {
    "radius": 0.01,
    "mass": 0.5,
    "height": 1e-3,
    "duration": 0.02,
    "gravity": 9.81,
    "rtol": 1e-3,
    "ring_width": 1e-5,
}
_INDENT: Mapping[str, float] = {"tip_radius": 2e-3, "period": 8e-3, "depth": 1.0, "thickness": 1e-3, "rtol": 1e-3}
_COLLISION: Mapping[str, float] = {
    "radius": 0.01,
    "mass": 0.5,
    "height": 1e-3,
    "duration": 0.02,
    "gravity": 9.81,
    "youngs_modulus": 3e9,
    "nu": 0.3,
    "damping": 1e4,
    "yield_depth": 1e-5,
    "unloading_multiplier": 2.0,
}
#: Values that are no mistake although they stand in the list of bad ones.
_LEGAL = {
    ("drop", "height", 0.0),
    ("indent", "thickness", np.inf),
    ("collision", "nu", 0.0),
    ("collision", "damping", 0.0),
    ("collision", "yield_depth", np.inf),
}


def input_that_is_none(random: Random) -> Outcome:
    """One argument is NaN, infinite, negative or zero, or one sample of a history is."""
    bad = float(random.choice(_BAD))
    which = str(random.choice(["drop", "indent", "collision", "history"]))
    if which == "history":
        return _bad_history(random)
    values = dict({"drop": _DROP, "indent": _INDENT, "collision": _COLLISION}[which])
    name = str(random.choice(list(values)))
    if (which, name, bad) in _LEGAL:
        return Outcome(0.0, "")
    values[name] = bad
    if which == "drop":
        contact.drop(_SOLID, solver="rings", **values)  # type: ignore[arg-type]
    elif which == "collision":
        contact.collision(**values)  # type: ignore[arg-type]
    else:
        contact.indent(_SOLID, time=[0.0, 1.0], displacement=[0.0, 1e-5], elements=64, **values)  # type: ignore[arg-type]
    return Outcome(np.inf, f"{which} took {name} = {bad}")


def _bad_history(random: Random) -> Outcome:
    time, value = np.sort(random.random(8)), 1e-5 * random.random(8)
    place = int(random.integers(0, 8))
    kind = str(random.choice(["gap", "no time", "backwards", "shorter", "empty"]))
    if kind == "gap":
        value[place] = random.choice([np.nan, np.inf])
    elif kind == "no time":
        time[place] = np.nan
    elif kind == "backwards":
        time[place] += -2.0 if place else 2.0
    elif kind == "shorter":
        value = value[: place + 0]
    else:
        time, value = time[:0], value[:0]
    sphere = random.random() < 0.5
    if sphere:
        call: Any = contact.press_sphere if random.random() < 0.5 else contact.load_sphere
        call(_SOLID, 0.01, time, value)
    else:
        call = contact.indent if random.random() < 0.5 else contact.indent_load
        call(_SOLID, 2e-3, 8e-3, 1.0, time, value, elements=64)
    return Outcome(np.inf, f"a history with the fault: {kind}")


#: Families and how many of their cases the tests try.
FAMILIES: Mapping[str, tuple[Case, int]] = {
    "memory of a spring": (memory_of_a_spring, 400),
    "relaxation of a sphere": (relaxation_of_a_sphere, 30),
    "rise and fall of a sphere": (rise_and_fall, 4),
    "elastic line": (elastic_line, 135),
    "history of a line": (line_history, 6),
    "loads on a line": (line_loads, 6),
    "closed forms": (inverse_closed_forms, 350),
    "harmonic work": (harmonic_work, 200),
    "invalid input": (input_that_is_none, 600),
}
