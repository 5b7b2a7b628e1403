"""What makes a radius uncertain, part by part."""

from types import SimpleNamespace

import numpy as np
import pytest

from labpipe.imaging import contact_radius
from labpipe.imaging.fringes import _frame_by_frame
from labpipe.imaging.fringes._acceptance import GOOD_MISFIT
from labpipe.imaging.fringes._blank_frames import Blank
from labpipe.imaging.fringes._dataset import FRINGES, _edge_systematic, _static_radius
from labpipe.imaging.fringes._interference import Optics
from labpipe.imaging.fringes._ring_fit import FitSettings
from labpipe.imaging.fringes._ring_parameters import Parameter
from labpipe.imaging.fringes._trials import Calibration
from labpipe.imaging.fringes._view import View
from tests.labpipe.imaging.fringe_film import Scene, fringe_film


def test_of_an_edge_only_the_scale_is_uncertain() -> None:
    parts = _edge_systematic(1e-3, None, None, {"pixel_size": 2e-3})  # type: ignore[arg-type]
    assert parts.tolist() == [0.0, 0.0, 2e-6, 0.0, 0.0, 0.0]


def test_the_radius_at_rest_is_the_weighted_mean_of_the_last_frames() -> None:
    radius = np.array([5.0, 8.0, *([1.0, 1.001] * 6)])
    deviation = np.array([0.1, 0.1, *([1e-3, 3e-3] * 6)])
    method = np.full(radius.size, FRINGES, np.int8)
    mean, u = _static_radius(radius, deviation, method)
    assert mean == pytest.approx((1.0 + 1.001 / 9.0) / (1.0 + 1.0 / 9.0), rel=1e-12)
    assert 0.0 < u < 1e-2
    radius[-1] = np.nan
    assert np.isnan(_static_radius(radius, deviation, method)).all()


def test_a_frame_is_refitted_from_its_own_fit_unless_that_is_a_poor_one(monkeypatch) -> None:
    """A good fit of a contact is kept, as is one no worse than before; another is looked for anew."""
    view = View(Optics(1e-3, 3.0), FitSettings(free=()), (4, 4), 0.0, 255.0)
    misfit = {0: 0.5 * GOOD_MISFIT, 1: 2.0 * GOOD_MISFIT, 2: 0.5 * GOOD_MISFIT, 3: 0.5}
    monkeypatch.setattr(
        _frame_by_frame, "fit_contact", lambda frame, *_: SimpleNamespace(misfit=misfit[frame], of=frame)
    )
    monkeypatch.setattr(_frame_by_frame, "is_contact", lambda frame, *_: frame != 2)
    monkeypatch.setattr(_frame_by_frame, "_next_fit", lambda looks, *_: f"searched {looks.frame}")
    reader = SimpleNamespace(whole=lambda index: index)
    result = SimpleNamespace(view=view, blanks={}, calibration=Calibration())
    fits = {i: SimpleNamespace(parameters=np.zeros(len(Parameter)), misfit=0.0) for i in (0, 1, 2)}
    found = _frame_by_frame.refit(reader, result, np.ones(4, bool), fits, stays_blank=False)
    assert found[0].of == 0
    assert [found[i] for i in (1, 2, 3)] == ["searched 1", "searched 2", "searched 3"]
    assert result.blanks == {}
    # with all rings where they were, what held no contact is not searched again
    result.blanks = {3: Blank()}
    found = _frame_by_frame.refit(reader, result, np.ones(4, bool), fits, stays_blank=True)
    assert (sorted(found), result.blanks) == ([0, 1, 2], {3: Blank()})
    fits[1].misfit = 2.0 * GOOD_MISFIT
    assert _frame_by_frame.refit(reader, result, np.ones(4, bool), fits, stays_blank=True)[1].of == 1


@pytest.mark.parametrize("zoom", [1.0, 1.02])
def test_the_largest_frame_of_each_contact_tells_the_scale_by_itself(zoom: float) -> None:
    """Phases go with the square of a length in px."""
    scene = Scene(rows=160, columns=224, pixel_size=4e-6)
    radii = [120e-6, 160e-6, 140e-6]
    centres = [(110.3, 80.1)] * 3
    later = scene.change(pixel_size=4e-6 / zoom)
    still = np.full((4, 160, 224), 120, np.uint8)
    films = [fringe_film(one, radii, centres, seed) for seed, one in enumerate((scene, later))]
    found = contact_radius(np.concatenate([films[0], still, films[1]]), 4e-6, 9.525e-3, 633e-9)
    told = np.flatnonzero(np.isfinite(found.own_scale.values))
    assert {1, 8} <= set(told.tolist()) <= {0, 1, 2, 7, 8, 9}
    ratio = float(found.own_scale[8] / found.own_scale[1])
    u = float(np.hypot(found.u_own_scale[8], found.u_own_scale[1]))
    assert u < 5e-3
    assert ratio == pytest.approx(zoom**-2, abs=4.0 * u)


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_half_the_radius_of_the_sphere_is_told_where_only_edges_or_single_fringes_are_measured() -> None:
    """Rings in a strip, as wide as the pixels resolve, are then looked for between rings twice as fine."""
    scene = Scene(rows=64, columns=640, pixel_size=4.34e-6, noise=3.0, blur=0.5)
    film = fringe_film(scene, [660e-6, 760e-6, 790e-6], [(320.3, 30.1)] * 3, 5)
    found = contact_radius(film, 4.34e-6, 0.5 * 9.525e-3, 633e-9)
    told = np.isfinite(found.own_scale.values)
    assert told.sum() >= 2
    scale = float(found.attrs["phase_scale_ratio"]) * found.own_scale.values[told]
    np.testing.assert_allclose(scale, 0.5, rtol=0.02)
