"""A sphere close by that was fitted as a small contact has fainter fringes than the contacts of its film."""

from types import SimpleNamespace

import numpy as np
import pytest

from labpipe.imaging.fringes import _frame_by_frame
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
