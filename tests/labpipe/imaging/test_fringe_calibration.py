"""How well a trial of parameters explains frames."""

import math
from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest

from labpipe.imaging.fringes import _calibration
from labpipe.imaging.fringes._attempts import Attempts
from labpipe.imaging.fringes._calibration import calibrate
from labpipe.imaging.fringes._frame_by_frame import _expected
from labpipe.imaging.fringes._gains import Gains, in_order
from labpipe.imaging.fringes._interference import Optics, make_optics
from labpipe.imaging.fringes._lens_blur import find_blur
from labpipe.imaging.fringes._ring_fit import FitSettings, fit_contact
from labpipe.imaging.fringes._ring_parameters import AXES, Parameter
from labpipe.imaging.fringes._trials import FEW_PIXELS, Calibration, Trial
from labpipe.imaging.fringes._view import View
from labpipe.imaging.fringes._worn_flat import find_flat
from tests.labpipe.imaging.fringe_film import Scene, clean_image, expose


def test_the_excess_is_the_mean_square_of_the_misfits() -> None:
    fits = tuple(SimpleNamespace(misfit=misfit) for misfit in (1.0, 3.0))
    assert Trial(fits, (1.0, 1.0)).excess == 5.0  # type: ignore[arg-type]


def trial(misfit: float, count: int = 4, smear: float = 0.0) -> Trial:
    """Fits of pixels with noise 1, so that a lower misfit is also a significant one."""
    fits = tuple(_fit(misfit, smear) for _ in range(count))
    return Trial(fits, (1.0,) * count)  # type: ignore[arg-type]


def _fit(misfit: float, smear: float) -> SimpleNamespace:
    parameters = np.full(len(Parameter), 50.0)
    parameters[[Parameter.SMEAR, Parameter.BLUR, Parameter.SHAPE]] = smear, 0.0, 0.0
    return SimpleNamespace(
        is_converged=True,
        misfit=misfit,
        residual=misfit,
        pixels=1000,
        noise=1.0,
        between=1.0,
        curvature=1000.0,
        slow=None,
        worst_deviation=1.0,
        expected_gain=lambda _: 0.0,
        along=lambda *_: (np.zeros(0), np.zeros((0, 0))),
        by_memory=None,
        has_negative_light=False,
        doubts={},
        parameters=parameters,
        free=tuple(Parameter),
        inverse=np.eye(len(Parameter)),
        deviation=lambda _: 0.05,
    )


def test_the_blur_of_the_frame_that_moves_least_is_that_of_the_lens() -> None:
    def attempt(extra: object, known: Calibration, count: int = 4, pixels: int | None = None) -> Trial:
        found = trial(1.0 if known.blur else 3.0, count)
        for k, fit in enumerate(found.fits):
            fit.parameters[Parameter.BLUR] = (2.1 + 0.5 * k) ** 2 - known.blur**2
            fit.parameters[Parameter.SHAPE] = 0.5 + k - known.disc**2
        return found

    found = find_blur(attempt, (), Calibration(), trial(3.0, 4, smear=12.0 * 2.0**2))
    assert found is not None
    assert found[1].blur == pytest.approx(2.1, rel=0.02)
    assert found[1].disc == pytest.approx(math.sqrt(0.5), rel=0.02)


def test_the_flat_that_explains_the_frames_is_found() -> None:
    def attempt(extra: object, known: Calibration, count: int = 4, pixels: int | None = None) -> Trial:
        return trial(1.0 + 2.0 * (known.flat / 31.0 - 1.0) ** 2, count)

    found = find_flat(attempt, (), Calibration(), trial(3.0))
    assert found is not None
    assert found[1].flat == pytest.approx(31.0, rel=0.02)


@pytest.mark.parametrize("find", [find_blur, find_flat])
def test_nothing_is_found_where_none_helps_or_nothing_can_be_fitted(find: Callable[..., object]) -> None:
    known = Calibration(blur=1.0, flat=1.0)
    moving = trial(3.0, smear=12.0)
    assert find(lambda *_, **__: None, (), Calibration(), moving) is None
    assert find(lambda *_, **__: moving, (), Calibration(), moving) is None
    assert find(lambda *_, **__: trial(0.1), (), known, moving) is None


def test_what_promises_nothing_on_a_few_pixels_is_not_tried_on_whole_frames() -> None:
    asked: list[int | None] = []

    def attempt(extra: object, known: Calibration, count: int = 8, pixels: int | None = None) -> Trial:
        asked.append(pixels)
        return trial(2.9 if known.has_uneven_light or extra else 3.0, count)

    before = trial(3.0, 8, smear=12.0)
    assert _calibration._find_uneven_light(attempt, (), Calibration(), before) is None
    assert set(asked) == {FEW_PIXELS}


