"""Objects in front of the specimen: stated ones are left out, others refuse the subsets that they hide."""

import numpy as np
import pytest

from labpipe.imaging import track
from tests.labpipe.imaging.speckle import Motion, digitise, grey_levels, grid, make_speckle

SIZE = (200, 220)
MIDDLE = np.array([110.0, 100.0])


def behind_a_rod(width: float, tone: float, motions: list[Motion], angle: float = 0.8) -> tuple[np.ndarray, np.ndarray]:
    """Film of speckle behind a rod through the middle, and the polygon around the rod."""
    speckle = make_speckle("medium", SIZE, 4)
    y, x = np.mgrid[: SIZE[0], : SIZE[1]]
    normal = np.array([np.cos(angle), np.sin(angle)])
    share = 1.0 / (1.0 + np.exp(3.0 * (np.abs((x - 110.0) * normal[0] + (y - 100.0) * normal[1]) - 0.5 * width)))
    frames = [(1.0 - share) * grey_levels(speckle, SIZE, motion) + share * tone for motion in motions]
    along, aside = 250.0 * np.array([-normal[1], normal[0]]), (0.5 * width + 1.0) * normal
    ends = [MIDDLE + a * along + b * aside for a, b in ((1, 1), (-1, 1), (-1, -1), (1, -1))]
    return np.stack([digitise(frame, 2.0, 10 + k) for k, frame in enumerate(frames)]), np.array(ends)


FALL = [Motion(0.1 * k, 0.3 * k**2) for k in range(6)]


@pytest.mark.parametrize(("width", "tone"), [(4.0, 20.0), (12.0, 235.0)])
def test_a_stated_obstruction_is_left_out_where_it_stands(width: float, tone: float) -> None:
    film, polygon = behind_a_rod(width, tone, FALL)
    points = grid(SIZE, 34, 11)
    found = track(film, points, obstructions=[polygon])
    error = (np.stack([found.dx, found.dy], axis=-1) - [motion.displacement(points) for motion in FALL])[1:]
    u = np.stack([found.u_dx, found.u_dy], axis=-1)[1:]
    is_part = found.hidden.values[1:] > 0.0
    assert is_part.sum() > 100
    assert found.valid.values[1:][is_part].mean() > 0.98
    assert np.abs(error[is_part] / u[is_part]).max() < 5.0
    assert np.mean(np.abs(error[is_part]) < 2.0 * u[is_part]) == pytest.approx(0.95, abs=0.04)


def test_a_rod_that_nobody_stated_refuses_the_subsets_behind_it() -> None:
    film, _ = behind_a_rod(12.0, 20.0, FALL)
    points = grid(SIZE, 34, 11)
    found = track(film, points)
    far = [k for k, motion in enumerate(FALL) if motion.dy > 2.0]
    distance = np.abs((points - MIDDLE) @ [np.cos(0.8), np.sin(0.8)])
    assert found.valid.values[:, distance > 36.0].all()
    assert not found.valid.values[far][:, distance < 8.0].any()
    names = str(found.status.attrs["flag_meanings"]).split()
    refused = found.status.values[far][:, distance < 16.0]
    assert np.mean(refused == names.index("occluded")) > 0.3
    error = np.stack([found.dx, found.dy], axis=-1) - [motion.displacement(points) for motion in FALL]
    ratio = np.abs(error / np.stack([found.u_dx, found.u_dy], axis=-1))[far]
    assert np.nanmax(ratio) < 5.0


def test_a_subset_that_moves_wholly_behind_an_obstruction_is_found_again_beyond_it() -> None:
    motions = [Motion(8.0 * k, 0.3 * k) for k in range(14)]
    film, polygon = behind_a_rod(50.0, 20.0, motions, 0.0)
    found = track(film, [(40.0, 80.0), (30.0, 120.0)], 21, obstructions=[polygon])
    assert not found.valid.values[8].any()
    assert found.valid.values[[0, 1, 2, -1]].all()
    error = found.dx.values[-1] - motions[-1].dx
    assert np.abs(error).max() < 0.05
