"""Comparison of film and model: contact radii around an impact, and the largest ones."""

from collections.abc import Iterator

import numpy as np
import xarray as xr

from labpipe.arrays import Floats
from labpipe.variables import variable
from pipelines.experiments.contact_area._peaks import BESIDE, STILL, WINDOW, peak_of
from pipelines.experiments.contact_area.settings import ContactArea
from pipelines.experiments.shared.comparison_rows import IMPACTS, Row, row

SCALE = "scale of the image"
"""Input of the rows beside those of the model."""


def comparison(radius: xr.Dataset, impacts: xr.Dataset, model: xr.Dataset, *, settings: ContactArea) -> xr.Dataset:
    """Compare film and model around the largest radius of each impact."""
    del settings
    count = min(impacts.sizes["impact"], model.sizes["impact"])
    time, a = radius["time"].values, radius["radius"].values
    seen = radius["in_contact"].values.astype(bool)
    known = np.hypot(radius["u_radius"].values, radius["radius_systematic"].values)
    points: dict[str, list[Floats]] = {"number": [], "since": [], "film": [], "u_film": [], "model": []}
    errors, peak_times = [], []
    for i in range(count):
        peak = _model_peak(model, i)
        peak_times.append(peak)
        since = time - float(impacts["peak_time"][i])
        inside = (np.abs(since) < WINDOW) & np.isfinite(a) & seen
        inside &= time >= float(impacts["first_seen"][i])
        inside &= time <= float(impacts["last_seen"][i])
        theirs = np.interp(since[inside] + peak, model["time"], model["contact_radius"])
        for key, values in (
            ("number", np.full(inside.sum(), i + 1.0)),
            ("since", since[inside]),
            ("film", a[inside]),
            ("u_film", known[inside]),
            ("model", theirs),
        ):
            points[key].append(values)
        largest = max(float(np.max(theirs)), 1e-12)
        errors.append(float(np.sqrt(np.mean((a[inside] - theirs) ** 2))) / largest)
    joined = {k: np.concatenate(v) if v else np.empty(0) for k, v in points.items()}
    ours, theirs = (impacts["peak_radius"].values[:count], model["peak_contact_radius"].values[:count])
    u = np.hypot(impacts["u_peak_radius"].values[:count], model["u_peak_contact_radius"].values[:count])
    return xr.Dataset(
        {
            "impact_number": variable("sample", joined["number"], "1", "impact of a compared frame"),
            "since_peak": variable("sample", joined["since"], "s", "time since the largest radius"),
            "film": variable("sample", joined["film"], "m", "contact radius, film"),
            "u_film": variable("sample", joined["u_film"], "m", "standard uncertainty: contact radius, film"),
            "model": variable("sample", joined["model"], "m", "contact radius, model"),
            "nrmse": variable(
                "impact", np.array(errors), "1", "root-mean-square error over largest radius of the model"
            ),
            "peak_radius_film": variable("impact", ours, "m", "largest radius, film"),
            "peak_radius_model": variable("impact", theirs, "m", "largest radius, model"),
            "peak_radius_difference": variable("impact", ours - theirs, "m", "film minus model"),
            "u_peak_radius_difference": variable("impact", u, "m", "standard uncertainty"),
            "model_peak_time": variable("impact", np.array(peak_times), "s", "time of the model's largest radius"),
        },
        coords={"impact": np.arange(1, count + 1)},
    )


def _model_peak(model: xr.Dataset, impact: int) -> float:
    """Time of the model's largest radius in one impact."""
    time = model["time"].values
    touch = model["impact_time"].values
    end = touch[impact + 1] if impact + 1 < len(touch) else time[-1]
    end = min(end, touch[impact] + STILL)
    inside = np.flatnonzero((time >= touch[impact]) & (time <= end))
    a = model["contact_radius"].values
    top = inside[int(np.argmax(a[inside]))]
    low, high = max(top - BESIDE, 0), min(top + BESIDE + 1, len(a))
    return peak_of(time[low:high], a[low:high], np.full(high - low, 1e-9)).time


def rows(comparison: xr.Dataset, impacts: xr.Dataset, model: xr.Dataset, *, settings: ContactArea) -> Iterator[Row]:
    """Yield the rows of ``compare``."""
    sphere = settings.sphere
    counts = comparison["impact_number"].values
    for i in range(min(IMPACTS, comparison.sizes["impact"])):
        inside = counts == i + 1
        expected = float(comparison["peak_radius_model"][i])
        gap = (comparison["film"] - comparison["model"]).values[inside]
        yield row(
            f"contact radius, impact {i + 1}",
            "m",
            int(inside.sum()),
            nrmse=comparison["nrmse"][i],
            difference=gap.mean(),
        )
        yield row(
            f"largest radius, impact {i + 1}",
            "m",
            1,
            measured=comparison["peak_radius_film"][i],
            u_measured=impacts["u_peak_radius"][i],
            model=comparison["peak_radius_model"][i],
            u_model=model["u_peak_contact_radius"][i],
            difference=comparison["peak_radius_difference"][i],
            u_difference=comparison["u_peak_radius_difference"][i],
            slopes={
                SCALE: float(comparison["peak_radius_film"][i]),
                # Hertz's impact: a ~ R^0.4 (m h)^0.2 E^-0.2
                "radius": -0.4 * expected / sphere.radius.value,
                "mass": -0.2 * expected / sphere.mass.value,
                "height": -0.2 * expected / settings.height.value,
                "modulus": 0.2 * expected,
            },
        )
