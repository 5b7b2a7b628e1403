"""Hostile input to the contact mechanics: right within a bound, or refused with a reason.

What is generated stands in ``tests/extremes``; here are long and single cases.
"""

import numpy as np
import pytest

from labpipe.contact import indent, load_sphere, press_sphere
from labpipe.errors import InputError
from labpipe.materials import Prony


def test_zero_length_holds_and_repeated_times_change_nothing() -> None:
    material = Prony(1e6, [1e8], [1e-3], nu=0.3)
    plain = press_sphere(material, 0.01, [0.0, 1.0, 2.0], [0.0, 1e-5, 1e-5])
    held = press_sphere(material, 0.01, [0.0, 1.0, 1.0, 1.0, 2.0, 2.0], [0.0, 1e-5, 1e-5, 1e-5, 1e-5, 1e-5])
    assert held.force.values[[0, 1, 4]] == pytest.approx(plain.force.values, rel=1e-12)
    assert held.force.values[5] == held.force.values[4]


def test_a_missing_sample_is_named() -> None:
    material = Prony(1e6, [1e8], [1e-3], nu=0.3)
    with pytest.raises(InputError, match=r"displacement\[2\] is nan"):
        indent(material, 2e-3, 8e-3, 1.0, [0.0, 1.0, 2.0], [0.0, 1e-5, np.nan])
    with pytest.raises(InputError, match=r"load\[1\] is inf"):
        load_sphere(material, 0.01, [0.0, 1.0], [0.0, np.inf])
