"""Image scales: table D.1 of the thesis, the wrong view, and lengths measured in an image."""

import json
from datetime import date
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from calibration.camera import image_scale, motion, pixel_size
from calibration.record import Record, load_record
from calibration.ruler import graduations
from labpipe.errors import CalibrationError, ConfigError, InputError
from labpipe.units import quantity
from tests.calibration.records import made


def record(view: str = "front", **values: str) -> Record:
    values = values or {"reference_length": "30 mm", "pixel_length": "386 ± 1.5 px"}
    return made("camera", "Phantom", date(2024, 1, 1), values, view=view, valid_until=date(2024, 12, 31))


@pytest.mark.parametrize(
    ("length", "pixels", "size", "percent"),
    [("30 mm", "386 ± 2 px", 77.72e-6, 0.52), ("1 mm", "461 ± 1 px", 2.169e-6, 0.22)],
)
def test_table_d1_comes_out(length: str, pixels: str, size: float, percent: float) -> None:
    found = pixel_size(quantity(length), quantity(pixels))
    assert found.value == pytest.approx(size, rel=2e-4)
    assert found.u / found.value * 100 == pytest.approx(percent, abs=0.005)


def test_the_record_of_another_view_is_refused_not_computed_with() -> None:
    with pytest.raises(CalibrationError, match=r'belongs to the view "front".*"under-disc"'):
        image_scale(record("front"), "under-disc", measured=date(2024, 5, 1))


def test_the_budget_holds_every_source() -> None:
    size, checked = image_scale(
        record(reference_length="30 ± 0.03 mm", pixel_length="386 ± 1.5 px", out_of_plane="0 ± 0.002"),
        "front",
        measured=date(2024, 5, 1),
    )
    relative = np.hypot(np.hypot(0.001, 1.5 / 386), 0.002)
    assert size.u / size.value == pytest.approx(relative, rel=1e-12)
    assert {row["source"] for row in checked["budget"]} == {"reference length", "pixel distance", "out of plane"}
    assert sum(row["share"] for row in checked["budget"]) == pytest.approx(1.0)


def track() -> xr.Dataset:
    values = np.array([[0.0, 0.0], [1.0, 2.0]])
    names = {"dx": values, "dy": -3 * values, "u_dx": 0.01 + 0 * values, "u_dy": 0.02 + 0 * values}
    return xr.Dataset({k: (("frame", "point"), v, {"units": "px"}) for k, v in names.items()})


def test_image_rows_count_downwards_and_heights_upwards() -> None:
    moved = motion(track(), record(), view="front", measured=date(2024, 5, 1))
    size = 30e-3 / 386
    np.testing.assert_allclose(moved.displacement_y[1], [3 * size, 6 * size])
    np.testing.assert_allclose(moved.u_displacement_y, 0.02 * size)
    assert moved.attrs["u_systematic_relative"] == pytest.approx(1.5 / 386)
    assert json.loads(moved.attrs["calibration"])["view"] == "front"


RECORD = """version = 1
kind = "camera"
id = "front"
instrument = "Phantom"
view = "front"
valid_from = 2024-01-01
valid_until = 2024-12-31
who = "A"
when = 2024-01-01
how = "ruler"
[values]
"""


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ('scale = "77.7 um/px"', "no uncertainty"),
        ('reference_length = "30 mm"', "either"),
        ('scale = "77.7 ± 0.1 mm"', "image scale"),
    ],
)
def test_a_wrong_record_names_its_line(tmp_path: Path, values: str, words: str) -> None:
    (tmp_path / "c.toml").write_text(RECORD + values, "utf-8")
    with pytest.raises(ConfigError, match=words) as caught:
        load_record(tmp_path / "c.toml")
    assert "c.toml:1" in str(caught.value)


@cache
def clean_ruler(pitch: float, tilt: float) -> np.ndarray:
    """A ruler of dark Gaussian lines, every pixel a mean of 5 × 5 points; no interpolation."""
    y, x = np.mgrid[0:80, 0:620]
    total = np.zeros(x.shape)
    for oy in (np.arange(5) - 2) / 5:
        for ox in (np.arange(5) - 2) / 5:
            s = (x + ox - 20.3) * np.cos(tilt) + (y + oy - 40) * np.sin(tilt)
            phase = (s + pitch / 2) % pitch - pitch / 2
            total += np.exp(-0.5 * (phase / 2.0) ** 2)
    return 180 - 120 * total / 25


def ruler_image(pitch: float, tilt: float, noise: float, seed: int) -> np.ndarray:
    clean = clean_ruler(pitch, tilt)
    noisy = clean + np.random.default_rng(seed).normal(0, noise, clean.shape)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


@pytest.mark.parametrize(("pitch", "tilt"), [(46.1, 0.01), (23.05, -0.02)])
def test_graduations_are_measured_to_a_hundredth_of_a_pixel(pitch: float, tilt: float) -> None:
    found = graduations(ruler_image(pitch, tilt, 3.0, 1))
    assert found.pitch.value == pytest.approx(pitch, abs=0.01)
    assert found.tilt.value == pytest.approx(-tilt, abs=1e-3)
    assert found.pitch.u < 0.01


@pytest.mark.slow
def test_the_stated_uncertainty_of_the_pitch_covers_the_truth() -> None:
    inside = 0
    for seed in range(40):
        found = graduations(ruler_image(23.05, 0.0, 4.0, seed))
        inside += abs(found.pitch.value - 23.05) <= 2.2 * found.pitch.u
    assert inside >= 35


def test_an_image_without_lines_is_refused() -> None:
    noise = np.random.default_rng(0).normal(100, 3, (40, 300))
    with pytest.raises(InputError, match=r"graduation|equally spaced"):
        graduations(noise)
