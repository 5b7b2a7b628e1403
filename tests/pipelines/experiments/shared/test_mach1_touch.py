"""First touch of approaches of the rig: its error in stated uncertainties."""

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import xarray as xr
from scipy.signal import butter, sosfilt

from labpipe import materials
from labpipe.materials import Prony
from pipelines.experiments.shared import mach1_readings
from pipelines.rig import indentations
from pipelines.rig.indentations import TESTER, Part, Specimen
from pipelines.rig.mach1_tester import OVERSAMPLING, RATE, approach, record
from tests.by_day import by_day

TIMES = np.geomspace(1e-6, 1e4, 31)
LOSSY = Prony(2e6, 3e6 * TIMES**-0.3, TIMES, nu=0.5)
"""A modulus that falls as the power 0.3 of time: a loss factor of about 0.5."""

SOLIDS = {"nbr": materials.load("nbr"), "lossy": LOSSY}
CELL = {"filter_delay": "[0.015915, 0.0002]", "resolution": 0.0125}


def recorded(part: Part, force: np.ndarray, seed: int, noise: Any = None) -> tuple[Any, float]:
    """Return an approach as a Mach-1 writes it, and the true surface."""
    rng = np.random.default_rng(seed)
    surface = 12e-3 + rng.uniform(-1e-6, 1e-6)
    tester = replace(TESTER, force_offset=0.0, force_noise=0.0 if noise else 0.01)
    written = record(tester, force, rng) + (0.0 if noise is None else noise(rng, force.size))
    position = surface + part.displacement[::OVERSAMPLING]
    blocks = json.dumps([{"filter": {"order": 3, "cutoff": 20.0}}])
    return xr.Dataset(
        {
            "time": ("sample", np.arange(written.size) / RATE),
            "position_z": ("sample", np.round(position, 7)),
            "force": ("sample", np.round(written / 0.0125) * 0.0125),
            "block": ("sample", np.zeros(written.size)),
            "function": ("block_index", ["Find Contact"]),
        },
        attrs=CELL | {"blocks": blocks},
    ), surface


def scores(
    solid: Prony, count: int, noise: Any = None, start: float = -50e-6, speed: float = 50e-6
) -> tuple[np.ndarray, float]:
    """Return errors over stated uncertainties, and the mean uncertainty [m]."""
    part = Part("Find Contact", *approach(start, 2e-6, speed), {})
    force = indentations._force(Specimen(solid), [part], np.zeros(1))
    found = []
    for seed in range(count):
        loads, surface = recorded(part, force, seed, noise)
        touch = mach1_readings.touch_of(mach1_readings.first_touch(loads, None))
        found.append(((touch.value - surface) / touch.u, touch.u))
    made = np.array(found)
    return made[:, 0], float(made[:, 1].mean())


@pytest.mark.parametrize("name", by_day(SOLIDS, 1))
def test_first_touch_is_known_as_well_as_it_says(name: str) -> None:
    z, u = scores(SOLIDS[name], 30)
    assert 0.5 < np.sqrt(np.mean(z**2)) < 1.3
    assert abs(z.mean()) < 0.6
    assert u < 0.2e-6


def test_noise_that_the_filter_has_smoothed_counts_as_fewer_readings() -> None:
    def smooth(rng: np.random.Generator, size: int) -> np.ndarray:
        passed = sosfilt(butter(1, 8.0, fs=RATE, output="sos"), rng.normal(0.0, 0.02, 200 + size // OVERSAMPLING))
        return np.asarray(passed[200:])

    z, _ = scores(LOSSY, 20, smooth)
    assert np.sqrt(np.mean(z**2)) < 1.4


def test_a_stage_that_goes_back_after_it_has_touched_tells_the_same() -> None:
    part = Part("Find Contact", *approach(-50e-6, 2e-6, 50e-6), {})
    force = indentations._force(Specimen(LOSSY), [part], np.zeros(1))
    loads, surface = recorded(part, force, 3)
    last = loads.isel(sample=slice(-1, None)).copy(deep=True)
    gone = [
        last.assign(time=last["time"] + n / RATE, position_z=last["position_z"] - n * 1e-6, force=0.0 * last["force"])
        for n in range(1, 40)
    ]
    longer = xr.concat([loads, *gone], "sample", data_vars="minimal").assign_attrs(loads.attrs)
    known = (mach1_readings.first_touch(each, None) for each in (loads, longer))
    plain, found = map(mach1_readings.touch_of, known)
    assert abs(found.value - plain.value) < plain.u
    assert abs(found.value - surface) < 3 * found.u
