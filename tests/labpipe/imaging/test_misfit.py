"""What errors of the model make of a radius: by parts of the ring, and never more than the worst."""

from dataclasses import replace

import numpy as np
import pytest

from labpipe.imaging.fringes._interference import distance_at_phase, make_optics, part_limits, ring_limits
from labpipe.imaging.fringes._misfit import with_misfit_weighed
from labpipe.imaging.fringes._ring_fit import FitSettings, fit_contact
from labpipe.imaging.fringes._ring_noise import unsteadiness
from labpipe.imaging.fringes._ring_parameters import PARAMETERS, USUAL, Parameter
from tests.labpipe.imaging.contact_optics import Microscope, comet
from tests.labpipe.imaging.contact_scenes import gap_of_jkr
from tests.labpipe.imaging.fringe_film import Scene

SCENE = Scene(rows=300, columns=360)
SPHERE, A, CENTRE = 9.525e-3, 205e-6, (181.3, 149.2)
OPTICS = make_optics(SCENE.pixel_size, SPHERE, SCENE.wavelength)


def started(microscope: Microscope, centre: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    frame = microscope.film(lambda r, a: gap_of_jkr(r, a, SPHERE, 5e9, 0.0), [A], centre, 4)[0]
    start = np.zeros(PARAMETERS)
    start[:5] = A / SCENE.pixel_size + 0.2, centre[0] - 0.1, centre[1] + 0.1, 120.0, 96.0
    start[Parameter.PHASE] = np.pi
    return frame, start


def fitted(microscope: Microscope) -> tuple[np.ndarray, object]:
    frame, start = started(microscope, CENTRE)
    return frame, fit_contact(frame, start, OPTICS, FitSettings())


def test_leaving_out_parts_is_the_jackknife_of_a_line() -> None:
    """Slope of a line through groups of points, each group left out in turn."""
    rng = np.random.default_rng(3)
    x, group = rng.uniform(0.0, 4.0, 60), np.repeat(np.arange(6), 10)
    y = 0.3 + 2.0 * x + rng.standard_normal(60) + rng.standard_normal(6)[group]
    slopes = np.stack([np.ones(60), x])
    best = np.polynomial.Polynomial.fit(x, y, 1).convert().coef
    residual = y - best @ slopes
    others = [np.polynomial.Polynomial.fit(x[group != g], y[group != g], 1).convert().coef[1] for g in range(6)]
    expected = 5.0 / 6.0 * ((np.array(others) - best[1]) ** 2).sum()
    parts = [slopes[:, group == g] for g in range(6)]
    normals = np.stack([part @ part.T for part in parts])
    pulls = np.stack([part @ residual[group == g] for g, part in enumerate(parts)])
    assert unsteadiness(normals, pulls, 1) == pytest.approx(expected, rel=1e-6)


def test_parts_are_quarters_of_fringes() -> None:
    radius = A / SCENE.pixel_size
    inner, outer = ring_limits(radius, OPTICS, 3.0, 2.0)
    limits = part_limits(radius, inner, outer, OPTICS)
    assert limits[0] == inner
    assert limits[2] == radius
    assert limits[-1] == np.inf
    assert np.diff(limits).min() > 0.0
    assert limits[3] == pytest.approx(distance_at_phase(0.5 * np.pi, radius, OPTICS))
    assert limits[-2] < outer - 0.5


def test_a_frame_without_misfit_is_left_as_it_is() -> None:
    frame, fit = fitted(Microscope(SCENE))
    assert fit.worst_deviation == 0.0
    assert with_misfit_weighed(frame, fit, OPTICS, FitSettings()) is fit


def test_a_ghost_counts_by_what_it_makes_of_the_radius() -> None:
    """At worst it could shift the radius by 0.1 µm; it shifts it by 5 nm."""
    frame, fit = fitted(replace(Microscope(SCENE), ghosts=((0.08, 9.0, 17.0),)))
    weighed = with_misfit_weighed(frame, fit, OPTICS, FitSettings())
    error = abs(weighed.parameters[Parameter.RADIUS] * SCENE.pixel_size - A)
    u = np.hypot(weighed.model_deviation, weighed.deviation(Parameter.RADIUS)) * SCENE.pixel_size
    assert error < 3.0 * u
    assert u < 0.03e-6
    assert fit.worst_deviation * SCENE.pixel_size > 0.1e-6
    assert weighed.worst_deviation == fit.worst_deviation


def test_errors_of_the_model_make_the_scale_of_the_fringes_doubtful() -> None:
    """Coma in the corner of the frame looks like 1 % of scale, many times what the noise of pixels makes of it."""
    near_corner = (90.3, 80.6)
    frame, start = started(replace(Microscope(SCENE), lens=comet), near_corner)
    fit = fit_contact(frame, start, OPTICS, FitSettings(free=(*USUAL, Parameter.SCALE)))
    place = fit.free.index(Parameter.SCALE)
    scale, chance = fit.parameters[Parameter.SCALE], fit.between * np.sqrt(fit.inverse[place, place])
    assert abs(scale) > 10.0 * chance
    assert abs(scale) < 5.0 * fit.doubts[Parameter.SCALE]
    clean, start = started(Microscope(SCENE), near_corner)
    assert fit_contact(clean, start, OPTICS, FitSettings(free=(*USUAL, Parameter.SCALE))).doubts == {}
