"""The indentation simulated with the measured displacement."""

from pathlib import Path

import xarray as xr

from pipelines.experiments.relaxation.settings import Relaxation
from pipelines.experiments.shared.punch_model import modelled

_SHORTEST = 0.02  # s; the fastest part of a ramp that shows in a force


def model(
    loads: xr.Dataset, ramps: xr.Dataset, material_file: Path | None, fitted: xr.Dataset | None, *, settings: Relaxation
) -> xr.Dataset:
    """Simulate the whole file with the measured displacement."""
    return modelled(loads, ramps, settings, material_file, fitted, (_SHORTEST, float(ramps["duration"].max())))
