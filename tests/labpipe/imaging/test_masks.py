"""Polygons that say which pixels of the first frame count."""

import numpy as np
import pytest

from labpipe.errors import InputError
from labpipe.imaging import track
from pipelines.rig.speckle import Holder, Pose, draw, make_holder
from tests.labpipe.imaging.speckle import digitise

ROWS, COLUMNS, RIM = 120, 160, 80
POSES = [Pose(0.12 * k, 0.05 * k**2, 5e-4 * k, (40.0, 60.0)) for k in range(7)]
LEFT_OF_THE_RIM = [(0, 0), (RIM, 0), (RIM, ROWS - 1), (0, ROWS - 1)]
RIGHT_OF_THE_RIM = [(RIM, -5), (COLUMNS + 5, -5), (COLUMNS + 5, ROWS + 5), (RIM, ROWS + 5)]
AT_THE_RIM = [(74.0, 40.0), (74.0, 80.0), (40.0, 60.0)]


def falling_before_a_wall(wall: str = "speckled") -> np.ndarray:
    """Film of a speckled holder whose right rim is at column 80, before what stands still."""
    holder, other = make_holder(ROWS, COLUMNS, 8.0, 21), make_holder(ROWS, COLUMNS, 8.0, 22)
    holder = Holder(holder.x, holder.y, holder.width, holder.offset, holder.gain, -50.0, float(RIM))
    behind = draw(other, ROWS, COLUMNS, Pose()) if wall == "speckled" else np.full((ROWS, COLUMNS), 245.0)
    across = np.arange(COLUMNS)[None, :]
    rows = np.arange(ROWS)[:, None]
    frames = []
    for pose in POSES:
        rim = RIM + pose.dx - pose.rotation * (rows - pose.pivot[1])
        share = 0.5 * (1.0 + np.tanh((rim - across) / 0.8))
        whole = Holder(holder.x, holder.y, holder.width, holder.offset, holder.gain, -50.0, COLUMNS + 50.0)
        frames.append(share * draw(whole, ROWS, COLUMNS, pose) + (1.0 - share) * behind)
    return np.stack([digitise(frame, 2.0, 23 + k) for k, frame in enumerate(frames)])


def truth(points: list[tuple[float, float]]) -> np.ndarray:
    places = np.array(points)
    return np.stack([np.stack(pose.moved(*places.T), axis=1) - places for pose in POSES])


@pytest.mark.parametrize(
    ("wall", "mask"), [("speckled", {"regions": [LEFT_OF_THE_RIM]}), ("white", {"covers": [RIGHT_OF_THE_RIM]})]
)
def test_a_subset_over_the_rim_of_the_holder_uses_what_is_on_it(wall: str, mask: dict[str, list]) -> None:
    film = falling_before_a_wall(wall)
    found = track(film, AT_THE_RIM, 31, **mask)
    error = (np.stack([found.dx, found.dy], axis=-1) - truth(AT_THE_RIM))[1:]
    u = np.stack([found.u_dx, found.u_dy], axis=-1)[1:]
    assert found.valid.all()
    assert np.abs(error / u).max() < 4.5
    # two thirds of the pixels are left, and u says so
    assert 1.1 < float(u[:, :2].mean() / u[:, 2].mean()) < 2.0


def test_the_wall_does_not_hold_back_a_holder_that_jumps() -> None:
    """Template matches look for what counts, not for the wall that stayed."""
    film = falling_before_a_wall()
    jumped = np.concatenate([film[:1], np.full_like(film[:1], 100)])
    shift = 14
    jumped[1, shift:, :RIM] = film[0, :-shift, :RIM]
    jumped[1, :, RIM:] = film[0, :, RIM:]
    found = track(jumped, AT_THE_RIM[:1], 31, regions=[LEFT_OF_THE_RIM])
    assert float(found.dy[1, 0]) == pytest.approx(shift, abs=0.05)


def test_a_subset_that_is_covered_has_no_value() -> None:
    found = track(falling_before_a_wall(), [(120.0, 60.0), (40.0, 60.0)], 31, regions=[LEFT_OF_THE_RIM])
    names = str(found.status.attrs["flag_meanings"]).split()
    assert names[int(found.status[2, 0])] == "covered"
    assert not found.valid[:, 0].any()
    assert found.valid[:, 1].all()


def test_several_polygons_of_a_kind_are_taken_together() -> None:
    film = falling_before_a_wall()
    halves = [[(0, 0), (RIM, 0), (RIM, 62), (0, 62)], [(0, 58), (RIM, 58), (RIM, ROWS - 1), (0, ROWS - 1)]]
    found = track(film, AT_THE_RIM, 31, regions=halves)
    assert found.dx.identical(track(film, AT_THE_RIM, 31, regions=[LEFT_OF_THE_RIM]).dx)
    screw = [(55, 55), (65, 55), (65, 65), (55, 65)]
    both = track(film, [(60.0, 60.0)], 31, regions=halves, covers=[screw, RIGHT_OF_THE_RIM])
    whole = track(film, [(60.0, 60.0)], 31, regions=halves)
    assert float(both.u_dx[1, 0]) > 1.1 * float(whole.u_dx[1, 0])


@pytest.mark.parametrize(
    ("mask", "message"),
    [
        ({"covers": [[(0, 0), (9, 0), (0, float("nan"))]]}, "covers must hold polygons of three or more .* polygon 1"),
        ({"regions": []}, "regions holds no polygon"),
        (
            {"obstructions": [[(20, 2), (50, 56), (50, 2), (20, 56)]]},
            "obstructions: polygon 1 crosses itself, its sides from corner 1 and",
        ),
        (
            {"covers": [[(0, 0), (9, 0), (0, 9)], [(300, 0), (400, 0), (400, 50)]]},
            r"covers: no pixel lies in polygon 2, x 300 to 400 px, y 0 to 50 px; the frames are 60 px wide",
        ),
    ],
)
def test_polygons_that_cannot_be_meant_are_refused(mask: dict[str, list], message: str) -> None:
    with pytest.raises(InputError, match=message):
        track(np.zeros((2, 60, 60), np.uint8), [(30, 30)], **mask)
