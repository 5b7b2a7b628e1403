"""Faint fringes: a sphere close by has fainter ones than the contacts of its film, and so has coated steel."""

from types import SimpleNamespace

import numpy as np
import pytest

from labpipe.imaging.fringes import _frame_by_frame, contact_radius, hertz_gap
from labpipe.imaging.fringes._ring_parameters import Parameter


def fit(radius: float, visibility: float) -> SimpleNamespace:
    parameters = np.zeros(len(Parameter))
    parameters[[Parameter.RADIUS, Parameter.GAIN, Parameter.MODULATION]] = radius, 104.0, 100.0 * visibility
    return SimpleNamespace(parameters=parameters)


@pytest.mark.parametrize(
    ("radius", "visibility", "others", "stays"),
    [(9.0, 0.14, 5, False), (9.0, 0.5, 5, True), (200.0, 0.14, 5, True), (9.0, 0.14, 3, True)],
    ids=["faint", "as the others", "large", "too few others"],
)
def test_only_small_contacts_of_faint_fringes_are_left(monkeypatch, radius, visibility, others, stays) -> None:
    monkeypatch.setattr(_frame_by_frame, "Looks", lambda frame: frame)
    monkeypatch.setattr(_frame_by_frame, "look_without_fringes", lambda looks, view: (looks, view))
    fits = {i: fit(150.0 + i, 0.87) for i in range(others)} | {7: fit(radius, visibility)}
    result = SimpleNamespace(fits=fits, blanks={}, view=SimpleNamespace(black=4.0, newton_spot=10.0))
    _frame_by_frame.leave_faint(SimpleNamespace(whole=lambda index: f"frame {index}"), result)
    assert (7 in result.fits) == stays
    assert result.blanks == ({} if stays else {7: ("frame 7", result.view)})


@pytest.mark.parametrize("phase", [np.pi, np.pi - 0.034], ids=["dark", "a small phase"])
def test_a_contact_of_faint_fringes_is_measured_within_its_uncertainty(phase: float) -> None:
    """On coated steel fringes have a visibility of 4 %."""
    y, x = np.mgrid[:200, :240]
    gap = hertz_gap(2e-6 * np.hypot(x - 119.7, y - 101.2), 90e-6, 9.525e-3)
    grey = 1000.0 * (1.0 + 0.04 * np.cos(4.0 * np.pi * gap / 633e-9 + phase))
    film = (grey + 6.0 * np.random.default_rng(3).standard_normal((3, 200, 240))).astype(np.uint16)
    found = contact_radius(film, 2e-6, 9.525e-3, 633e-9)
    assert (found.method == 1).all()
    u = np.hypot(found.u_radius, found.radius_systematic)
    assert (np.abs(found.radius - 90e-6) < 3.0 * u).all()
    assert (u < 0.5e-6).all()
