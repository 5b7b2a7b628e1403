"""Budgets of the films: contact radii through the disc, and the holder's motion from the front."""

import json
from collections.abc import Iterator
from math import isfinite

import numpy as np
import xarray as xr

from labpipe.uncertainty import Input, beyond
from pipelines.experiments.budgets.quantity import (
    IMPACTS,
    MEASURED,
    Quantity,
    of_model,
)

_NO_LASER = ("inclination, filter lag", "there is no laser and no filter")
_UNDER = (
    _NO_LASER,
    ("zero", "the centre of the rings is fitted"),
    ("mass, height, Poisson's ratio, temperature",
     "nothing of the drop enters what was measured; they act on the model"),
    ("repeatability", "one film shows each impact once"),
)  # fmt: skip
_FRONT = (
    ("inclination, filter lag", "there is no filter, and a tilt of the view is in the pixel size"),
    ("sampling", "a displacement holds no time"),
    ("mass, radius, height, Poisson's ratio, temperature", "nothing of the body enters"),
    ("repeatability", "one film shows one drop"),
)
_AGAINST = (
    ("filter lag, sampling, zero", "both records are counted from first contact"),
    ("mass, radius, height, Poisson's ratio, temperature", "nothing of the body enters"),
    ("repeatability", "in the noise: the differences tell their own scatter, neighbours together"),
)  # fmt: skip


def contact_area(
    impacts: xr.Dataset, film: xr.Dataset, model: xr.Dataset | None = None
) -> Iterator[Quantity]:
    """Yield the largest contact radii of the first impacts; with a model its first one."""
    size, u_size = float(film["pixel_size"]), float(film["u_pixel_size"])
    shares = _shared(film)
    total = float(np.sqrt(sum(share**2 for share in shares.values())))
    # rings in pixels of another size are taken for those of another gap, too
    power = shares["pixel_size"] * size / u_size if u_size > 0.0 else 1.0
    for i in range(min(IMPACTS, impacts.sizes["impact"])):
        radius, u = float(impacts["peak_radius"][i]), float(impacts["u_peak_radius"][i])
        sampling = float(impacts["peak_sampling"][i])
        inputs = {
            MEASURED: Input(radius / size, 0.0, "px"), "pixel_size": Input(size, u_size, "m/px"),
            "noise": Input(0.0, beyond(u, total * radius, sampling), "m"),
            "sampling": Input(0.0, sampling, "m"),
        } | {n: Input(0.0, share * radius, "m") for n, share in shares.items()
             if n != "pixel_size"}  # fmt: skip
        yield Quantity(
            f"largest contact radius, impact {i + 1}", "m",
            lambda measured, pixel_size, **errors: (
                measured * size * (pixel_size / size) ** power + sum(errors.values())
            ),
            inputs, _UNDER, "largest contact radius",
        )  # fmt: skip
    if model is not None and model.sizes["impact"] and "budget" in model.attrs:
        yield of_model(
            "largest contact radius of the model, impact 1",
            float(model["peak_contact_radius"][0]), "m", json.loads(model.attrs["budget"]),
            ("mass", "radius", "height", "Poisson's ratio", "temperature"),
        )  # fmt: skip


def _shared(film: xr.Dataset) -> dict[str, float]:
    """Return what all frames share, relative to the radius, by source; their sum is the film's."""
    radius = film["radius"].values
    whole = film["radius_systematic"].values / radius
    total = float(np.nanmedian(whole)) if np.isfinite(whole).any() else 0.0
    parts = {
        str(name): film["systematic_part"].sel(source=name).values / radius
        for name in film["source"].values
    }
    medians = {n: float(np.nanmedian(p)) if np.isfinite(p).any() else 0.0 for n, p in parts.items()}
    found = float(np.sqrt(sum(m**2 for m in medians.values())))
    names = {"phase": "phase_of_the_light"}
    return {names.get(n, n): m * total / found if found else 0.0 for n, m in medians.items()}


def dic_validation(motion: xr.Dataset, comparison: xr.Dataset | None) -> Iterator[Quantity]:
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
    laser = beyond(float(comparison["expected_u_gain"]), film)
    mean = float(comparison["film"].mean()), float(comparison["laser"].mean())
    yield Quantity(
        "mean of film minus laser", "m",
        lambda measured, noise, pixel_size, inclination_and_gain: (
            measured + noise + mean[0] * (pixel_size - 1.0) - mean[1] * (inclination_and_gain - 1.0)
        ),
        {MEASURED: Input(float(comparison["bias"]), 0.0, "m"),
         "noise": Input(0.0, float(comparison["u_bias"]), "m"),
         "pixel_size": Input(1.0, film), "inclination_and_gain": Input(1.0, laser)},
        _AGAINST,
    )  # fmt: skip
    yield Quantity(
        "ratio of displacements, laser over film", "1",
        lambda measured, noise, pixel_size, inclination_and_gain: (
            (measured + noise) * inclination_and_gain / pixel_size
        ),
        {MEASURED: Input(float(comparison["gain"]), 0.0),
         "noise": Input(0.0, float(comparison["u_gain"])),
         "pixel_size": Input(1.0, film), "inclination_and_gain": Input(1.0, laser)},
        _AGAINST,
    )  # fmt: skip
