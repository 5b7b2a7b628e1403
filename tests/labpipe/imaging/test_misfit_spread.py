"""What parts of a subset ask for tells how far a misfit that pixels share moves the answer."""

from functools import partial

import numpy as np
import pytest

from labpipe.imaging import track
from pipelines.bench.film_scenes import (
    View,
    blurred_by_camera,
    bricks,
    cells,
    digitised,
    from_spectrum,
    random_field,
    seen_by_pixels,
)
from tests.by_day import by_day

SIZE, WIDTH = 152, 31
AXIS = np.arange(WIDTH, SIZE - WIDTH, 13.0)
POINTS = np.stack([axis.ravel() for axis in np.meshgrid(AXIS, AXIS)], axis=1)
NEAR, FAR = View(defocus=0.6), View(defocus=1.1)
SCENES = {
    "bricks": (lambda seed: partial(seen_by_pixels, bricks(0.35, 12.0, 1.8, seed), SIZE), NEAR),
    "cells": (lambda seed: partial(seen_by_pixels, cells(0.23, 5.1, seed), SIZE), NEAR),
    "cells blurred after sampling": (lambda seed: partial(blurred_by_camera, cells(0.4, 5.5, seed), SIZE), FAR),
    "fine field": (lambda seed: partial(from_spectrum, random_field(SIZE, 1.0, seed)), View()),
}


@pytest.mark.parametrize("name", by_day(SCENES, 2))
def test_of_sharp_patterns_the_uncertainty_is_the_scatter(name: str) -> None:
    make, view = SCENES[name]
    errors, told = [], []
    for seed in (11, 12):
        draw = make(seed)
        views = [view, *(View((0.17 * k, -0.11 * k), defocus=view.defocus) for k in range(1, 6))]
        found = track(digitised([draw(one) for one in views], 1.0, seed), POINTS, WIDTH)
        truth = np.stack([one.displacement(POINTS, SIZE) for one in views])
        errors.append((np.stack([found.dx, found.dy], axis=-1) - truth)[1:])
        told.append(np.stack([found.u_dx, found.u_dy], axis=-1)[1:])
    error, u = np.array(errors), np.array(told)
    assert np.isfinite(error).all()
    assert (np.linalg.norm(error, axis=-1) < 5.0 * np.linalg.norm(u, axis=-1)).all()
    assert np.sqrt((u**2).mean() / (error**2).mean()) == pytest.approx(1.0, abs=0.15)


def test_a_misfit_widens_both_axes_and_what_they_share_alike() -> None:
    """Stripes at 45 degrees that tell little along them; the last frames hold what the reference does not."""
    rng = np.random.default_rng(5)
    across, down = np.meshgrid(*2 * [np.fft.fftfreq(120)])
    smooth = np.exp(-(((down + across) / 0.17) ** 2) - ((down - across) / 0.1) ** 2)
    stripes = np.fft.fft2(rng.normal(size=(120, 120))) * smooth
    scale = 40.0 / np.fft.ifft2(stripes).real.std()
    film = []
    for dx, foreign in ((0.0, 0.0), (0.3, 0.0), (0.6, 15.0), (0.9, 15.0)):
        moved = scale * np.fft.ifft2(stripes * np.exp(-2j * np.pi * (0.7 * down + across) * dx)).real
        more = np.fft.ifft2(np.fft.fft2(rng.normal(size=(120, 120))) * np.exp(-30.0 * (down**2 + across**2))).real
        film.append(120.0 + moved + foreign * more + rng.normal(0.0, 1.0, (120, 120)))
    points = np.stack([axis.ravel() for axis in np.meshgrid(AXIS[:5], AXIS[:5])], axis=1)
    levels = np.clip(np.rint(film), 0, 255).astype(np.uint8)
    plain, found = track(levels[:2], points, 21)[{"frame": 1}], track(levels, points, 21)[{"frame": 3}]
    assert float((found.u_dx / plain.u_dx).min()) > 3.0
    alone, shared = (np.abs(each.cov_dx_dy) / (each.u_dx * each.u_dy) for each in (plain, found))
    assert float(shared.median()) == pytest.approx(float(alone.median()), abs=0.05)
    assert float(shared.max()) < 1.0
