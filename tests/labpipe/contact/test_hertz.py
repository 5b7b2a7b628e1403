"""Closed forms of the elastic sphere against published constants."""

import numpy as np
import pytest

from labpipe.contact.sphere import hertz
from labpipe.errors import InputError


def test_scaled_impact_matches_the_table() -> None:
    # x'' = -x^{3/2}: mass 1, (4/3) E* sqrt(R) = 1.
    found = hertz.impact(1.0, 1.0, 1.0, 0.75)
    expected = (1.0933620739, 1.1432626298, 3.2180654597)
    assert (found.peak_approach, found.peak_force, found.contact_duration) == pytest.approx(expected, rel=1e-10)


def test_load_and_approach_invert_each_other() -> None:
    state = hertz.static_load([0.0, 1e-6, 3.0, 1e3], 9.525e-3, 3e9)
    assert hertz.static_approach(state.approach, 9.525e-3, 3e9).force == pytest.approx(state.force, rel=1e-12, abs=0.0)


@pytest.mark.parametrize(
    ("function", "arguments"),
    [
        (hertz.static_load, (-1.0, 1.0, 1.0)),
        (hertz.static_approach, (np.nan, 1.0, 1.0)),
        (hertz.impact, (1.0, 1.0, -1.0, 1.0)),
    ],
)
def test_values_outside_the_domain_are_refused(function, arguments) -> None:
    with pytest.raises(InputError):
        function(*arguments)
