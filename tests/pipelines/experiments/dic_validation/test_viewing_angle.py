"""A camera that is turned or looks up at the fall: what the film shows of it, and lengths all the same."""

import json
import math
from datetime import date
from pathlib import Path

import cv2
import numpy as np
import pytest
import xarray as xr

from labpipe import files
from labpipe.units import Quantity
from pipelines.experiments.dic_validation import measured
from pipelines.experiments.dic_validation.page import camera_angle
from pipelines.experiments.dic_validation.settings import DicValidation, Tracking
from pipelines.experiments.dic_validation.viewing_angle import Seen, along, seen, sources
from pipelines.rig.session_text import front_record
from tests.labpipe.imaging.speckle import waves

PIXEL = 30e-3 / 386
ROWS, COLUMNS, TRAVEL, RATE, STILL = 160, 90, 50.0, 1000.0, 6


def fall(frames: int) -> np.ndarray:
    """Displacement (frame,) in px downwards: rest, free fall, rest below."""
    share = np.clip((np.arange(frames) - STILL) / (0.7 * frames - STILL), 0.0, 1.0) ** 2
    return TRAVEL * share


def filmed(folder: Path, roll: float, tilt: float, distance: float, frames: int = 40, sink: float = 0.0) -> np.ndarray:
    """Write images of a falling plane through a pinhole; returns its displacement [m].

    ``roll``, ``tilt`` [rad] turn the camera, ``distance`` [m] is that of the plane, and ``sink`` the
    slope by which the body moves towards the camera.
    """
    folder.mkdir()
    pattern = waves(3)
    rng = np.random.default_rng(4)
    row, column = np.mgrid[:ROWS, :COLUMNS].astype(float)
    far = distance / PIXEL
    x, y = (column - 0.5 * (COLUMNS - 1)) / far, (row - 0.5 * (ROWS - 1)) / far
    x, y = math.cos(roll) * x - math.sin(roll) * y, math.sin(roll) * x + math.cos(roll) * y
    y, z = math.cos(tilt) * y - math.sin(tilt), math.sin(tilt) * y + math.cos(tilt)
    moved = fall(frames)
    for k, down in enumerate(moved):
        depth = (far * math.cos(tilt) - sink * down) / z
        grey = 127 + 40.0 * pattern(depth * x + 200, depth * y + far * math.sin(tilt) - down + 200)
        noisy = grey + rng.standard_normal(grey.shape)
        cv2.imwrite(str(folder / f"{k:04d}.png"), np.clip(np.rint(noisy), 0, 255).astype(np.uint8))
    return -moved * PIXEL


def found(
    tmp_path: Path, camera_distance: Quantity | None = None, **scene: float
) -> tuple[xr.Dataset, np.ndarray, dict[str, str]]:
    """Motion as measured, the true one, and what the page says of the camera's angle."""
    true = filmed(tmp_path / "film", **scene)
    record = tmp_path / "camera_front.toml"
    files.write_text(record, front_record())
    settings = DicValidation(
        kind="dic_validation",
        film="film",
        camera="camera_front.toml",
        measured_on=date(2024, 6, 1),
        frame_rate=Quantity(RATE, 0.0, "Hz"),
        camera_distance=camera_distance,
        tracking=Tracking(body=(44.0, 50.0), body_subset=51, static_frames=STILL),
    )
    track = measured.track(tmp_path / "film", settings=settings, full=True)
    moved = measured.motion(track, record, settings=settings)
    return moved, true, {row[0]: f"{row[1]}; {row[2]}" for row in camera_angle(moved, camera_distance)}


def relative(moved: xr.Dataset, true: np.ndarray) -> float:
    return float(moved["displacement"][-5:].mean()) / float(true[-5:].mean()) - 1.0


def rows(moved: xr.Dataset) -> dict[str, float]:
    return {row["source"]: row["u"] for row in json.loads(moved.attrs["budget"])}


@pytest.mark.parametrize("degrees", [0.0, 4.0, -8.0])
def test_a_turned_camera_is_told_and_costs_no_length(tmp_path, degrees):
    moved, true, told = found(tmp_path, roll=math.radians(degrees), tilt=0.0, distance=10.0)
    # a camera that is turned clockwise sees what rises go to the left
    error = float(moved["direction"]) + math.radians(degrees)
    assert abs(error) < 3 * float(moved["u_direction"]) + 1e-4
    assert abs(relative(moved, true)) < 3e-4
    assert rows(moved).get("direction of motion", 0.0) == pytest.approx(
        (1 - math.cos(math.radians(degrees))) / 3**0.5, abs=1e-5
    )
    assert "displacements are along it" in told["motion, to the image's columns"]
    assert "none seen" in told["tilt of the camera"]


