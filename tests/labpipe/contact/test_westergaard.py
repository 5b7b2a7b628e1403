"""Closed forms of the periodic line contact against the table and against each other."""

import numpy as np
import pytest

from labpipe.contact import indent
from labpipe.contact.line import westergaard
from labpipe.errors import InputError
from labpipe.materials import Prony

# a/λ, P R/(E* λ²), δ R/λ², p(0) R/(E* λ)
PARABOLA = [
    (0.01, 7.8552739022933e-5, 0.00019805665333652, 0.0050008226700272),
    (0.1, 0.0079866799192246, 0.0084501663119513, 0.050843361107915),
    (0.4, 0.18690504070883, 0.03918750329644, 0.29327959380658),
    (0.49, 0.55077235984159, 0.041641668723105, 0.66105088839473),
]


@pytest.mark.parametrize("row", PARABOLA, ids=lambda row: str(row[0]))
def test_parabola_matches_the_table(row) -> None:
    state = westergaard.from_half_width(row[0], 1.0, 1.0)
    found = (state.force, state.displacement, state.peak_pressure)
    assert np.abs(np.array(found) / np.array(row[1:]) - 1.0).max() < 1e-10


def test_full_contact_is_refused() -> None:
    with pytest.raises(InputError, match="closes the period"):
        westergaard.from_displacement(8e-3**2 / (24 * 2e-3), 2e-3, 8e-3)
    with pytest.raises(InputError, match="half a period"):
        westergaard.from_half_width(4e-3, 2e-3, 8e-3)


@pytest.mark.parametrize("profile", ["parabola", "cosine"])
@pytest.mark.parametrize(("share", "bound"), [(0.02, 1e-5), (0.1, 2e-7), (0.25, 2e-7), (0.4, 2e-7)])
def test_strips_agree_with_the_closed_form_at_any_edge(profile, share, bound) -> None:
    width = share * 8e-3 + np.linspace(-0.5, 0.5, 17) * 8e-3 / 1024
    exact = westergaard.from_half_width(width, 2e-3, 8e-3, 1.0, profile)
    solid = Prony(1.0, [], [], nu=0.0)
    time = np.arange(17.0)
    result = indent(solid, 2e-3, 8e-3, 1.0, time, exact.displacement, profile=profile)
    assert np.abs(result.force.values / exact.force - 1.0).max() < bound
    edge = np.abs(result.contact_half_width.values - width).max()
    assert edge < 0.005 * 8e-3 / 1024
