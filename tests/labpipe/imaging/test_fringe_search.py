"""What it costs to find out why a film's fringes are not those of a plain contact, and what tells it."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

from labpipe.arrays import Floats
from labpipe.imaging import contact_radius
from labpipe.imaging.fringes import _gains, _optics_search, _ring_fit, _scale_of_contacts, _second_colour, _trial_fits
from labpipe.imaging.fringes._fingerprint import round_share
from labpipe.imaging.fringes._interference import make_optics
from labpipe.imaging.fringes._ring_fit import FitSettings
from labpipe.imaging.fringes._ring_noise import _from_gap, slow_power
from labpipe.imaging.fringes._ring_parameters import AXES, BEAMS, LIGHT as POWERS, PARAMETERS, RADIAL, USUAL, Parameter
from labpipe.imaging.fringes._ring_sums import Sums
from labpipe.imaging.fringes._trials import Calibration
from labpipe.imaging.fringes._view import View
from tests.by_day import by_day
from tests.labpipe.imaging.contact_optics import Microscope, bell, comet, oval
from tests.labpipe.imaging.contact_scenes import Disturbed, film_of, gap_of_jkr
from tests.labpipe.imaging.fringe_film import Scene

UM = 1e-6
SPHERE, LIGHT = 9.525e-3, 633e-9
PLAIN = Microscope(Scene(rows=260, columns=280))
CENTRE = (141.2, 128.3)
RADII = [152 * UM, 171 * UM, 180 * UM, 186 * UM]

#: A microscope, and how many times the pixels of a plain film may be evaluated in one of four frames.
CASES = {
    "coma": (replace(PLAIN, lens=comet), 4.2),
    "astigmatism": (replace(PLAIN, lens=oval(2.0, 0.8, 0.3)), 6.5),
    "blur": (replace(PLAIN, lens=oval(2.5, 2.5, 0.0)), 4.5),
    "strong blur": (replace(PLAIN, lens=oval(5.0, 5.0, 0.0)), 6.0),
    "many beams": (replace(PLAIN, faces=(0.5, 0.5, 0.0)), 5.5),
    "ghost": (replace(PLAIN, ghosts=((0.08, 9.0, 17.0),)), 6.5),
    "light of a bell": (replace(PLAIN, beam=bell(0.6, 0.3, -0.2)), 2.5),
}

#: The same of a single frame of a ghost beside a blur; it took 21 times as many, and takes 5.0.
MOST_BESIDE_GHOST = 6.7


def hertz(r: Floats, a: float) -> Floats:
    return gap_of_jkr(r, a, SPHERE, 5e9, 0.0)


def measure(microscope: Microscope, seed: int = 4, radii: list[float] = RADII) -> Floats:
    """Errors of the radii in standard uncertainties."""
    film = microscope.film(hertz, radii, CENTRE, seed)
    found = contact_radius(film, microscope.scene.pixel_size, SPHERE, LIGHT)
    assert (found.method == 1).all()
    return np.asarray((found.radius - radii) / np.hypot(found.u_radius, found.radius_systematic))


@pytest.fixture
def evaluated(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Pixels of every evaluation of a ring."""
    sums, made = _ring_fit.ring_sums, list[int]()

    def counted(*arguments: object) -> Sums:
        found = sums(*arguments)  # type: ignore[arg-type]
        made.append(found.pixels)
        return found

    monkeypatch.setattr(_ring_fit, "ring_sums", counted)
    return made


@pytest.mark.parametrize("name", by_day(sorted(CASES), 3))
def test_what_is_not_plain_costs_a_few_times_a_plain_film(evaluated: list[int], name: str) -> None:
    """Pixels that are evaluated; each bound is a third above what was measured; coma took 9 times as many."""
    microscope, most = CASES[name]
    measure(PLAIN)
    plain = sum(evaluated)
    evaluated.clear()
    assert np.abs(measure(microscope)).max() < 3.0
    assert sum(evaluated) < most * plain, sum(evaluated) / plain


@pytest.mark.parametrize(
    ("name", "is_round"),
    by_day([("blur", True), ("many beams", True), ("coma", False), ("astigmatism", False), ("ghost", False)], 3),
)
def test_what_is_left_goes_evenly_around_the_rings_or_not(
    monkeypatch: pytest.MonkeyPatch, name: str, is_round: bool
) -> None:
    shares: list[float] = []

    def told(*arguments: object) -> float:
        shares.append(round_share(*arguments))  # type: ignore[arg-type]
        return shares[-1]

    monkeypatch.setattr(_gains, "round_share", told)
    measure(CASES[name][0])
    assert (shares[0] > 0.8) if is_round else (shares[0] < 0.3), shares