@pytest.mark.parametrize("degrees", [4.0, -10.0])
def test_a_camera_that_looks_up_or_down_costs_no_length_where_its_distance_is_stated(tmp_path, degrees):
    scene = {"roll": 0.0, "tilt": math.radians(degrees), "distance": 0.2}
    moved, true, told = found(tmp_path, Quantity(0.2, 0.005, "m"), **scene)
    assert abs(float(moved["tilt"]) - abs(math.radians(degrees))) < 3 * float(moved["u_tilt"])
    u = np.hypot(rows(moved)["tilt of the camera"], rows(moved)["scale along the motion"])
    assert abs(relative(moved, true)) < 3 * u
    assert "divided by its cosine" in told["tilt of the camera, up or down"]


def test_without_the_distance_a_tilt_is_budgeted(tmp_path):
    moved, true, told = found(tmp_path, roll=0.0, tilt=math.radians(10.0), distance=0.3)
    assert relative(moved, true) < -0.01
    assert abs(relative(moved, true)) < 3 * rows(moved)["tilt of the camera"]
    assert "for a distance of 300 mm; not corrected" in told["tilt of the camera, up or down"]


def test_a_holder_that_comes_closer_is_no_tilt(tmp_path):
    moved, true, _ = found(tmp_path, roll=0.0, tilt=0.0, distance=0.2, sink=0.15)
    assert float(moved["tilt"]) < 3 * float(moved["u_tilt"]) < 0.1
    assert abs(float(moved["growth"])) == pytest.approx(0.15 / 0.2, rel=0.1)
    assert abs(relative(moved, true)) < 3 * rows(moved)["scale along the motion"]


def test_noise_across_the_columns_counts_by_the_sine_of_the_turn():
    across, up = np.array([1e-3, 2e-3]), np.array([4e-3, 5e-3])
    body = xr.Dataset(
        {
            name: ("frame", values)
            for name, values in (
                ("displacement_x", across), ("displacement_y", up), ("u_displacement_x", 3 * across),
                ("u_displacement_y", 2 * up),
            )
        }
    )  # fmt: skip
    moved, noise = along(body, Seen(is_known=True, direction=0.3, tilt=0.2))
    cosine, sine = math.cos(0.3) / math.cos(0.2), math.sin(0.3) / math.cos(0.2)
    np.testing.assert_allclose(moved, cosine * up + sine * across)
    np.testing.assert_allclose(noise, np.sqrt((cosine * 2 * up) ** 2 + (sine * 3 * across) ** 2))


@pytest.mark.parametrize("drift", [0.0, 3e-3, -0.5e-3])
def test_an_image_that_creeps_aside_is_no_turn(drift):
    time = np.arange(240) / 4000
    fall = -0.5 * 9.81 * np.clip(time - 0.02, 0.0, None) ** 2
    noise = 2e-7 * np.random.default_rng(7).normal(size=(2, time.size))
    slope = math.tan(math.radians(2.0))
    values = {"displacement_x": slope * fall + drift * time + noise[0], "displacement_y": fall + noise[1]}
    values |= {f"u_{name}": np.full(time.size, 2e-7) for name in values}
    values |= {name: np.zeros(time.size) for name in ("stretch_x", "stretch_y", "u_rotation")}
    body = xr.Dataset({name: ("frame", value) for name, value in values.items()}, coords={"time": ("frame", time)})
    found = seen(body)
    assert abs(found.direction - math.radians(2.0)) < 3 * found.u_direction < 2e-3


@pytest.mark.parametrize("distance", [None, 0.3])
def test_a_tilt_that_a_short_motion_hides_is_budgeted(distance: float | None):
    """A fall of a quarter of a millimetre, and a camera that looks 5 degrees down: lengths 0.38 % too short."""
    rise, noise = np.linspace(0.0, -0.25e-3, 40), np.full(40, 1e-7)
    still = np.zeros(40)
    body = xr.Dataset(
        {
            name: ("frame", values)
            for name, values in {
                "displacement_x": still, "displacement_y": rise, "u_displacement_x": noise,
                "u_displacement_y": noise, "stretch_x": still, "stretch_y": still, "u_rotation": np.full(40, 4e-5),
            }.items()
        }
    )  # fmt: skip
    angle = seen(body, None if distance is None else Quantity(distance, 0.0, "m"))
    assert angle.tilt == 0.0
    assert math.radians(5.0) == pytest.approx(math.sqrt(3.0) * angle.u_tilt)
    assert (angle.lengthened, angle.shortened) == (1.0, pytest.approx(0.0038 / 3**0.5, rel=0.01))
    budget = sources(angle, 0.25e-3, 12e-6)
    assert [(row.source, row.u) for row in budget if row.source == "tilt of the camera"] == [
        ("tilt of the camera", angle.shortened)
    ]
    longer = seen(body.assign(displacement_y=40 * body["displacement_y"]))
    assert longer.shortened == pytest.approx(0.5 * 0.006**2 / 3**0.5, rel=0.01)  # 10 mm
