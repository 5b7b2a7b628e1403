"""Film and model: aligned by a small shift in time, and compared in size by all frames of a contact."""

import numpy as np
import pytest
import xarray as xr

from labpipe.units import Quantity
from pipelines.experiments.contact_area.comparison import Form, _fit, comparison
from pipelines.experiments.contact_area.settings import ContactArea
from pipelines.experiments.shared.settings import Sphere

US, UM = 1e-6, 1e-6
_SETTINGS = ContactArea(
    kind="contact_area",
    film="film/a.cine",
    camera="calibration/camera_under.toml",
    height=Quantity(1.5e-3, 5e-6, "m"),
    sphere=Sphere(radius=Quantity(9.525e-3, 5e-6, "m"), mass=Quantity(0.505, 5e-4, "kg"), material="acrylic"),
)


def shape(t: np.ndarray) -> np.ndarray:
    """A contact of 1 ms about t = 0, steep at its ends as the one of an impact."""
    return 800 * UM * np.sqrt(np.clip(np.cos(np.pi * t / 1e-3), 0.0, None))


def _model() -> xr.Dataset:
    when = np.arange(0.0, 3e-3, 2e-6)
    return xr.Dataset(
        {
            "contact_radius": ("time", shape(when - 1e-3)),
            "impact_time": ("impact", [0.5e-3]),
            "lift_off_time": ("impact", [1.5e-3]),
            "peak_contact_radius": ("impact", [800 * UM]),
            "u_peak_contact_radius": ("impact", [1 * UM]),
            "adhesion_shift": ("impact", [0.7 * UM]),
            "u_adhesion_shift": ("impact", [0.4 * UM]),
        },
        coords={"time": when, "impact": [1]},
    )


def compared(offset: float, count: int = 10, factor: float = 1.0) -> xr.Dataset:
    """Frames of a contact of which the time of the largest radius is told wrong by ``offset``."""
    time = (np.arange(count) - 0.5 * (count - 1)) * 0.9e-3 / count
    a = factor * shape(time)
    film = xr.Dataset(
        {name: ("frame", np.full(count, 0.1 * UM)) for name in ("u_radius", "radius_systematic")}
        | {"radius": ("frame", a), "in_contact": ("frame", a > 0.0)},
        coords={"time": ("frame", time)},
    )
    found = xr.Dataset(
        {
            "peak_time": ("impact", [offset]),
            "first_seen": ("impact", [time[0]]),
            "last_seen": ("impact", [time[-1]]),
            "peak_radius": ("impact", [800 * UM]),
            "u_peak_radius": ("impact", [1 * UM]),
        },
        coords={"impact": [1]},
    )
    return comparison(film, found, _model(), settings=_SETTINGS)


@pytest.mark.parametrize("offset", [-12 * US, 5 * US, 30 * US])
def test_a_wrong_time_of_the_peak_is_made_up_for(offset: float) -> None:
    made = compared(offset)
    assert float(made["time_shift"][0]) == pytest.approx(offset, abs=0.5 * US)
    assert float(np.abs(made["film"] - made["model"]).max()) < 0.5 * UM


# --- size of a contact --------------------------------------------------------------------------

_TIME = np.arange(0.0, 4e-3, 2e-5)


def _shape(time: np.ndarray) -> np.ndarray:
    return 7.5e-4 * np.sqrt(np.clip(np.sin(np.pi * (time - 1e-3) / 1.3e-3), 0.0, None) * (time < 2.3e-3))


_FORM = _shape(_TIME)
_ENDS = {"impact_time": ("impact", [1e-3]), "lift_off_time": ("impact", [2.3e-3])}
MODEL = Form.of(xr.Dataset({"contact_radius": ("time", _FORM), **_ENDS}, coords={"time": _TIME}), 0)


def film(size: float, seed: int, frames: int = 5, longer: float = 0.0) -> tuple[np.ndarray, ...]:
    """Frames 0.2 ms apart, none of them at the largest radius, whose clock is 30 µs off."""
    at = 1.23e-3 + 2e-4 * np.arange(frames)
    u = np.full(frames, 1e-6)
    of_model = 1.65e-3 + (at + 3e-5 - 1.65e-3) / (1.0 + longer)
    radius = size * _shape(of_model) + 1e-6 * np.random.default_rng(seed).standard_normal(frames)
    return at, radius, u, 2e-3 * radius


def test_frames_beside_the_largest_radius_tell_a_per_cent() -> None:
    found = np.array([_fit(*film(1.01, seed), MODEL) for seed in range(8)])
    assert np.abs(found[:, 0] / 1.01 - 1.0).max() < 5e-3
    assert found[:, 1].min() > 2e-3  # the length of a pixel is common to all frames
    assert found[:, 1].max() < 5e-3
    z = (found[:, 2] - 3e-5) / found[:, 3]
    assert np.sqrt(np.mean(z**2)) < 1.5
    assert found[:, 3].max() < 3e-6


def test_a_contact_that_lasts_longer_than_in_the_model_has_no_less_certain_size() -> None:
    """A mass that is stated 9 % wrongly alters the radius by 1.8 %, and the duration by 3.6 %."""
    found = np.array([_fit(*film(1.018, seed, longer=0.036), MODEL) for seed in range(8)])
    assert np.abs(found[:, 0] / 1.018 - 1.0).max() < 5e-3
    assert found[:, 1].max() < 5e-3


def test_a_model_is_followed_between_its_times_up_to_touch_and_lift_off() -> None:
    """Straight lines between radii 20 µs apart would lie below the model by 20 µm beside a touch."""
    at = np.linspace(1e-3, 2.3e-3, 1311)
    assert np.abs(MODEL(at) - _shape(at)).max() < 0.2e-6
    assert np.abs(np.interp(at, _TIME, _FORM) - _shape(at)).max() > 10e-6
    assert not MODEL(np.array([0.999e-3, 2.301e-3])).any()
    inner = at[20:-20]
    slope = (_shape(inner + 1e-8) - _shape(inner - 1e-8)) / 2e-8
    np.testing.assert_allclose(MODEL.rate(inner), slope, rtol=1e-3, atol=1e-3)
