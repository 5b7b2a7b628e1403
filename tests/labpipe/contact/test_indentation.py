"""Indentation against the closed forms and tables of a periodic line contact."""

import numpy as np
import pytest

from labpipe.contact import indent
from labpipe.contact.line import westergaard
from labpipe.errors import InputError
from labpipe.materials import Prony

RADIUS, PERIOD = 2e-3, 8e-3
SLS = Prony.from_creep(2e9, [1 / 2e9 - 1 / 4e9], [0.05], nu=0.35)
PMMA15 = Prony.from_creep(2e9, np.full(15, (1 / 2e9 - 1 / 6e9) / 15), np.logspace(-10, 2, 15), nu=0.35)

# Tapping: time, SLS force, SLS width, PMMA force, PMMA width (per depth; width in periods).
TAPPING = [
    (0.25, 76097.57, 0.029436, 62947.81, 0.029436),
    (0.40, 347012.22, 0.072878, 371090.50, 0.072878),
    (0.50, 393383.73, 0.081384, 454242.82, 0.081384),
    (0.60, 280053.48, 0.069640, 352210.99, 0.072386),
    (0.70, 93998.13, 0.040454, 141573.81, 0.046286),
    (1.50, 393383.73, 0.081384, 450569.04, 0.081384),
]


def elastic(nu: float = 0.0, modulus: float = 1.0) -> Prony:
    return Prony(modulus, [], [], nu=nu)


def tapping(material: Prony, per_cycle: int = 400):
    time = np.linspace(0.0, 2.0, 2 * per_cycle + 1)
    displacement = 2e-4 * (0.2 - 0.8 * np.cos(2 * np.pi * time))
    return indent(material, RADIUS, PERIOD, 1.0, time, displacement, outputs=["energy"])


@pytest.mark.parametrize(
    ("material", "column", "loss"), [(SLS, 1, 12.82979), (PMMA15, 3, 3.63051)], ids=["sls", "pmma"]
)
def test_tapping_matches_the_closed_form_springs(material, column, loss) -> None:
    result = tapping(material)
    rows = [round(400 * row[0]) for row in TAPPING]
    force = np.array([row[column] for row in TAPPING])
    width = np.array([row[column + 1] for row in TAPPING])
    peak = {1: 397765.82, 3: 454529.8}[column]
    assert np.abs(result.force.values[rows] - force).max() < 6e-5 * peak
    assert np.abs(result.contact_half_width.values[rows] / PERIOD - width).max() < 5e-6
    cycle = slice(400, None)
    found = np.trapezoid(result.force.values[cycle], result.displacement.values[cycle])
    assert found == pytest.approx(loss, rel=3e-4)


@pytest.mark.parametrize(
    ("time", "displacement", "match"),
    [
        ([0.0, 1.0], [0.0, np.nan], r"displacement\[1\] is nan"),
        ([0.0, 2.0, 1.0], [0.0, 0.0, 0.0], "sample 2"),
        ([0.0, 1.0], [0.0], "same length"),
        ([0.0, 1.0], [0.0, 1e-2], r"displacement\[1\].*closes over the whole period"),
    ],
)
def test_bad_histories_are_refused_with_the_place(time, displacement, match) -> None:
    with pytest.raises(InputError, match=match):
        indent(SLS, RADIUS, PERIOD, 1.0, time, displacement)


@pytest.mark.parametrize(("share", "bound"), [(0.45, 5e-7), (0.48, 5e-6), (0.49, 3e-5)])
def test_nearly_full_contact_is_right_within_a_bound(share, bound) -> None:
    exact = westergaard.from_half_width(share * PERIOD, RADIUS, PERIOD)
    pressed = indent(elastic(), RADIUS, PERIOD, 1.0, [0.0], [float(exact.displacement)])
    assert float(pressed.contact_half_width[0]) == pytest.approx(share * PERIOD, rel=1e-4)
    assert float(pressed.force[0]) == pytest.approx(float(exact.force), rel=bound)


@pytest.mark.parametrize("thickness", [np.inf, 1e-3])
def test_growing_contact_obeys_lee_and_radok(thickness) -> None:
    """F = ∫E(t−s) dF_el on any geometry whose contact grows; the width is the elastic one."""
    time = np.linspace(0.0, 0.2, 401)
    depth = 1e-3 * time
    shape = indent(elastic(0.35), RADIUS, PERIOD, 1.0, time, depth, thickness=thickness)
    found = indent(SLS, RADIUS, PERIOD, 1.0, time, depth, thickness=thickness)
    steps = np.diff(shape.force.values)
    middle = 0.5 * (time[1:] + time[:-1])
    exact = [steps[:n] @ SLS.relaxation(time[n] - middle[:n]) for n in range(401)]
    assert found.force.values == pytest.approx(exact, abs=2e-5 * exact[-1])
    assert found.contact_half_width.values == pytest.approx(shape.contact_half_width.values)


def test_maps_add_up_to_the_force_and_touch_the_indenter() -> None:
    time = np.linspace(0.0, 0.5, 11)
    found = indent(SLS, RADIUS, PERIOD, 18e-3, time, 2e-4 * np.sin(2 * np.pi * time), outputs=["pressure", "surface"])
    assert found.pressure.dims == ("time", "x")
    total = found.pressure.sum("x") * PERIOD / 1024 * 18e-3
    assert total.values == pytest.approx(found.force.values, abs=1e-4 * float(found.force.max()))
    gap = found.surface + found.x**2 / (2 * RADIUS) - found.displacement
    assert float(np.abs(gap.where(found.pressure > 0)).max()) < 1e-8
    assert float(gap.min()) > -1e-8
    for name in found.data_vars:
        assert {"units", "long_name"} <= set(found[name].attrs)


@pytest.mark.parametrize(
    ("wrong", "match"),
    [
        ({"depth": 0.0}, "depth"),
        ({"profile": "square"}, "square"),
        ({"elements": 33}, "even"),
        ({"thickness": 0.0}, "thick"),
        ({"outputs": ["colour"]}, "colour"),
        ({"thickness": 5e-5}, "thickness"),
    ],
)
def test_arguments_outside_their_domain_are_refused(wrong, match) -> None:
    arguments = {"tip_radius": RADIUS, "period": PERIOD, "depth": 1.0} | wrong
    with pytest.raises(InputError, match=match):
        indent(SLS, time=[0.0, 1.0], displacement=[0.0, 1e-4], **arguments)
