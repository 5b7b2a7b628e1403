"""The reference scheme converges to ours, slowly, and costs what its description says."""

import json

import numpy as np
import pytest

from labpipe.contact import indent
from labpipe.contact.line._thesis_scheme import indent_thesis_scheme
from labpipe.errors import InputError
from labpipe.materials import Prony

SLS = Prony.from_creep(2e9, [0.25e-9], [0.05], nu=0.35)
GEOMETRY = (2e-3, 8e-3, 1.0)


def ramp_and_return(steps: int) -> tuple[np.ndarray, np.ndarray]:
    time = np.linspace(0.0, 0.4, steps + 1)
    return time, 1e-4 * np.sin(np.pi * time / 0.4)


def error(steps: int) -> float:
    time, depth = ramp_and_return(steps)
    plain = indent_thesis_scheme(SLS, *GEOMETRY, time, depth, elements=128)
    ours = indent(SLS, *GEOMETRY, time, depth, profile="cosine", elements=128)
    return float(np.abs(plain.force - ours.force).max() / ours.force.max())


def test_it_converges_to_first_order_and_stays_far_behind() -> None:
    coarse, fine = error(40), error(160)
    assert 3.0 < coarse / fine < 5.0
    assert coarse > 1e-2


def test_its_cost_is_quadratic_in_the_number_of_steps() -> None:
    short = indent_thesis_scheme(SLS, *GEOMETRY, *ramp_and_return(50), elements=64)
    long = indent_thesis_scheme(SLS, *GEOMETRY, *ramp_and_return(200), elements=64)
    ratio = json.loads(long.work)["history_products"] / json.loads(short.work)["history_products"]
    assert ratio == pytest.approx(16.0, rel=0.02)


def test_elastic_step_is_the_plateau() -> None:
    rubber = Prony(10.14e6, [], [], nu=0.0)
    found = indent_thesis_scheme(rubber, 2e-3, 8e-3, 18e-3, [0.0], [2e-4])
    assert float(found.force[0]) == pytest.approx(30.90, rel=2e-3)


def test_uneven_steps_are_refused() -> None:
    with pytest.raises(InputError, match="uniform"):
        indent_thesis_scheme(SLS, *GEOMETRY, [0.0, 1.0, 3.0], [0.0, 0.0, 0.0])


def test_its_contact_is_as_wide_as_ours() -> None:
    rubber = Prony(10.14e6, [], [], nu=0.3)
    time, depth = [0.0, 1.0], [1e-4, 2e-4]
    plain = indent_thesis_scheme(rubber, 2e-3, 8e-3, 1.0, time, depth, elements=256)
    ours = indent(rubber, 2e-3, 8e-3, 1.0, time, depth, profile="cosine", elements=256)
    spacing = 2e-3 / 256
    assert plain.contact_half_width.values == pytest.approx(ours.contact_half_width.values, abs=1.5 * spacing)
