"""How well a trial of parameters explains frames."""

from collections.abc import Callable
from types import SimpleNamespace

import numpy as np
import pytest

from labpipe.imaging.fringes import _calibration
from labpipe.imaging.fringes._calibration import calibrate
from labpipe.imaging.fringes._lens_blur import find_blur
from labpipe.imaging.fringes._ring_parameters import Parameter
from labpipe.imaging.fringes._trials import Calibration, Trial
from labpipe.imaging.fringes._worn_flat import find_flat


def test_the_excess_is_the_mean_square_of_the_misfits() -> None:
    fits = tuple(SimpleNamespace(misfit=misfit) for misfit in (1.0, 3.0))
    assert Trial(fits).excess == 5.0  # type: ignore[arg-type]


def trial(misfit: float, count: int = 4, smear: float = 0.0) -> Trial:
    """Fits of pixels with noise 1, so that a lower misfit is also a significant one."""
    parameters = np.full(len(Parameter), 50.0)
    parameters[Parameter.SMEAR] = smear
    fit = SimpleNamespace(
        misfit=misfit,
        residual=misfit,
        pixels=1000,
        noise=1.0,
        between=1.0,
        curvature=1000.0,
        slow=None,
        model_deviation=1.0,
        parameters=parameters,
        deviation=lambda _: 1.0,
    )
    return Trial((fit,) * count)  # type: ignore[arg-type]


def test_the_blur_of_the_frame_that_moves_least_is_that_of_the_lens() -> None:
    def attempt(extra: object, known: Calibration, count: int = 4, pixels: int | None = None) -> Trial:
        return trial(1.0 if known.blur else 3.0, count, smear=12.0 * (2.1**2 - known.blur**2))

    found = find_blur(attempt, (), Calibration(), trial(3.0, 4, smear=12.0 * 2.0**2))
    assert found is not None
    assert found[1].blur == pytest.approx(2.1, rel=0.02)


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
    assert find(lambda *_: None, (), Calibration(), moving) is None
    assert find(lambda *_: moving, (), Calibration(), moving) is None
    assert find(lambda *_: trial(0.1), (), known, moving) is None


@pytest.mark.parametrize(("misfit", "is_oblique"), [(1.0, True), (2.95, False), (4.0, False)])
def test_an_oblique_view_is_believed_only_if_it_explains_much_more(
    monkeypatch: pytest.MonkeyPatch, misfit: float, is_oblique: bool
) -> None:
    def fitted(images: object, starts: object, view: object, extra: tuple) -> Trial | None:
        if Parameter.STRETCH in extra:
            made = trial(misfit)
            made.fits[0].parameters[Parameter.STRETCH] = 0.05
            return made
        return trial(3.0) if extra == () else None

    monkeypatch.setattr(_calibration, "fit_frames", fitted)
    monkeypatch.setattr(_calibration, "_candidates", lambda *_: ())
    monkeypatch.setattr(Calibration, "applied", lambda self, view: view)
    fits = {i: SimpleNamespace(parameters=np.full(len(Parameter), 50.0 + i)) for i in range(8)}
    monkeypatch.setattr(_calibration, "_choose", lambda fits: tuple(fits)[:4])
    view = SimpleNamespace(optics=SimpleNamespace(colour=(1.0, 0.0)))
    found = calibrate(lambda i: i, fits, view, is_phase_free=False, shape="auto")  # type: ignore
    assert (found.ellipse != (0.0, 0.0)) == is_oblique
