"""Budgets of the holder's motion in a film, and of film against laser."""

import json
from collections.abc import Iterator
from math import isfinite

import numpy as np
import xarray as xr

from labpipe.uncertainty import Input, excess_uncertainty
from pipelines.experiments.shared.budget_quantity import MEASURED, Quantity

_FRONT = (
    ("inclination, filter lag", "there is no filter, and the camera's angle acts by direction and scale of the motion"),
    ("sampling", "a displacement does not depend on time"),
    ("mass, radius, height, Poisson's ratio, temperature", "the body has no effect"),
    ("repeatability", "one film shows one drop"),
)
_AGAINST = (
    ("filter lag, sampling, zero", "both records are counted from first contact"),
    ("mass, radius, height, Poisson's ratio, temperature", "the body has no effect"),
    ("repeatability", "included in the noise, which is estimated from the differences and their autocorrelation"),
)


def quantities(motion: xr.Dataset, comparison: xr.Dataset | None = None) -> Iterator[Quantity]:
    """Yield the largest displacement in the film, and film against laser where there was one."""
    size = float(motion["pixel_size"])
    moved = motion["displacement"].values
    at = int(np.nanargmax(np.abs(moved)))
    rows = json.loads(motion.attrs["budget"])
    relative = float(motion.attrs["u_systematic_relative"])
    noise = float(motion["u_displacement"][at]) / size  # that of the scale is not in it
    names = {r["source"].replace(" ", "_"): r for r in rows}
    inputs = {MEASURED: Input(float(moved[at]) / size, 0.0, "px"), "noise": Input(0.0, noise, "px")}
    inputs |= {n: Input(r["value"], r["u"], r["unit"]) for n, r in names.items()}

    def along(measured: float, noise: float, **scale: float) -> float:
        changed = sum(r["sensitivity"] * (scale[n] - r["value"]) for n, r in names.items())
        return (measured + noise) * (size + changed)

    zero = ("zero", "the mean of the still frames, whose noise is that of one frame's part")
    yield Quantity("largest displacement in the film", "m", along, inputs, (zero, *_FRONT))
    if comparison is not None and "bias" in comparison and isfinite(float(comparison["u_bias"])):
        yield from _against_laser(comparison, relative)


def _against_laser(comparison: xr.Dataset, film: float) -> Iterator[Quantity]:
    """Yield mean difference and ratio of scales; both calibrations act on either."""
    laser = excess_uncertainty(float(comparison["expected_u_gain"]), film)
    scales = {"pixel_size": Input(1.0, film), "inclination_and_gain": Input(1.0, laser)}
    of_film, of_laser = float(comparison["film"].mean()), float(comparison["laser"].mean())

    def mean(measured: float, noise: float, pixel_size: float, inclination_and_gain: float) -> float:
        return measured + noise + of_film * (pixel_size - 1.0) - of_laser * (inclination_and_gain - 1.0)

    def ratio(measured: float, noise: float, pixel_size: float, inclination_and_gain: float) -> float:
        return (measured + noise) * inclination_and_gain / pixel_size

    for name, title, unit, model in (
        ("bias", "mean of film minus laser", "m", mean),
        ("gain", "ratio of displacements, laser over film", "1", ratio),
    ):
        value, u = float(comparison[name]), float(comparison[f"u_{name}"])
        own = {MEASURED: Input(value, 0.0, unit), "noise": Input(0.0, u, unit)}
        yield Quantity(title, unit, model, own | scales, _AGAINST)
