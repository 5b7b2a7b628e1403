"""Blur, light and stretch are solved for where they change, and cost nothing where they do not."""

import json
from dataclasses import replace

import numpy as np
import pytest

from labpipe.imaging import track
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
    assert np.sqrt(np.mean(square_u) / np.mean(square_error)) == pytest.approx(1.0, abs=0.15)


def test_the_uncertainty_of_a_photograph_that_comes_into_focus_counts_what_its_blur_hid() -> None:
    """Edges have all waves: what a blurred reference lacks of them is no noise."""
    pattern = film_scenes.photograph(256)
    points = grid((256, 256), 24, 17)
    views = [View(defocus=1.2), *(View(shift, defocus=0.6) for shift in SHIFTS)]
    found = track(digitised([from_spectrum(pattern, view) for view in views], NOISE, 3), points, 31).isel(
        frame=np.s_[1:]
    )
    truth = np.stack([view.displacement(points, 256) for view in views[1:]])
    ratio = (np.stack([found.dx, found.dy], axis=-1) - truth) / np.stack([found.u_dx, found.u_dy], axis=-1)
    ratio = ratio[found.valid.values]
    assert len(ratio) > 0.9 * found.valid.size
    assert 0.7 < np.sqrt((ratio**2).mean()) < 1.4
    assert (np.abs(ratio) > 5.0).mean() < 0.01


def test_a_change_of_blur_that_noise_hides_in_some_points_is_solved_for_in_all() -> None:
    views = [View(), *(View(shift, smear=(4.0, 0.0)) for shift in SHIFTS)]
    pattern = film_scenes.random_field(SIZE, 2.6, 31)
    found = track(digitised([from_spectrum(pattern, view) for view in views], 2.0, 32), POINTS, 21)
    meanings, masks = str(found.model.attrs["flag_meanings"]).split(), found.model.attrs["flag_masks"]
    blur = masks[meanings.index("blur")]
    assert ((found.model.values[1:] & blur) > 0).mean() > 0.98


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
    assert float(found.blur_growth[1].mean()) == pytest.approx(0.49, rel=0.35)  # to first order
    assert float(found.light_slope_x[2].mean()) == pytest.approx(0.002, rel=0.05)
    assert float(found.light_slope_y[2].mean()) == pytest.approx(-0.001, rel=0.05)
