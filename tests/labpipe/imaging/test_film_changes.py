"""Blur, light and stretch are solved for where they change, and cost nothing where they do not."""

import json
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest

from labpipe.imaging import track
from labpipe.imaging.dic._pattern import make_pattern
from labpipe.imaging.dic._subset_cutting import cut_subsets
from pipelines.bench import film_scenes
from pipelines.bench.film_scenes import View, digitised, from_formula, from_spectrum
from tests.by_day import by_day
from tests.labpipe.imaging.speckle import grid

SIZE, NOISE = 192, 1.0
POINTS = grid((SIZE, SIZE), 32, 14)
SHIFTS = [(0.13 * k + 0.05, 0.07 * k) for k in range(1, 7)]
CHANGES = {
    "out of focus": (View(defocus=0.6), View(defocus=1.2)),
    "into focus": (View(defocus=1.2), View(defocus=0.6)),
    "smeared by 4 px": (View(), View(smear=(4.0, 0.0))),
    "smeared aslant": (View(), View(smear=(2.5, 3.0))),
    "sloping light": (View(), View(light=(1.0, 0.002, -0.001))),
    "stretched by 1 %": (View(), View(scale=1.01)),
    "stretched by 5 %": (View(), View(scale=1.05)),
}


def follow(before: View, after: View, adapt: bool, seed: int) -> tuple[float, float, np.ndarray]:
    """Root mean square of error and of u (px), and the models, of frames that differ from the first."""
    views = [before, *(replace(after, shift=shift) for shift in SHIFTS)]
    if after.scale == 1.0:
        pattern = 0.7 * film_scenes.random_field(SIZE, 1.9, 200 + seed)
        frames = [from_spectrum(pattern, view) for view in views]
    else:
        texture = film_scenes.perlin(7.0, 300 + seed)
        frames = [from_formula(lambda x, y: 0.7 * texture(x, y), SIZE, view) for view in views]
    shape = "auto" if adapt else "rigid"
    found = track(digitised(frames, NOISE, seed), POINTS, 31, shape, adapt=adapt)  # type: ignore[arg-type]
    assert found.valid.all()
    truth = np.stack([view.displacement(POINTS, SIZE) for view in views])
    error = (np.stack([found.dx, found.dy], axis=-1) - truth)[1:]
    u = np.stack([found.u_dx, found.u_dy], axis=-1)[1:]
    return float(np.sqrt((error**2).mean())), float(np.sqrt((u**2).mean())), found.model.values[1:]


@pytest.mark.parametrize("focus", by_day(["same", "other"], 1))
def test_light_that_curves_across_a_subset_is_solved_for(focus: str) -> None:
    """Between 0.7 and 1.3 of it, which curves by 4 % from the middle of a subset to its side."""
    before, after = View(defocus=0.6), View(defocus=0.6 if focus == "same" else 1.1)
    row, column = np.mgrid[:SIZE, :SIZE]
    bowl = 1.0 + 0.3 * np.sin(2.0 * np.pi * (0.95 * column + 0.3 * row) / 192.0)
    square = {}
    for what, light, adapt in (("plain", 1.0, True), ("found", bowl, True), ("lost", bowl, False)):
        views = [before, *(replace(after, shift=shift) for shift in SHIFTS)]
        frames = [from_spectrum(0.8 * film_scenes.random_field(SIZE, 2.2, 41), view) for view in views]
        film = digitised([frames[0], *(light * frame for frame in frames[1:])], NOISE, 42)
        found = track(film, POINTS, 31, "auto" if adapt else "rigid", adapt=adapt)
        truth = np.stack([view.displacement(POINTS, SIZE) for view in views])
        error = (np.stack([found.dx, found.dy], axis=-1) - truth)[1:]
        square[what] = np.nanmean(error**2)
        if what == "found":
            assert found.valid.all()
            masks = dict(zip(found.model.flag_meanings.split(), found.model.flag_masks, strict=True))
            assert ((found.model.values[1:] & masks["curved_light"]) > 0).mean() > 0.8
            z = error / np.stack([found.u_dx, found.u_dy], axis=-1)[1:]
            assert 0.9 < np.sqrt((z**2).mean()) < 1.1
    plain, solved, lost = (np.sqrt(square[what]) for what in ("plain", "found", "lost"))
    assert lost - solved > 0.85 * (lost - plain)


