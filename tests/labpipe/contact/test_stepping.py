"""The time stepper: control of errors, jumps, energy, and histories that try to break it."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from labpipe.contact import indent, indent_load, load_sphere, press_sphere
from labpipe.contact.memory._creep import Creep
from labpipe.contact.springs._bed import sphere_bed
from labpipe.contact.springs._march import March
from labpipe.errors import InputError
from labpipe.materials import Prony
from tests.by_day import by_day

GEOMETRY = (2e-3, 8e-3, 1.0)
SLS = Prony.from_creep(2e9, [0.25e-9], [0.05], nu=0.35)


def wild(terms: int, ratio: float, nu: float = 0.4) -> Prony:
    """Times from 1e-12 to 1e6 s in one material."""
    creep = np.full(terms, (1.0 - 1.0 / ratio) / terms) / 1e6
    return Prony.from_creep(1e6, creep, np.logspace(-12, 6, terms), nu=nu)


def unit_force(depth: float, elements: int = 256) -> float:
    elastic = Prony(1.0, [], [], nu=0.0)
    return float(indent(elastic, *GEOMETRY, [0.0], [depth], elements=elements).force[0])


@pytest.mark.parametrize("ratio", [2.0, 1e2, 1e4])
@pytest.mark.parametrize("terms", [1, 7, 60])
@pytest.mark.parametrize("nu", [0.0, 0.4999])
def test_hold_is_the_modulus_for_any_material(ratio, terms, nu) -> None:
    material = wild(terms, ratio, nu)
    time = np.array([0.0, 1e-9, 1e-6, 1e-3, 1.0, 1e3])
    found = indent(material, *GEOMETRY, time, np.full(6, 1e-4), elements=256)
    exact = unit_force(1e-4) * material.relaxation(time) / (1.0 - nu**2)
    assert np.abs(found.force.values / exact - 1.0).max() < 1e-4


def test_coarse_steps_after_a_jump_stay_positive_and_forget_it() -> None:
    """Uniform steps of 0.5 s on a material a thousand times stiffer at first."""
    material = Prony.from_creep(1e6, np.full(13, (1e-6 - 1e-9) / 13), np.logspace(-10, 2, 13), nu=0.35)
    time = np.arange(0.0, 20.5, 0.5)
    found = indent(material, *GEOMETRY, time, np.full(41, 1e-4), rtol=None, elements=256)
    exact = unit_force(1e-4) * material.relaxation(time) / (1 - 0.35**2)
    error = np.abs(found.force.values / exact - 1.0)
    assert found.force.values.min() > 0.0
    assert error[20] < 2e-4


@settings(max_examples=15, deadline=None)
@given(
    seed=st.integers(0, 100_000),
    terms=st.sampled_from([0, 1, 5, 30]),
    ratio=st.floats(1.1, 1e4),
    thickness=st.sampled_from([np.inf, 1e-3]),
)
def test_random_histories_obey_the_second_law(seed, terms, ratio, thickness) -> None:
    rng = np.random.default_rng(seed)
    material = wild(terms, ratio) if terms else Prony(1e6, [], [], nu=0.4)
    gaps = 10.0 ** rng.uniform(-9, 3, 12) * (rng.random(12) > 0.2)
    time = np.concatenate([[0.0], np.cumsum(gaps)])
    depth = 2e-4 * rng.uniform(-0.5, 1.0, 13)
    found = indent(
        material, *GEOMETRY, time, depth, thickness=thickness, elements=128, rtol=1e-4, outputs=["energy", "pressure"]
    )
    assert np.all(np.isfinite(found.force))
    assert found.force.values.min() >= 0.0
    assert found.pressure.values.min() >= 0.0
    heat = found.dissipated_energy.values
    assert heat[0] >= 0.0
    assert np.diff(heat).min() >= 0.0
    balance = found.work_done - found.stored_energy - found.dissipated_energy
    assert np.abs(balance).max() <= 5e-3 * max(np.abs(found.work_done).max(), 1e-300)


def test_steps_are_counted_and_few() -> None:
    hold = indent(wild(60, 1e4), *GEOMETRY, [0.0, 1e3], [1e-4, 1e-4], elements=256)
    work = json.loads(hold.attrs["work"])
    assert work["solver_steps"] < 2500
    assert work["solves"] < 2 * work["solver_steps"] + 1


@pytest.mark.parametrize("seed", by_day(range(3), 1))
def test_load_and_displacement_control_agree_on_random_loads(seed) -> None:
    rng = np.random.default_rng(seed)
    time = np.concatenate([[0.0], np.cumsum(10.0 ** rng.uniform(-6, 1, 10))])
    load = 2e5 * np.abs(rng.random(11))
    pushed = indent_load(SLS, *GEOMETRY, time, load, elements=256)
    finer = indent_load(SLS, *GEOMETRY, time, load, elements=256, rtol=1e-6)
    difference = np.abs(pushed.displacement - finer.displacement).max()
    assert float(difference) < 1e-4 * float(finer.displacement.max())


def test_a_control_that_cannot_succeed_says_so(monkeypatch) -> None:
    monkeypatch.setattr("labpipe.contact.springs._march._MAX_STEPS_PER_INTERVAL", 5)
    with pytest.raises(InputError, match="larger rtol"):
        indent(wild(5, 1e3), *GEOMETRY, [0.0, 1.0], [1e-4, 1e-4], elements=64)


@pytest.mark.parametrize("rtol", [0.0, -1.0, 1.0, np.nan])
def test_tolerances_outside_their_range_are_refused(rtol) -> None:
    with pytest.raises(InputError, match="rtol"):
        indent(SLS, *GEOMETRY, [0.0], [1e-4], rtol=rtol)


def test_heat_of_a_dashpot_is_the_integral_of_the_load_squared() -> None:
    """Under a load that goes evenly from a to b: (a² + ab + b²)/3 times time and fluidity."""
    creep = Creep.from_terms(1e-9, [], [], fluidity=2e-6)
    march = March(sphere_bed(1e-3, 1e-4, 40), creep, "force", 1e-6)
    old, new = np.full(march.contact.size, 3.0), np.full(march.contact.size, -1.0)
    answer = SimpleNamespace(load=old)
    state = SimpleNamespace(answer=answer, memory=np.zeros((1, march.contact.size)))
    heat = march._heat(0.5, state, new, hold=False)
    one = march.contact.inner(np.ones_like(old), np.ones_like(old))
    assert heat == pytest.approx(creep.fluidity * 0.5 * (9.0 - 3.0 + 1.0) / 3.0 * float(one), rel=1e-6, abs=0.0)


_TAPS = np.linspace(0.0, 2.0, 41)
_HISTORIES = {
    "held": ([0.0, 1.0, 10.0, 100.0], [0.0, 1.0, 1.0, 1.0]),
    "jumps": ([0.0, 0.0, 1.0, 10.0, 10.0, 20.0], [0.0, 1.0, 1.0, 1.0, 0.2, 0.2]),
    "taps": (_TAPS, np.maximum(np.sin(2 * np.pi * _TAPS), 0.0)),
    "coarse": (np.linspace(0.0, 3.0, 13), np.abs(np.sin(1.3 * np.linspace(0.0, 3.0, 13)))),
}
_FEW, _MANY = Prony(1e6, [1e6], [1.0], nu=0.4), Prony(1e5, np.full(8, 3e5), 10.0 ** np.arange(-5, 3), nu=0.4)


@pytest.mark.parametrize("solid", [_FEW, _MANY], ids=["one term", "eight terms"])
@pytest.mark.parametrize("history", sorted(_HISTORIES))
@pytest.mark.parametrize("run", [press_sphere, load_sphere])
def test_the_tolerance_is_the_error_of_what_is_returned(solid, history, run):
    time, value = _HISTORIES[history]
    name, scale = ("force", 1e-4) if run is press_sphere else ("approach", 0.05)
    exact = run(solid, 0.01, time, scale * np.array(value), springs=60, rtol=1e-5)[name].values
    for rtol in (1e-2, 1e-3, 1e-4):
        found = run(solid, 0.01, time, scale * np.array(value), springs=60, rtol=rtol)[name].values
        assert np.abs(found - exact).max() < rtol * np.abs(exact).max()
