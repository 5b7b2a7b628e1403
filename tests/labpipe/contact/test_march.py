"""The time stepper: control of errors, jumps, energy, and histories that try to break it."""

import json

import numpy as np
import pytest

from labpipe.contact import indent, load_sphere, press_sphere
from labpipe.errors import InputError
from labpipe.materials import Prony

GEOMETRY = (2e-3, 8e-3, 1.0)
_SLS = Prony.from_creep(2e9, [0.25e-9], [1e-3], nu=0.35)


def wild(terms: int, ratio: float, nu: float = 0.4) -> Prony:
    """Times from 1e-12 to 1e6 s in one material."""
    creep = np.full(terms, (1.0 - 1.0 / ratio) / terms) / 1e6
    return Prony.from_creep(1e6, creep, np.logspace(-12, 6, terms), nu=nu)


def unit_force(depth: float, elements: int = 256) -> float:
    elastic = Prony(1.0, [], [], nu=0.0)
    return float(indent(elastic, *GEOMETRY, [0.0], [depth], elements=elements).force[0])


@pytest.mark.parametrize(("ratio", "terms", "nu"), [(2.0, 1, 0.0), (1e2, 7, 0.4999), (1e4, 60, 0.0)])
def test_hold_is_the_modulus_for_any_material(ratio, terms, nu) -> None:
    material = wild(terms, ratio, nu)
    time = np.array([0.0, 1e-9, 1e-6, 1e-3, 1.0, 1e3])
    found = indent(material, *GEOMETRY, time, np.full(6, 1e-4), elements=256)
    exact = unit_force(1e-4) * material.relaxation(time) / (1.0 - nu**2)
    assert np.abs(found.force.values / exact - 1.0).max() < 1e-4


def test_steps_are_counted_and_few() -> None:
    hold = indent(wild(60, 1e4), *GEOMETRY, [0.0, 1e3], [1e-4, 1e-4], elements=256)
    work = json.loads(hold.attrs["work"])
    assert work["solver_steps"] < 2500
    assert work["solves"] < 2 * work["solver_steps"] + 1


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
    exact = run(solid, 0.01, time, scale * np.array(value), rtol=1e-5)[name].values
    for rtol in (1e-2, 1e-3, 1e-4):
        found = run(solid, 0.01, time, scale * np.array(value), rtol=rtol)[name].values
        assert np.abs(found - exact).max() < rtol * np.abs(exact).max()


def test_exact_sphere_differs_by_the_known_amount() -> None:
    radius = np.sqrt(9.525e-3 * 7e-5)
    parabola = press_sphere(_SLS, 9.525e-3, [0.0], [7e-5])
    sphere = press_sphere(_SLS, 9.525e-3, [0.0], [7e-5], profile="sphere")
    ratio = float(sphere.force[0] / parabola.force[0])
    assert ratio == pytest.approx(1.0 - 0.1 * (radius / 9.525e-3) ** 2, abs=3e-5)


@pytest.mark.parametrize(("load", "match"), [([1.0, -1.0], r"load\[1\]"), ([1.0, np.nan], r"load\[1\] is nan")])
def test_bad_loads_are_refused_with_the_place(load, match) -> None:
    with pytest.raises(InputError, match=match):
        load_sphere(_SLS, 9.525e-3, [0.0, 1.0], load)


def test_a_contact_as_wide_as_the_sphere_is_refused() -> None:
    with pytest.raises(InputError, match="as wide as the sphere"):
        load_sphere(Prony(1e3, [], [], nu=0.5), 9.525e-3, [0.0], [50.0], profile="sphere")
