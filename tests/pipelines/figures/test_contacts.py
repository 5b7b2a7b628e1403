"""Figures 3.13, 3.16 and C.1 from results made by hand: which numbers reach which caption."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import xarray as xr

from labpipe.errors import InputError
from labpipe.units import Quantity
from pipelines.figures import contacts
from pipelines.figures.drawing import Drawing

TOUCHES = (20e-3, 50e-3, 75e-3)
HALF = 0.5e-3  # s, half a contact


class Results:
    """Stand-in for :class:`pipelines.figures.inputs.Inputs`."""

    origin, is_synthetic = "synthetic", True

    def __init__(self, experiments: dict[str, Any], rest: dict[str, float]) -> None:
        self.experiments, self.rest = experiments, rest

    def of_kind(self, kind: str) -> dict[str, Any]:
        return {n: s for n, s in self.experiments.items() if s.kind == kind}

    def data_note(self, text: str) -> dict[str, str]:
        return {"synthetic": text}

    def result(self, name: str, stage: str, recording: str | None = None) -> xr.Dataset:
        assert (recording is None) == (stage != "bounces")
        return {
            "repeats": repeats,
            "bounces": bounces,
            "radius": radius,
            "keys": keys,
            "model": model,
            "impacts": lambda: impacts(self.rest[name]),
            "comparison": lambda: comparison(self.rest[name]),
        }[stage]()


def contact_at(time: np.ndarray) -> np.ndarray:
    """Radius [m] of three contacts of 1 ms, and of rest from 0.3 s."""
    square = np.where(time > 0.3, (210e-6) ** 2, 0.0)
    for touch in TOUCHES:
        square += (700e-6) ** 2 * np.maximum(1 - ((time - touch - HALF) / HALF) ** 2, 0.0)
    return np.sqrt(square)


def repeats() -> xr.Dataset:
    time = np.linspace(-0.02, 0.4, 500)
    return xr.Dataset({"displacement_mean": ("time", 1e-3 * np.abs(np.sin(50 * time)))}, {"time": time})


def bounces() -> xr.Dataset:
    times = {"first_contact_time": 0.02, "settling_time": 0.27, "rest_time": 0.32}
    return xr.Dataset({name: ((), value) for name, value in times.items()})


def radius() -> xr.Dataset:
    time = np.concatenate([t + np.arange(0.0, 1e-3, 1e-4) for t in TOUCHES] + [[0.35, 0.36]])
    a = contact_at(time)
    found = {"radius": ("frame", a), "in_contact": ("frame", a > 0), "pixel_size": ((), 4e-6)}
    return xr.Dataset(found, {"time": ("frame", time)})


def keys() -> xr.Dataset:
    times = np.append(np.array(TOUCHES) + HALF, 0.36)
    circle = {f"circle_{axis}": ("key", np.full(4, value)) for axis, value in (("x", 40.0), ("y", 6.0))}
    circle["circle_radius"] = ("key", contact_at(times) / 4e-6)
    image = ("key", "row", "column"), np.zeros((4, 12, 80))
    return xr.Dataset({"image": image, "key_time": ("key", times), "reduction": ((), 1.0), **circle})


def impacts(rest: float) -> xr.Dataset:
    return xr.Dataset(
        {
            "peak_time": ("impact", np.array(TOUCHES) + HALF),
            "peak_radius": ("impact", np.full(3, 700e-6)),
            "static_radius": ((), rest),
            "u_static_radius": ((), 0.5e-6),
            "static_since": ((), 0.35),
        }
    )


def model() -> xr.Dataset:
    time = np.arange(0.0, 0.4, 2e-5)
    return xr.Dataset(
        {
            "contact_radius": ("time", contact_at(time)),
            "impact_time": ("impact", np.array(TOUCHES)),
            "static_radius_brief": ((), 176e-6),
            "static_radius_lasting": ((), 238e-6),
            "u_static_radius_lasting": ((), 2e-6),
            "rest_time": 0.3,
        },
        {"time": time},
    )


def comparison(rest: float) -> xr.Dataset:
    larger = rest - 210e-6
    since = np.tile(np.linspace(-0.4e-3, 0.4e-3, 5), 3)
    return xr.Dataset(
        {
            "impact_number": ("sample", np.repeat([1.0, 2.0, 3.0], 5)),
            "since_peak": ("sample", since),
            "film": ("sample", 700e-6 * np.sqrt(1 - (since / HALF) ** 2)),
            "model_peak_time": ("impact", np.array(TOUCHES) + HALF),
            "time_shift": ("impact", np.zeros(3)),
            "peak_radius_film": ("impact", np.full(3, 700e-6) + larger),
            "peak_radius_model": ("impact", np.full(3, 701e-6) + larger),
            "u_peak_radius_difference": ("impact", np.full(3, 3e-6)),
        }
    )


def experiment(kind: str, temperature: float | None = None, height: float = 1.5e-3) -> Any:
    warm = None if temperature is None else Quantity(temperature, 0.0, "degC")
    return SimpleNamespace(
        kind=kind,
        height=Quantity(height, 0.0, "m"),
        laser=["laser/drop_1.csv"],
        sphere=SimpleNamespace(temperature=warm),
    )


EXPERIMENTS = {
    "drop": experiment("ball_drop"),
    "film": experiment("contact_area"),
    "warm": experiment("contact_area", 39.0),
}
RESTS = {"film": 210e-6, "warm": 218e-6}


def caption(drawing: Drawing) -> str:
    assert drawing.figure is not None
    drawing.figure.draw_without_rendering()
    return " ".join(drawing.caption("", "").split())


def test_phases_are_those_of_the_laser_s_record_counted_from_first_contact() -> None:
    inputs: Any = Results({n: EXPERIMENTS[n] for n in ("drop", "film")}, RESTS)
    text = caption(contacts.phases(inputs))
    assert "bouncing until 250 ms" in text
    assert "vibration until 300 ms" in text
    assert "176 to 238 µm" in text
    assert "210.0 ± 0.5 µm" in text


def test_the_four_heights_need_a_film_and_a_drop_of_one_height() -> None:
    inputs: Any = Results({n: EXPERIMENTS[n] for n in ("drop", "film")}, RESTS)
    assert "aligned with the laser's record at first contact" in caption(contacts.four_heights(inputs))
    other = EXPERIMENTS | {"drop": experiment("ball_drop", height=5e-3)}
    with pytest.raises(InputError, match="share a drop height"):
        contacts.four_heights(Results(other, RESTS))  # type: ignore[arg-type]


def test_the_heated_contact_is_larger_by_what_the_results_say() -> None:
    inputs: Any = Results({n: EXPERIMENTS[n] for n in ("film", "warm")}, RESTS)
    text = caption(contacts.heated(inputs))
    assert "I +8.0 (model +8.0) ± 4.2 µm" in text
    assert "210.0 ± 0.5 and 218.0 ± 0.5 µm" in text
    lost = {"film": experiment("contact_area", height=5e-3), "warm": EXPERIMENTS["warm"]}
    with pytest.raises(InputError, match="no film at room temperature"):
        contacts.heated(Results(lost, RESTS))  # type: ignore[arg-type]
