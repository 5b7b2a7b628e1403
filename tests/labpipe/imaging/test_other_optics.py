"""What frames must agree on before a film is measured with other optics than stated."""

from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from labpipe.imaging.fringes import _optics_search, _second_colour
from labpipe.imaging.fringes._every_frame import _has_same_rings
from labpipe.imaging.fringes._interference import Optics
from labpipe.imaging.fringes._optics_search import OtherOptics, rebase
from labpipe.imaging.fringes._ring_fit import FitSettings
from labpipe.imaging.fringes._ring_parameters import Parameter
from labpipe.imaging.fringes._trials import Calibration
from labpipe.imaging.fringes._view import View

VIEW = View(Optics(1e-3, 3.0), FitSettings(free=()), (4, 4), 0.0, 255.0)


@dataclass
class _Fit:
    parameters: np.ndarray


def fitted(phase: float = 3.0, scale: float = 0.0) -> Any:
    parameters = np.zeros(len(Parameter))
    parameters[[Parameter.PHASE, Parameter.SCALE]] = phase, scale
    return _Fit(parameters)


@pytest.mark.parametrize(
    ("changed", "is_same"),
    [
        ({"optics": replace(VIEW.optics, blur=2.0)}, True),
        ({"optics": replace(VIEW.optics, phase_scale=2e-3)}, False),
        ({"optics": replace(VIEW.optics, phase=2.0)}, False),
        ({"optics": replace(VIEW.optics, flat=5.0)}, False),
        ({"settings": FitSettings(free=(Parameter.BLUR,))}, False),
    ],
)
def test_a_blur_leaves_rings_where_they_are_what_moves_them_does_not(changed: dict[str, Any], is_same: bool) -> None:
    assert _has_same_rings(VIEW, replace(VIEW, **changed)) is is_same


@pytest.mark.parametrize(
    ("ratios", "taken"),
    [((1.2, 1.21, 1.5), 1.21), ((1.2, 1.5, 1.21), 1.21), ((1.2, 1.3, 1.4), None), ((1.2, None, 1.21), 1.21)],
)
def test_two_of_many_frames_must_show_the_same_second_colour(
    monkeypatch: pytest.MonkeyPatch, ratios: tuple[float | None, ...], taken: float | None
) -> None:
    found = iter([None if ratio is None else (fitted(), (ratio, 0.3)) for ratio in ratios])
    monkeypatch.setattr(_optics_search, "find_colours", lambda *_, **__: next(found))
    result: Any = SimpleNamespace(view=VIEW)
    other = OtherOptics(result, is_phase_free=True)
    other._tried = dict.fromkeys(range(len(ratios)), None)  # type: ignore[arg-type]
    assert other.takes_single() is (taken is not None)
    assert result.view.optics.colour == (VIEW.optics.colour if taken is None else (taken, 0.3))


def test_one_of_few_frames_is_enough_for_a_second_colour(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_optics_search, "find_colours", lambda *_, **__: (fitted(), (1.3, 0.2)))
    result: Any = SimpleNamespace(view=VIEW)
    other = OtherOptics(result, is_phase_free=True)
    other._tried = {0: None}  # type: ignore[dict-item]
    assert other.takes_single()
    assert result.view.optics.colour == (1.3, 0.2)


def test_phase_and_scale_that_most_fits_found_become_the_films_own() -> None:
    result: Any = SimpleNamespace(view=VIEW)
    assert VIEW.optics.phase == 3.0
    fits: Any = {i: fitted(3.05, scale) for i, scale in enumerate((0.1, 0.11, 0.12, -0.2))}
    rebase(result, fits)
    assert result.view.optics.phase == 3.0  # near enough to the stated one
    assert result.view.optics.phase_scale == pytest.approx(1e-3 * np.exp(0.105))
    assert [float(fit.parameters[Parameter.SCALE]) for fit in fits.values()] == pytest.approx(
        [-0.005, 0.005, 0.015, -0.305]
    )
    scattered: Any = {i: fitted(1.0, scale) for i, scale in enumerate((0.1, 0.2, 0.3, 0.4))}
    result.view = VIEW
    rebase(result, scattered)
    assert result.view.optics.phase == 1.0
    assert result.view.optics.phase_scale == 1e-3


def test_of_a_second_colour_is_uncertain_what_the_squares_leave_open() -> None:
    """They rise by 4 and by 9 over a step of the ratio and of the share, which move the radius by 0.3 and -0.1 px."""

    def attempt(axes: object, known: Calibration, **_: object) -> Any:
        steps = (np.array(known.colour) - (1.2, 0.2)) / _second_colour._STEPS
        radius = 100.0 + float(steps @ (0.3, -0.1))
        parameters = np.zeros(len(Parameter))
        parameters[Parameter.RADIUS] = radius
        left = 1000.0 + float(steps**2 @ (4.0, 9.0))
        fits = [_Fit(parameters)]
        return SimpleNamespace(
            left=left, pixels=2000, fits=fits, radius=radius, changes=lambda other: np.array([radius - other.radius])
        )

    found = _second_colour._settled(attempt, (), Calibration(), np.array((1.203, 0.19)))
    assert found is not None
    _, known = found
    assert known.colour == pytest.approx((1.2, 0.2), abs=1e-4)
    assert known.u_shared == pytest.approx([np.hypot(0.3 / 2.0, 0.1 / 3.0)], rel=0.01)