@pytest.mark.parametrize("name", by_day(CHANGES, 3))
def test_what_a_change_costs_is_recovered_and_the_uncertainty_is_right(name: str) -> None:
    before, after = CHANGES[name]
    results = np.array([follow(before, after, True, seed)[:2] for seed in (0, 1)])
    error, u = np.sqrt((results**2).mean(axis=0))
    clean = np.sqrt(np.mean([follow(before, before, True, seed)[0] ** 2 for seed in (0, 1)]))
    lost = np.sqrt(np.mean([follow(before, after, False, seed)[0] ** 2 for seed in (0, 1)]))
    assert lost - error >= 0.75 * (lost - clean)
    assert u == pytest.approx(error, rel=0.1)


@pytest.mark.parametrize(
    ("name", "feature", "subset", "static_frames"),
    by_day(
        [
            ("out of focus", 1.4, 31, 1),
            ("out of focus", 1.4, 31, 8),
            ("smeared by 4 px", 1.4, 31, 1),
            ("smeared by 4 px", 1.9, 31, 8),
            ("smeared aslant", 1.9, 31, 4),
            ("out of focus", 1.9, 61, 4),
        ],
        2,
    ),
)
def test_the_uncertainty_of_a_softer_frame_is_right(name: str, feature: float, subset: int, static_frames: int) -> None:
    before, after = CHANGES[name]
    views = [*(before,) * static_frames, *(replace(after, shift=shift) for shift in SHIFTS)]
    points = grid((SIZE, SIZE), 40, 14)
    square_error, square_u = [], []
    for seed in (0, 1, 2):
        pattern = 0.7 * film_scenes.random_field(SIZE, feature, 400 + seed)
        film = digitised([from_spectrum(pattern, view) for view in views], NOISE, seed)
        found = track(film, points, subset, static_frames=static_frames).isel(frame=slice(static_frames, None))
        truth = np.stack([view.displacement(points, SIZE) for view in views[static_frames:]])
        square_error.append(((np.stack([found.dx, found.dy], axis=-1) - truth) ** 2).mean())
        square_u.append(float((found.u_dx**2 + found.u_dy**2).mean()) / 2)
        assert found.valid.all()
    assert np.sqrt(np.mean(square_u) / np.mean(square_error)) == pytest.approx(1.0, abs=0.1)


def test_the_uncertainty_of_a_photograph_that_comes_into_focus_counts_what_its_blur_hid() -> None:
    """Edges have all waves: what a blurred reference lacks of them is no noise."""
    pattern = film_scenes.photograph(256)
    points = grid((256, 256), 24, 17)
    views = [View(defocus=1.2), *(View(shift, defocus=0.6) for shift in SHIFTS)]
    truth = np.stack([view.displacement(points, 256) for view in views[1:]])
    frames = [from_spectrum(pattern, view) for view in views]
    ratios_of = []
    for seed in (3, 4, 5):  # edges share the noise of the reference: one film tells it to a tenth
        found = track(digitised(frames, NOISE, seed), points, 31).isel(frame=np.s_[1:])
        error = np.stack([found.dx, found.dy], axis=-1) - truth
        ratios_of.append((error / np.stack([found.u_dx, found.u_dy], axis=-1))[found.valid.values])
    ratio = np.concatenate(ratios_of)
    assert len(ratio) > 0.9 * 3 * truth[..., 0].size
    assert 0.85 < np.sqrt((ratio**2).mean()) < 1.15
    assert (np.abs(ratio) > 5.0).sum() == 0


def hard_edged(seed: int) -> dict[str, Callable[[View], np.ndarray]]:
    """Pictures of edges sharper than the pixels, seen through a lens."""
    formulas = {
        "bricks": film_scenes.bricks(0.4 + 0.1 * seed, 14.0, 1.8, seed),
        "cells": film_scenes.cells(0.3 + 0.2 * seed, 5.3, seed),
    }
    return {name: partial(film_scenes.seen_by_pixels, formula, SIZE) for name, formula in formulas.items()}


