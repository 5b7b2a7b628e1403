"""Impacts among the contacts of a film: single frames, missed frames, slow films."""

from collections.abc import Callable

import numpy as np
import pytest
import xarray as xr
from scipy.integrate import solve_ivp

from pipelines.experiments.contact_area.measured import impacts


def seen_in_film(time: np.ndarray, radius: np.ndarray, in_contact: np.ndarray) -> xr.Dataset:
    """What the stage ``radius`` hands on, as far as impacts are concerned."""
    values = {"radius": radius, "u_radius": np.full(len(time), 1e-8)}
    values |= {"radius_systematic": 1e-3 * radius, "in_contact": in_contact}
    return xr.Dataset({n: ("frame", v) for n, v in values.items()}, {"time": ("frame", time)})


def three_impacts() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Frames at 10 kHz of contacts of 1.2 ms that begin at 5, 25 and 40 ms, and rest from 60 ms."""
    time = 1e-4 * np.arange(1200)
    square = np.where(time > 60e-3, (200e-6) ** 2, 0.0)
    for begin, largest in ((5e-3, 700e-6), (25e-3, 600e-6), (40e-3, 500e-6)):
        inside = (time > begin) & (time < begin + 1.2e-3)
        square[inside] = largest**2 * np.sin(np.pi * (time[inside] - begin) / 1.2e-3)
    radius = np.where(square > 0.0, np.sqrt(square), np.nan)
    return time, radius, square > 0.0


def mistaken() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Single frames are taken for a contact."""
    time, radius, seen = three_impacts()
    for wrong in (20, 150, 330, 500):
        radius[wrong], seen[wrong] = 150e-6, True
    return time, radius, seen


def missed() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A frame within a contact shows none, and two are in contact without a radius."""
    time, radius, seen = three_impacts()
    radius[255], seen[255] = np.nan, False
    radius[405:407] = np.nan
    return time, radius, seen


def thinned() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """After the first three contacts frames are 5 ms apart, three in a row of which show last bounces."""
    time, radius, _ = three_impacts()
    fast = time < 45e-3
    last = [np.nan, 300e-6, 280e-6, 310e-6, np.nan, np.nan, 290e-6, np.nan]
    radius = np.concatenate([radius[fast], last])
    return np.concatenate([time[fast], 0.2 + 5e-3 * np.arange(8)]), radius, np.isfinite(radius)


def short_rest() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Four frames, 5 ms apart, long after the third impact: contact for 15 ms, less than rest."""
    time, radius, _ = three_impacts()
    kept = time < 45e-3
    radius = np.concatenate([radius[kept], np.full(4, 200e-6)])
    return np.concatenate([time[kept], 0.5 + 5e-3 * np.arange(4)]), radius, np.isfinite(radius)


def cut() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The film ends within the third impact."""
    time, radius, seen = three_impacts()
    kept = time < 40.8e-3
    return time[kept], radius[kept], seen[kept]


@pytest.mark.parametrize("film", [mistaken, missed, thinned, short_rest, cut])
def test_the_three_impacts_are_found(film: Callable[[], tuple[np.ndarray, ...]]) -> None:
    found = impacts(seen_in_film(*film()), settings=None)
    assert found["peak_time"].values == pytest.approx([5.6e-3, 25.6e-3, 40.6e-3], abs=1e-4)
    assert found["peak_radius"].values == pytest.approx([700e-6, 600e-6, 500e-6], rel=0.01)
    rests = film in (mistaken, missed)
    assert float(found["static_radius"]) == pytest.approx(200e-6 if rests else np.nan, nan_ok=True)


def test_largest_radius_lies_between_the_frames_within_its_uncertainty() -> None:
    """Hertz's elastic impact, integrated: 0.9 ms of contact, the frames anywhere in it."""
    duration, top = 0.9e-3, 900e-6
    # approach over its largest, s'' = -(5/4) s^(3/2) in the unit of time max approach / speed
    moved = solve_ivp(
        lambda _, y: [y[1], -1.25 * max(y[0], 0.0) ** 1.5],
        (0.0, 4.0),
        [0.0, 1.0],
        rtol=1e-10,
        atol=1e-12,
        max_step=0.01,
    )
    inside = moved.y[0] >= 0.0
    since, approach = moved.t[inside] * duration / moved.t[inside][-1], moved.y[0][inside]
    errors, stated = [], []
    for phase in np.linspace(0.0, 1e-4, 12):
        time = phase + 1e-4 * np.arange(40)
        level = np.interp(time - 1e-3, since, approach, left=0.0, right=0.0)
        radius = np.where(level > 0.0, top * np.sqrt(level), np.nan)
        found = impacts(seen_in_film(time, radius, level > 0.0), settings=None)
        errors.append(float(found["peak_radius"][0]) / top - 1.0)
        own = float(found["u_peak_radius"][0]) ** 2 - (1e-3 * float(found["peak_radius"][0])) ** 2
        stated.append(np.sqrt(own) / top)
        assert float(found["peak_sampling"][0]) <= np.sqrt(own) * (1 + 1e-9)
    assert np.max(np.abs(errors)) < 6e-4
    assert abs(np.mean(errors)) < 3e-4
    assert np.sqrt(np.mean((np.array(errors) / np.array(stated)) ** 2)) < 1.2
