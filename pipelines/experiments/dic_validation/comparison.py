"""Comparison of a film of the holder with the laser."""

from collections.abc import Iterator
from math import sqrt

import numpy as np
import xarray as xr

from labpipe import signals
from labpipe.judging import Agreement, along_curve, stretch_means, stretches
from labpipe.variables import described, variable, with_u
from pipelines.experiments.dic_validation.settings import DicValidation
from pipelines.experiments.shared.comparison_rows import (
    IMPACTS,
    Row,
    curve_row,
    curve_table,
    flights,
    moved_by_scatter,
    row,
    with_its_u,
)

RATIO = "displacement_ratio"
"""Displacement of the film over that of the laser; its uncertainty is without that of the scales."""


def comparison(
    motion: xr.Dataset, bounces: xr.Dataset, laser: xr.Dataset | None, *, settings: DicValidation
) -> xr.Dataset:
    """Lay the film over the mean of the laser's repeats, both from first contact."""
    del settings
    if laser is None:
        return xr.Dataset(attrs={"note": "no laser experiment is named"})
    film = motion["displacement"] - float(bounces["contact_level"])
    film = film.assign_coords(time=film["time"] - float(bounces["first_contact_time"]))
    film["time"].attrs = described("s", "time from the event")
    film.attrs = motion["displacement"].attrs
    reference = laser["displacement_mean"].dropna("time")
    seen = film.copy(data=np.interp(film["time"], reference["time"], reference, left=np.nan, right=np.nan))
    both = np.isfinite(film.values) & np.isfinite(seen.values)
    film, seen = film[both], seen[both]
    apart = film.values - seen.values
    bias, u_noise = float(apart.mean()), float(apart.std(ddof=1)) / sqrt(signals.independent_count(apart))
    scales = [one.attrs.get("u_systematic_relative", 0.0) for one in (motion, laser)]
    expected, scaled = float(np.hypot(*scales)), scales * np.array([film.values.mean(), seen.values.mean()])
    text = "standard uncertainty of the ratio of both scales, from both calibrations"
    level = "over the height of first contact"
    made = xr.Dataset(
        {
            "residual": variable("time", apart, "m", "film minus laser"),
            "scale_uncertainty": variable((), expected, "1", text),
            "film": variable("time", film.values, "m", f"film, {level}"),
            "laser": variable("time", seen.values, "m", f"mean of the laser's repeats, {level}"),
        },
        coords={"time": film["time"]},
    )
    agreement, ratio, u_ratio = _along(made, bounces, laser, expected)
    made = made.assign(curve_table((), [(agreement, signals.nrmse(film, seen), bias)], "m"))
    u_bias = float(np.linalg.norm([u_noise, *scaled]))
    made = made.assign(with_u("bias", (), bias, u_bias, "m", "mean of film minus laser"))
    text = "displacement, film over laser; u without that of the scales"
    made = made.assign(with_u(RATIO, (), ratio, u_ratio, "1", text))
    count = min(bounces.sizes["impact"], laser.sizes["impact"])
    ours, theirs = ([one[f"{u}restitution"].values[:count] for u in ("", "u_")] for one in (bounces, laser))
    gap = [ours[0] - theirs[0], np.hypot(ours[1], theirs[1])]
    for key, (values, u) in (("film", ours), ("laser", theirs), ("difference", gap)):
        made = made.assign(with_u(f"restitution_{key}", "impact", values, u, "1", f"restitution, {key}"))
    return made.assign_coords(impact=np.arange(1, count + 1))


def _along(
    made: xr.Dataset, film: xr.Dataset, laser: xr.Dataset, ratio: float
) -> tuple[Agreement | None, float, float]:
    """Lay the film over the laser in stretches; return the agreement, and film over laser with its own u."""
    time, start = made["time"].values, float(film["first_contact_time"])
    touches = film["touch_time"].values - start
    leaves = film["liftoff_time"].values - start
    places = flights(time, touches, leaves, float(film["release_time"]) - start)
    if not places:
        return None, np.nan, np.nan
    means, own = stretches(made["residual"].values, places)
    later = np.gradient(made["laser"].values, time)
    touched = [float(one["u_touch_time"][0]) * (later + float(laser["incoming_speed"][0])) for one in (film, laser)]
    apart = moved_by_scatter(time, touches, laser["touch_time_sd"].values, later)
    level = np.full(time.size, float(film["u_contact_level"]))
    effects = stretch_means((made["laser"].values, level, *touched, *apart), places)
    agreed = along_curve(means, own, np.vstack([ratio * effects[:1], effects[1:]]))
    known = np.isfinite(means) & np.isfinite(own) & np.isfinite(effects).all(axis=0)
    size, others = effects[0, known], effects[1:, known]
    weighted = np.linalg.pinv(others.T @ others + np.diag(own[known] ** 2), hermitian=True) @ size
    if not size @ weighted > 0.0:
        return agreed, np.nan, np.nan
    return agreed, 1.0 + float(weighted @ means[known] / (size @ weighted)), float((size @ weighted) ** -0.5)


def rows(comparison: xr.Dataset) -> Iterator[Row]:
    """Yield the rows of ``compare``; none where no laser saw the motion."""
    if "bias" not in comparison:
        return
    n = int(comparison.sizes["time"])
    yield curve_row("displacement", "m", n, comparison, against="laser")
    ratio, own, scales = (float(comparison[of]) for of in (RATIO, f"u_{RATIO}", "scale_uncertainty"))
    if np.isfinite(ratio):
        yield row("displacement, film over laser", "1", n, against="laser", measured=(ratio, own), model=(1.0, scales))
    for i in range(min(IMPACTS, comparison.sizes["impact"])):
        seen, other = (with_its_u(comparison, f"restitution_{by}", i) for by in ("film", "laser"))
        yield row(f"restitution, impact {i + 1}", "1", 1, against="laser", measured=seen, model=other)