def ratios(draw: Callable[[View], np.ndarray], before: View, after: View, adapt: bool = True) -> tuple[float, ...]:
    """RMS error (px), RMS of error over u, and the share within 95 % of what a change leaves."""
    views = [before, *(replace(after, shift=shift) for shift in SHIFTS[:3])]
    shape = "auto" if adapt else "rigid"
    found = track(digitised([draw(view) for view in views], NOISE, 5), POINTS, 31, shape, adapt=adapt)  # type: ignore[arg-type]
    truth = np.stack([view.displacement(POINTS, SIZE) for view in views])
    error = (np.stack([found.dx, found.dy], axis=-1) - truth)[1:]
    z = error / np.stack([found.u_dx, found.u_dy], axis=-1)[1:]
    assert found.valid.all()
    return float(np.sqrt((error**2).mean())), float(np.sqrt((z**2).mean())), float((np.abs(z) < 1.96).mean())


@pytest.mark.parametrize(
    ("name", "sigma"),
    by_day([("bricks", (0.6, 1.2)), ("cells", (0.6, 1.2)), ("cells", (0.6, 2.0)), ("bricks", (1.2, 0.6))], 2),
)
def test_hard_edges_that_change_focus_are_matched(name: str, sigma: tuple[float, float]) -> None:
    """A change that the first order misses by half: 27 % had been recovered, and u was twice too large."""
    draw = hard_edged(3)[name]
    before, after = (View(defocus=width) for width in sigma)
    clean = min(ratios(draw, view, view)[0] for view in (before, after))
    lost, _, _ = ratios(draw, before, after, adapt=False)
    error, z, inside = ratios(draw, before, after)
    assert lost - error > 0.7 * (lost - clean)
    assert z < 1.15
    assert inside > 0.92


@pytest.mark.parametrize(("first", "later"), [(0.0, 2.5), (2.5, 0.0), (0.0, 3.5), (1.5, 3.0)])
def test_a_lens_out_of_focus_makes_discs(first: float, later: float) -> None:
    """Taken for Gaussians, they made u of specks up to twice too large, and errors by discs of 3.5 px by half."""
    pattern = 45.0 * np.tanh(film_scenes.random_field(SIZE, 2.2, 47) / 15.0)
    before, after = (View(defocus=0.6, disc=radius) for radius in (first, later))
    draw = partial(from_spectrum, pattern)
    error, z, inside = ratios(draw, before, after)
    softest = max(ratios(draw, view, view)[0] for view in (before, after))
    assert error < 1.05 * softest
    assert 0.9 < z < 1.1
    assert inside > 0.92


@pytest.mark.parametrize(("name", "sigma"), by_day([("field", 5.0), ("field", 6.0), ("bricks", 6.0)], 2))
def test_a_blur_from_one_frame_to_the_next_may_be_as_wide_as_a_pattern_outlives(name: str, sigma: float) -> None:
    """All points but a few were lost beyond 4 px, and some of these were off by a pixel with u of a fifth of it."""
    field = partial(from_spectrum, 45.0 * np.tanh(film_scenes.random_field(SIZE, 2.2, 47) / 15.0))
    draw = {"field": field, **hard_edged(3)}[name]
    error, z, inside = ratios(draw, View(defocus=0.6), View(defocus=sigma))
    assert error < 1.05 * ratios(draw, View(defocus=sigma), View(defocus=sigma))[0]
    assert 0.85 < z < 1.15
    assert inside > 0.92


def test_a_lasting_change_of_focus_is_matched_once() -> None:
    pattern = 0.7 * film_scenes.random_field(SIZE, 1.9, 41)
    views = [View(defocus=0.6), *(View((0.2 * k, 0.1 * k), defocus=1.2) for k in range(1, 9))]
    found = track(digitised([from_spectrum(pattern, view) for view in views], NOISE, 42), POINTS, 31)
    evaluations = found.iterations.mean("point").values
    assert evaluations[1] > 4.0
    assert evaluations[3:].max() < 2.6
    growth = found.blur_growth.values[1:]
    assert growth.mean() == pytest.approx(1.08, rel=0.03)