@pytest.mark.parametrize("phase", [np.pi, 2.2])
def test_an_ellipse_is_not_compared_with_circles_of_other_optics(monkeypatch: pytest.MonkeyPatch, phase: float) -> None:
    """Its edge shows it; a third of the time of a single frame went into circles of every phase and scale."""
    asked: list[object] = []
    monkeypatch.setattr(_optics_search, "find_optics", lambda *arguments, **_: asked.append(arguments))
    scene = Disturbed(PLAIN.scene.change(phase=phase), ellipse=0.04)
    film = film_of(scene, hertz, RADII[-1:], CENTRE, seed=3)
    found = contact_radius(film, PLAIN.scene.pixel_size, SPHERE, LIGHT)
    assert (found.method == 1).all()
    assert abs(found.radius.item() - RADII[-1]) < 3.0 * np.hypot(found.u_radius, found.radius_systematic).item()
    assert asked == []


def count_fits(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Evaluations of all fits that follow."""
    made: list[int] = []
    fit_ring = _ring_fit.fit_ring

    def counted(*arguments: Any) -> _ring_fit.RingFit:
        fit = fit_ring(*arguments)
        made.append(fit.evaluations)
        return fit

    monkeypatch.setattr(_ring_fit, "fit_ring", counted)
    return made


@pytest.mark.parametrize("softness", [0.3, 2.0, 5.0])
def test_a_disc_without_rings_goes_to_the_edge_at_once(monkeypatch: pytest.MonkeyPatch, softness: float) -> None:
    """Blur, travel and harmonics were fitted to it in some frames of a film, at up to 36 times a plain film's cost."""
    y, x = np.mgrid[:260, :280]
    away = np.hypot(x - CENTRE[0], y - CENTRE[1])
    noise = np.random.default_rng(7).normal(0.0, 4.0, (6, *away.shape))
    radii = np.linspace(50.0, 75.0, 6)
    film = 90.0 + 40.0 * np.tanh((away - radii[:, None, None]) / softness) + noise
    made = count_fits(monkeypatch)
    with pytest.warns(UserWarning, match="measured by the edge of the spot"):
        found = contact_radius(np.rint(film).astype(np.uint8), 2e-6, SPHERE, LIGHT)
    assert (found.method == 2).all()
    assert sum(made) < 50 * len(film)  # 217 to 370 when all was tried
    assert float(found.attrs["blur"]) == float(found.attrs["flat_radius"]) == 0.0


def test_what_hides_a_part_of_the_rings_leaves_the_others() -> None:
    """Found by its rings beside the edge of something dark, where it was left to the edge of its spot."""
    film = film_of(Disturbed(PLAIN.scene), hertz, RADII, CENTRE, seed=5)
    x = np.arange(film.shape[2])
    reach = CENTRE[0] + 0.5 * np.array(RADII) / PLAIN.scene.pixel_size
    dark = np.random.default_rng(5).normal(30.0, 4.0, film.shape)
    film = np.where(x > reach[:, None, None], np.rint(dark), film).astype(np.uint8)
    found = contact_radius(film, PLAIN.scene.pixel_size, SPHERE, LIGHT)
    assert (found.method == 1).all()
    assert np.abs((found.radius - RADII) / np.hypot(found.u_radius, found.radius_systematic)).max() < 3.0


@pytest.mark.parametrize(
    ("share", "told"),
    [(0.6, ((Parameter.SCALE,), BEAMS, POWERS)), (0.9, ((Parameter.SCALE,), BEAMS)), (0.3, (POWERS,))],
)
def test_explanations_are_tried_once_and_where_what_is_left_goes_around_the_rings_as_theirs(
    monkeypatch: pytest.MonkeyPatch, share: float, told: tuple[tuple[Parameter, ...], ...]
) -> None:
    """Beside free axes another scale is the same with axes as without; what goes by the distance is even all around."""
    tried: list[frozenset[Parameter]] = []
    monkeypatch.setattr(_trial_fits, "_trial", lambda *arguments: tried.append(frozenset(arguments[3])))
    monkeypatch.setattr(_trial_fits, "Gains", lambda *_: Mock(round_share=share, share=lambda _: 1.0))
    ways = (AXES, (*AXES, Parameter.SCALE), (Parameter.SCALE,), BEAMS, (*AXES, *BEAMS), POWERS)
    settings = FitSettings(free=(*USUAL, *AXES))
    view = View(make_optics(2e-6, SPHERE, LIGHT), settings, (9, 9), 0.0, 255.0, alternatives=ways)
    usual = Mock(misfit=0.5, has_negative_light=False)
    assert _trial_fits._otherwise(np.zeros((2, 2)), view, np.zeros(1), usual) is usual
    assert tried == [frozenset((*USUAL, *AXES, *extra)) for extra in told]


@pytest.mark.parametrize(("misfit", "share", "is_edge"), [(0.1, 0.3, False), (0.4, 0.9, False), (0.1, 0.9, True)])
def test_two_colours_are_sought_only_where_one_nearly_explains_what_goes_around_the_rings(
    monkeypatch: pytest.MonkeyPatch, misfit: float, share: float, is_edge: bool
) -> None:
    """Of a contact that something hides, or without rings, twelve colours at every spot took half the time."""
    fits: list[object] = []
    one = Mock(misfit=misfit, residual=1.0)
    looks = Mock(spots=[Mock(), Mock()])
    monkeypatch.setattr(_second_colour, "shows_edge", lambda *_: is_edge)
    monkeypatch.setattr(_second_colour, "start_at_edge", lambda *_: np.zeros(PARAMETERS))
    monkeypatch.setattr(_second_colour, "fit_contact", lambda *_: fits.append(one) or one)
    monkeypatch.setattr(_second_colour, "round_share", lambda *_: share)
    view = View(make_optics(2e-6, SPHERE, LIGHT), FitSettings(), (9, 9), 0.0, 255.0)
    assert _second_colour.find_colours(looks, view, is_phase_free=False) is None
    assert len(fits) == 2


@pytest.mark.parametrize(
    ("one", "excess", "is_settled"), [(1e-2, 1e-4, True), (1e-2, 1e-3, False), (1e-4, 9e-5, False)]
)
def test_a_second_colour_that_leaves_much_of_some_pixels_is_not_sought_in_all(
    monkeypatch: pytest.MonkeyPatch, one: float, excess: float, is_settled: bool
) -> None:
    """Light of low coherence looks like one; fourteen fits of all pixels of each frame only said that it is none."""
    known, best = Calibration(), Mock(excess=1e-2, is_doubtful=True)
    settled = Mock(return_value=None)
    monkeypatch.setattr(_second_colour, "settle_colour", settled)
    monkeypatch.setattr(_second_colour, "is_promising", lambda *_: True)

    def attempt(_: object, seen: Calibration, *some: int) -> Mock:
        assert len(some) == 2  # frames and pixels
        ratio, share = seen.colour
        return Mock(
            excess=excess if share else one, left=1e4 * (1.0 + (ratio - 1.1) ** 2 + (share - 0.25) ** 2 + (not share))
        )

    assert _second_colour.find_second_colour(attempt, (), known, best) is None
    assert settled.called is is_settled


def test_frames_are_searched_for_a_scale_only_while_two_can_agree(monkeypatch: pytest.MonkeyPatch) -> None:
    """A single one never told it, and took two fifths of the time of a disc without rings."""
    asked: list[object] = []
    monkeypatch.setattr(_scale_of_contacts, "find_optics", lambda looks, *_, **__: asked.append(looks.frame))
    reader = Mock(whole=lambda index: index)
    for frames, most in (([7], 0), ([7, 8], 1), ([7, 8, 9], 2)):
        asked.clear()
        assert _scale_of_contacts._searched(reader, frames, Mock(), 0.0) == {}
        assert asked == frames[:most]


def test_some_of_the_pixels_are_asked_for_what_they_leave_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """The last sums of a fit hold covariances of what is fitted, and slopes by what is asked for: the costliest."""
    told: list[tuple[int, int]] = []
    sums = _ring_fit.ring_sums

    def counted(*arguments: Any) -> Sums:
        found = sums(*arguments)
        if len(arguments) > 4 and arguments[4]:
            told.append((found.pixels, len(arguments[2]) - len(found.weighted)))
        return found

    monkeypatch.setattr(_ring_fit, "ring_sums", counted)
    measure(CASES["blur"][0])
    few = [beside for pixels, beside in told if pixels < 14_000]
    whole = {beside for pixels, beside in told if pixels > 20_000}
    asked = [beside for beside in few if beside]
    assert set(asked) == {len({*RADIAL, *AXES})}  # where all explanations are asked for at once, and nowhere else
    assert len(asked) <= 2 * len(RADII)
    assert max(whole) > 0


def test_what_noise_with_a_memory_hides_is_fitted_where_the_squares_promise_it(evaluated: list[int]) -> None:
    """A ghost beside a blur: whatever lowered the squares by half of what pixels' noise asks for was fitted in vain."""
    ghost = replace(PLAIN, ghosts=((0.1, 7.0, -15.0),), lens=oval(1.2, 1.2, 0.0))
    counts = []
    for microscope in (PLAIN, ghost):
        evaluated.clear()
        assert np.abs(measure(microscope, radii=RADII[-1:])).max() < 3.0
        counts.append(sum(evaluated))
    assert counts[1] < MOST_BESIDE_GHOST * counts[0], counts[1] / counts[0]


def test_rings_of_which_a_part_is_not_seen_tell_noise_from_errors_all_at_once() -> None:
    """As whole ones do, their sectors in their order from the end of the widest gap on."""
    sectors = np.arange(48)
    counts = np.full((9, 48), 8.0)
    counts[3:6, 40:] = counts[6:8, 44:] = counts[6:8, :7] = counts[8, 20:24] = 0.0
    noise = np.random.default_rng(2).standard_normal((9, 48)) * np.sqrt(8.0)
    slow = counts * 3.0 * np.cos(2.0 * np.pi * sectors / 48 + 0.3)
    is_seen = counts > 0.0
    assert slow_power(noise * is_seen, counts) == 0.0
    assert slow_power(noise * is_seen + slow, counts) == pytest.approx(np.mean((slow / 8.0)[is_seen] ** 2), rel=0.05)
    order = _from_gap(is_seen)
    assert order[0].tolist() == sectors.tolist()
    assert order[3, :40].tolist() == sectors[:40].tolist()
    assert order[6, :37].tolist() == sectors[7:44].tolist()
    assert order[8, :44].tolist() == [*range(24, 48), *range(20)]


def test_a_film_in_which_no_error_of_the_model_is_seen_asks_for_none(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Callable[..., object]] = []
    monkeypatch.setattr(_gains, "round_share", asked.append)
    assert np.abs(measure(PLAIN)).max() < 3.0
    assert asked == []


def test_small_contacts_show_together_a_blur_that_none_shows_alone() -> None:
    """Nothing larger stands beside them: what all show was left out, with errors of 4 to 5 standard uncertainties."""
    blurred = replace(PLAIN, lens=oval(1.0, 1.0, 0.0))
    errors = np.array([measure(blurred, seed, [40 * UM, 42 * UM, 44 * UM]) for seed in (1, 2, 3)])
    assert np.sqrt(np.mean(errors**2)) < 2.0, errors
    assert np.abs(errors).max() < 3.5, errors


@pytest.mark.parametrize("wrong", [1.05, 0.95])
def test_one_contact_that_recedes_does_not_hide_a_wrong_sphere(wrong: float) -> None:
    """Its gap opens 13 % less than Hertz's; with it the scales of all frames scattered so that none was believed."""
    radii = [140 * UM, 155 * UM, 166 * UM, 175 * UM, 181 * UM, 184 * UM, 179 * UM]
    factors = iter([1.0] * 6 + [0.87])
    film = PLAIN.film(lambda r, a: next(factors) * hertz(r, a), radii, CENTRE, 6)
    with pytest.warns(UserWarning, match="check sphere_radius, wavelength and pixel_size"):
        found = contact_radius(film, PLAIN.scene.pixel_size, wrong * SPHERE, LIGHT)
    assert found.attrs["phase_scale_ratio"] == pytest.approx(wrong, rel=3e-3)
    assert found.method.values.tolist() == [1] * 6 + [5]
    assert np.abs(found.radius.values - radii).max() < 0.1 * UM


def test_the_note_counts_the_frames_without_a_contact() -> None:
    film = PLAIN.film(hertz, RADII[:2], CENTRE, 5)
    apart = PLAIN.film(lambda r, a: r**2 / (2.0 * SPHERE) + 0.3 * UM, [1.0 * UM] * 2, CENTRE, 6)
    found = contact_radius(np.concatenate([film, apart]), PLAIN.scene.pixel_size, SPHERE, LIGHT)
    assert found.attrs["note"] == "fringes fitted in 2 of the frames looked at; 2 others show no contact"
