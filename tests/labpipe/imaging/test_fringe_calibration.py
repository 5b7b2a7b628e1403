"""How well a trial of parameters explains frames."""

from types import SimpleNamespace

import numpy as np
import pytest

from labpipe.imaging.fringes import _calibration
from labpipe.imaging.fringes._calibration import _BLURS, Calibration, _find_blur, _Trial, calibrate
from labpipe.imaging.fringes._ring_fit import Parameter


def test_the_excess_is_the_mean_square_of_the_misfits() -> None:
    fits = tuple(SimpleNamespace(misfit=misfit) for misfit in (1.0, 3.0))
    assert _Trial(fits).excess == 5.0  # type: ignore[arg-type]


def trial(misfit: float, count: int = 4) -> _Trial:
    """Fits of pixels with noise 1, so that a lower misfit is also a significant one."""
    fit = SimpleNamespace(
        misfit=misfit,
        residual=misfit,
        pixels=1000,
        noise=1.0,
        model_deviation=1.0,
        parameters=np.zeros(len(Parameter)),
        deviation=lambda _: 1.0,
    )
    return _Trial((fit,) * count)  # type: ignore[arg-type]


def test_the_blur_that_explains_the_frames_is_found() -> None:
    sharp = {0.0: 3.0}

    def attempt(extra: object, known: Calibration, count: int = 4) -> _Trial:
        return trial(sharp.get(known.blur, 1.0 + abs(known.blur - _BLURS[1])), count)

    found = _find_blur(attempt, (), Calibration(), trial(3.0, 8))
    assert found is not None
    assert found[1].blur == _BLURS[1]


def test_no_blur_is_found_where_none_helps_or_nothing_can_be_fitted() -> None:
    assert _find_blur(lambda *_: None, (), Calibration(), trial(3.0)) is None
    assert _find_blur(lambda *_: trial(2.9), (), Calibration(), trial(3.0)) is None
    assert _find_blur(lambda *_: trial(0.1), (), Calibration(blur=1.0), trial(3.0)) is None


@pytest.mark.parametrize(("misfit", "is_oblique"), [(1.0, True), (2.95, False), (4.0, False)])
def test_an_oblique_view_is_believed_only_if_it_explains_much_more(
    monkeypatch: pytest.MonkeyPatch, misfit: float, is_oblique: bool
) -> None:
    def fitted(images: object, starts: object, view: object, extra: tuple) -> _Trial | None:
        if Parameter.STRETCH in extra:
            made = trial(misfit)
            made.fits[0].parameters[Parameter.STRETCH] = 0.05
            return made
        return trial(3.0) if extra == () else None

    monkeypatch.setattr(_calibration, "_attempt", fitted)
    monkeypatch.setattr(_calibration, "_find_blur", lambda *_: None)
    monkeypatch.setattr(Calibration, "applied", lambda self, view: view)
    fits = {i: SimpleNamespace(parameters=np.full(len(Parameter), 50.0 + i)) for i in range(8)}
    monkeypatch.setattr(_calibration, "_choose", lambda fits: tuple(fits)[:4])
    found = calibrate(lambda i: i, fits, None, is_phase_free=False, shape="auto")  # type: ignore
    assert (found.ellipse != (0.0, 0.0)) == is_oblique