def test_a_focus_that_never_rests_costs_less_than_twice_the_work(monkeypatch: pytest.MonkeyPatch) -> None:
    """It had been six times: each frame cut three patterns and solved all points with each of them."""
    pattern = 0.7 * film_scenes.random_field(SIZE, 1.9, 43)
    blurs = 0.9 + 0.4 * np.sin(np.arange(1, 25))
    views = [View(defocus=0.6), *(View((0.1 * k, 0.05 * k), defocus=blur) for k, blur in enumerate(blurs, 1))]
    film = digitised([from_spectrum(pattern, view) for view in views], NOISE, 44)
    rest = digitised([from_spectrum(pattern, replace(view, defocus=0.6)) for view in views], NOISE, 44)
    points = grid((SIZE, SIZE), 24, 9)
    made: list[object] = []
    cut: list[int] = []

    def counted(*asked: Any) -> Any:
        made.append(asked[-1])
        return make_pattern(*asked)

    def cut_and_counted(*asked: Any, **more: Any) -> Any:
        cut.append(len(asked[2]))
        return cut_subsets(*asked, **more)

    monkeypatch.setattr("labpipe.imaging.dic._reference.make_pattern", counted)
    monkeypatch.setattr("labpipe.imaging.dic._pattern.cut_subsets", cut_and_counted)
    found, still = (track(frames, points, 31) for frames in (film, rest))
    work, least = (json.loads(result.attrs["work"])["iterations"] for result in (found, still))

    assert work < 2.0 * least
    assert len(made) <= 16
    # points that tell the blur are cut alone of patterns that are only tried
    assert cut.count(len(points)) < len(made)
    truth = np.stack([view.displacement(points, SIZE) for view in views])
    error = (np.stack([found.dx, found.dy], axis=-1) - truth)[1:]
    z = error / np.stack([found.u_dx, found.u_dy], axis=-1)[1:]
    assert np.sqrt((z**2).mean()) == pytest.approx(1.0, abs=0.1)
    assert found.blur_growth.mean("point").values[1:] == pytest.approx(blurs**2 - 0.36, abs=0.06)


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("name", "subset", "noise", "static_frames"),
    [
        (name, *setting)
        for name in ("fine", "usual", "coarse", "Perlin", "photograph", "bricks", "cells")
        for setting in ((21, 2.0, 1), (31, 4.0, 8), (45, 0.5, 1))
        if (name, setting[0]) != ("bricks", 21)  # a brick is 28 px long
    ],
)
def test_the_uncertainty_is_right_whatever_changes(name: str, subset: int, noise: float, static_frames: int) -> None:
    """RMS of error over u, of each change over four seeds."""
    points = grid((SIZE, SIZE), subset // 2 + 12, max(subset // 2, 12))
    near, far = View(defocus=0.6), View(defocus=1.2)
    for before, after in (
        (near, far),
        (far, near),
        (View(defocus=0.8), View(defocus=1.0)),
        (near, View(defocus=2.0)),
        (near, replace(near, smear=(3.3, 2.3))),
        (near, replace(near, light=(0.9, 0.002, -0.001))),
        (near, replace(far, light=(1.1, -0.001, 0.002))),
        (near, near),
    ):
        square, inside = [], []
        for seed in (51, 52, 53, 54):
            draw = pattern_drawn(name, seed)
            is_formula = name in ("bricks", "cells")
            views = [*(before,) * static_frames, *(replace(after, shift=shift) for shift in SHIFTS[:3])]
            if is_formula and any(view.smear[0] for view in views):
                continue
            film = digitised([draw(view) for view in views], noise, 900 + seed)
            found = track(film, points, subset, static_frames=static_frames).isel(frame=np.s_[static_frames:])
            truth = np.stack([view.displacement(points, SIZE) for view in views[static_frames:]])
            z = (np.stack([found.dx, found.dy], axis=-1) - truth) / np.stack([found.u_dx, found.u_dy], axis=-1)
            z = z[found.valid.values]
            assert len(z) > 0.6 * found.valid.size
            square.append(float((z**2).mean()))
            inside.append(float((np.abs(z) < 1.96).mean()))
        if square:
            # of few edges, u counts what they may do between the pixels; and few of their points tell much
            low, high = (0.4, 1.3) if name in ("photograph", "bricks", "cells") else (0.85, 1.15)
            assert low < np.sqrt(np.mean(square)) < high, (before, after)
            assert np.mean(inside) > 0.9, (before, after)


def pattern_drawn(name: str, seed: int) -> Callable[[View], np.ndarray]:
    """Pictures of a pattern of some making."""
    if name in ("bricks", "cells"):
        return hard_edged(seed)[name]
    if name == "photograph":
        return partial(from_spectrum, film_scenes.photograph(SIZE))
    if name == "Perlin":
        row, column = np.mgrid[:SIZE, :SIZE].astype(float)
        whole = film_scenes.perlin(7.0, seed)(column, row)
        return partial(
            from_spectrum,
            np.block([[whole[:96, :96], whole[:96, 95::-1]], [whole[95::-1, :96], whole[95::-1, 95::-1]]]),
        )
    feature = {"fine": 1.4, "usual": 2.0, "coarse": 2.8}[name]
    return partial(from_spectrum, 0.8 * film_scenes.random_field(SIZE, feature, seed))


def test_a_change_of_blur_that_noise_hides_in_some_points_is_solved_for_in_all() -> None:
    views = [View(), *(View(shift, smear=(4.0, 0.0)) for shift in SHIFTS)]
    pattern = film_scenes.random_field(SIZE, 2.6, 31)
    found = track(digitised([from_spectrum(pattern, view) for view in views], 2.0, 32), POINTS, 21)
    meanings, masks = str(found.model.attrs["flag_meanings"]).split(), found.model.attrs["flag_masks"]
    blur = masks[meanings.index("blur")]
    assert ((found.model.values[1:] & blur) > 0).mean() > 0.98


def test_points_asked_to_be_rigid_take_off_the_strain_that_they_miss_and_say_so() -> None:
    texture = film_scenes.perlin(7.0, 17)
    for scale in (1.0, 1.02):
        views = [View(), *(View(shift, scale=scale) for shift in SHIFTS[:3])]
        film = digitised([from_formula(lambda x, y: 0.7 * texture(x, y), SIZE, view) for view in views], NOISE, 18)
        found = {shape: track(film, POINTS, 31, shape) for shape in ("rigid", "auto")}
        assert ('shape "auto" or "affine"' in found["rigid"].note) == (scale != 1.0)
        assert not found["auto"].note
        truth = np.stack([view.displacement(POINTS, SIZE) for view in views])[1:]
        error = {shape: np.stack([own.dx, own.dy], axis=-1)[1:] - truth for shape, own in found.items()}
        assert np.std(error["rigid"]) < 1.3 * np.std(error["auto"])
        z = error["rigid"] / np.stack([found["rigid"].u_dx, found["rigid"].u_dy], axis=-1)[1:]
        assert np.abs(z).max() < 4.5
        assert np.sqrt((z**2).mean()) < 1.1


def test_nothing_is_solved_for_that_is_not_needed() -> None:
    film = digitised(
        [from_spectrum(0.7 * film_scenes.random_field(SIZE, 1.9, 7), View(shift)) for shift in [(0.0, 0.0), *SHIFTS]],
        NOISE,
        8,
    )
    found = track(film, POINTS, 31)
    plain = track(film, POINTS, 31, "rigid", adapt=False)
    assert (found.model[1:] == 0).mean() > 0.99
    counts = [json.loads(result.attrs["work"])["iterations"] for result in (found, plain)]
    assert counts[0] <= 1.03 * counts[1]
    assert np.nanmax(np.abs((found.dx - plain.dx).where(found.model == 0))) < 1e-3


def test_the_change_itself_is_told() -> None:
    views = [View(), View((0.3, 0.1), defocus=0.7), View((0.6, 0.2), light=(1.0, 0.002, -0.001))]
    pattern = 0.7 * film_scenes.random_field(SIZE, 1.9, 9)
    found = track(digitised([from_spectrum(pattern, view) for view in views], NOISE, 19), POINTS, 31)
    assert float(found.blur_growth[1].mean()) == pytest.approx(0.49, rel=0.06)
    assert float(found.light_slope_x[2].mean()) == pytest.approx(0.002, rel=0.05)
    assert float(found.light_slope_y[2].mean()) == pytest.approx(-0.001, rel=0.05)


@pytest.mark.parametrize("after", [View(defocus=2.5), View(defocus=0.6, smear=(6.5, 4.6))], ids=["focus", "smear"])
def test_what_a_wide_blur_leaves_is_not_taken_for_noise(after: View) -> None:
    """In the first frames nothing bounded it: noise of the reference, which the frame lacks, also looks like a blur."""
    draw = partial(from_spectrum, 0.8 * film_scenes.random_field(SIZE, 2.4, 61))
    error, z, _ = ratios(draw, View(defocus=0.6), after)
    assert error < 1.05 * ratios(draw, after, after)[0]
    assert 0.85 < z < 1.15