def test_what_explained_nothing_is_tried_again_when_most_of_the_misfit_is_gone(monkeypatch: pytest.MonkeyPatch) -> None:
    names = ("find_blur", "_find_uneven_light", "find_harmonics", "find_blur_before_camera", "find_second_colour")
    asked: list[str] = []
    for name in (*names, "find_coating", "_find_optics", "find_flat", "_find_focus"):
        monkeypatch.setattr(_calibration, name, lambda *_, name=name: asked.append(name))
    vain: dict[str, float] = {}
    attempt = Mock(return_value=None)
    attempt.gains.return_value.round_share = 0.1
    attempt.gains.return_value.share = lambda *_, **__: 0.9
    for misfit, count in ((3.0, 11), (2.5, 0), (2.0, 11)):
        asked.clear()
        assert not [*_calibration._candidates(attempt, (), Calibration(), trial(misfit), None, vain, 0.0)]  # type: ignore
        assert len(asked) == count
    attempt.gains.return_value.share = lambda *_, **__: 0.1  # what is left is no function of the distance
    asked.clear()
    assert not [*_calibration._candidates(attempt, (), Calibration(), trial(3.0), None, {}, 0.0)]  # type: ignore
    assert asked == ["find_blur", "_find_uneven_light"]  # which a motion hides, and rings that are not seen all round


def test_what_promises_most_is_tried_first_and_of_equals_the_simpler() -> None:
    shares = {"blur": 0.1, "phase": 0.85, "scale": 0.2, "coating": 0.9}
    assert in_order(shares) == ["phase", "coating", "blur", "scale"]


def test_what_is_wrong_promises_what_it_gains_and_nothing_else_does() -> None:
    """One step of Gauss and Newton tells of all explanations what fits of each would."""
    scene = Scene(rows=200, columns=240, noise=1.0)
    rng = np.random.default_rng(5)
    frames = [expose(clean_image(scene.change(phase=3.0), a, (118.3, 99.6)), scene, rng) for a in (1e-4, 1.2e-4)]
    view = View(
        make_optics(scene.pixel_size, scene.sphere_radius, scene.wavelength), FitSettings(), (200, 240), 0.0, 255.0
    )
    start = np.zeros(len(Parameter))
    start[[Parameter.X, Parameter.Y, Parameter.PHASE]] = 118.0, 100.0, np.pi
    start[[Parameter.GAIN, Parameter.MODULATION]] = scene.mean, 0.8 * scene.mean
    fits = []
    for frame, radius in zip(frames, (46.1, 55.3), strict=True):
        start[Parameter.RADIUS] = radius
        fits.append(fit_contact(frame, start, view.optics, view.settings))
    gains = Gains(frames, fits, view)  # type: ignore[arg-type]
    free = replace(view.settings, free=(*view.settings.free, Parameter.PHASE))
    turned = [fit_contact(f, fit.parameters, view.optics, free) for f, fit in zip(frames, fits, strict=True)]
    left = np.mean([fit.misfit**2 for fit in turned]) / gains.excess
    assert gains.share((Parameter.PHASE,)) == pytest.approx(1.0 - left, abs=0.05)
    assert gains.share((Parameter.BLUR,)) < 0.5
    assert gains.share(AXES) < 0.05
    assert gains.share((Parameter.PHASE,), is_common=False) >= gains.share((Parameter.PHASE,))


def test_a_frame_between_two_others_is_expected_between_them() -> None:
    fits = {k: SimpleNamespace(parameters=np.full(len(Parameter), 10.0 * k)) for k in (3, 4, 8)}
    between = _expected({4: fits[4]}, fits, 5)  # type: ignore
    assert between is not None
    assert between[Parameter.RADIUS] == 50.0
    assert between[Parameter.GAIN] == 40.0
    after = _expected(fits, {}, 5)  # type: ignore
    assert after is not None
    assert after[Parameter.RADIUS] == 40.0
    assert _expected({4: fits[4]}, {}, 5) is None  # type: ignore
    assert _expected({3: fits[3]}, fits, 5) is None  # type: ignore


@pytest.mark.parametrize(
    ("misfit", "explained", "is_oblique"),
    [(1.0, 3e-3, True), (2.95, 3e-3, False), (4.0, 3e-3, False), (1.0, 3e-5, False)],
)
def test_an_oblique_view_is_believed_only_if_it_explains_much_more_and_promised_some_of_it(
    monkeypatch: pytest.MonkeyPatch, misfit: float, explained: float, is_oblique: bool
) -> None:
    def fitted(attempts: object, view: object, extra: tuple, count: int) -> Trial | None:
        if Parameter.STRETCH in extra:
            made = trial(misfit)
            made.fits[0].parameters[Parameter.STRETCH] = 0.05
            return made
        return trial(3.0) if extra == () else None

    monkeypatch.setattr(Attempts, "_fit", fitted)
    told = SimpleNamespace(explained=lambda of: explained * (AXES[0] in of), round_share=0.1)
    monkeypatch.setattr(Attempts, "gains", lambda *_: told)
    monkeypatch.setattr(_calibration, "_FAR", math.inf)  # else any is tried, whatever it promises
    monkeypatch.setattr(_calibration, "_candidates", lambda *_: ())
    monkeypatch.setattr(Calibration, "applied", lambda self, view: view)
    fits = {i: SimpleNamespace(parameters=np.full(len(Parameter), 50.0 + i)) for i in range(8)}
    monkeypatch.setattr(_calibration, "_choose", lambda fits: tuple(fits)[:4])
    view = View(Optics(1.0), FitSettings(), (9, 9), 0.0, 255.0)
    found = calibrate(lambda i: i, fits, view, is_phase_free=False, shape="auto")  # type: ignore
    assert (found.ellipse != (0.0, 0.0)) == is_oblique
