"""A camera that is turned about its axis or looks up at the fall: lengths along the motion, and their uncertainty."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from labpipe import files
from labpipe.units import Quantity, quantity
from labpipe.variables import variable
from pipelines.experiments.dic_validation import measured
from pipelines.experiments.dic_validation.settings import DicValidation
from pipelines.rig.session_text import front_record

PIXEL, TRAVEL = 30e-3 / 386, 50.0


def moved(folder: Path, roll: float, tilt: Quantity | None = None, shortened: float = 1.0) -> xr.Dataset:
    """Return the motion of a fall by 50 px that a turned camera films with 0.003 px of noise."""
    down = TRAVEL * np.clip((np.arange(60) - 10) / 40, 0.0, 1.0) ** 2
    noise = 3e-3 * np.random.default_rng(7).normal(size=(2, down.size))
    shown = {"dx": math.sin(roll) * down, "dy": math.cos(roll) * down * shortened}
    found = {name: values + extra for (name, values), extra in zip(shown.items(), noise, strict=True)}
    found |= {f"u_{name}": np.full(down.size, 3e-3) for name in shown}
    found |= {"rotation": np.zeros(down.size), "u_rotation": np.full(down.size, 1e-5)}
    track = xr.Dataset({name: (("frame", "point"), values[:, None]) for name, values in found.items()})
    track["valid"] = xr.ones_like(track["dx"], dtype=bool)
    track = track.assign_coords(frame=np.arange(down.size), time=variable("frame", np.arange(60) / 1e3, "s", "time"))
    record = folder / "camera_front.toml"
    files.write_text(record, front_record())
    given = {} if tilt is None else {"camera_tilt": tilt}
    settings = DicValidation(kind="dic_validation", film="f", camera="c", measured_on=None, **given)
    return measured.motion(track.assign_attrs(recorded="2024-06-01"), record, settings=settings)


def sources(found: xr.Dataset) -> dict[str, float]:
    return {row["source"]: row["u"] for row in json.loads(found.attrs["budget"])}


@pytest.mark.parametrize("degrees", [0.0, 4.0, -8.0])
def test_a_turned_camera_costs_no_length(tmp_path: Path, degrees: float) -> None:
    found = moved(tmp_path, math.radians(degrees))
    # what falls to the right rose from the left
    assert abs(float(found["direction"]) + math.radians(degrees)) < 3 * float(found["u_direction"])
    assert float(found["displacement"][-1]) == pytest.approx(-TRAVEL * PIXEL, rel=2e-4)
    shorter = (1 - math.cos(math.radians(degrees))) / 3**0.5
    assert sources(found).get("direction of motion", 0.0) == pytest.approx(shorter, abs=1e-5)


def test_lengths_are_divided_by_the_cosine_of_a_stated_tilt(tmp_path: Path) -> None:
    found = moved(tmp_path, 0.0, quantity("10 ± 1 deg"), math.cos(math.radians(10.0)))
    assert float(found["displacement"][-1]) == pytest.approx(-TRAVEL * PIXEL, rel=2e-4)
    expected = math.tan(math.radians(10.0)) * math.radians(1.0)
    assert sources(found)["tilt of the camera"] == pytest.approx(expected, rel=0.01)
    # set up by eye: up to 5 degrees, which shorten lengths by 0.38 %
    assert sources(moved(tmp_path, 0.0))["tilt of the camera"] == pytest.approx(0.0038 / 3**0.5, rel=0.02)
