"""Comparison of film and model: contact radii around an impact, and the largest ones."""

from collections.abc import Iterator
from dataclasses import dataclass
from math import sqrt

import numpy as np
import xarray as xr
from scipy.interpolate import CubicSpline
from scipy.optimize import least_squares

from labpipe.arrays import Floats
from labpipe.judging import along_curve
from labpipe.variables import variable, with_u
from pipelines.experiments.contact_area.measured import STILL, WINDOW
from pipelines.experiments.contact_area.settings import ContactArea
from pipelines.experiments.shared.comparison_rows import IMPACTS, Row, curve_row, curve_table, row, with_its_u
from pipelines.experiments.shared.drop_model import slopes_of

SCALE = "scale of the image"
"""Input of the rows beside those of the model."""
WAVELENGTH = "wavelength"
FRAMES = "radius in all frames alike"
"""Of the rows: what frames have in common beside the length of a pixel, as the light's phase."""
_FEWEST = 5  # frames of a contact from which its shift in time can be told from its size


@dataclass(frozen=True, slots=True)
class Form:
    """A course of the radius from touch to lift-off.

    The radius begins and ends as a root of time: straight lines between its values lie below it, by 10 µm near
    a touch where they are 20 µs apart. Its square goes with the approach and is smooth.
    """

    area: CubicSpline

    @classmethod
    def of(cls, model: xr.Dataset, impact: int) -> "Form":
        """Return that of an impact of a model, from its values between touch and lift-off."""
        time, a = model["time"].values, model["contact_radius"].values
        begin, end = (float(model[name][impact]) for name in ("impact_time", "lift_off_time"))
        within = (time > begin) & (a > 0.0) & (time < (end if np.isfinite(end) else begin + STILL))
        leaves = [end] if np.isfinite(end) else []
        square = np.concatenate([[0.0], a[within] ** 2, np.zeros(len(leaves))])
        return cls(CubicSpline(np.concatenate([[begin], time[within], leaves]), square))

    def __call__(self, time: Floats) -> Floats:
        """Return the radius (m) at times (s) of the model's clock; 0 outside of the contact."""
        within = (time >= self.area.x[0]) & (time <= self.area.x[-1])
        return np.sqrt(np.where(within, np.maximum(self.area(time), 0.0), 0.0))

    @property
    def peak(self) -> float:
        """Time of the largest radius [s], by the model's clock."""
        tops = self.area.derivative().roots(extrapolate=False)
        return float(tops[np.argmax(self.area(tops))])

    def rate(self, time: Floats) -> Floats:
        """Return its change with time (m/s); 0 where there is no contact."""
        radius = self(time)
        touches = radius > 0.0
        return np.where(touches, self.area(time, 1) / np.where(touches, 2.0 * radius, 1.0), 0.0)


def comparison(radius: xr.Dataset, impacts: xr.Dataset, model: xr.Dataset, *, settings: ContactArea) -> xr.Dataset:
    """Compare film and model around the largest radius of each impact.

    Both are aligned at their largest radius, then by the small shift in time that minimises the residual: the
    largest radius is flat in time, and the remaining error of it shows where a contact ends.
    """
    del settings
    count = min(impacts.sizes["impact"], model.sizes["impact"])
    time, a, random, shared = (radius[name].values for name in ("time", "radius", "u_radius", "radius_systematic"))
    seen = radius["in_contact"].values.astype(bool) & np.isfinite(a)
    alike = float(np.nanmedian(shared / a)) if np.isfinite(shared / a).any() else 0.0
    points, of_impact, agreed = [np.empty((5, 0))], np.empty((count, 5)), []
    for i in range(count):
        form, since = Form.of(model, i), time - float(impacts["peak_time"][i])
        begin, end = float(impacts["first_seen"][i]), float(impacts["last_seen"][i])
        inside = seen & (np.abs(since) < WINDOW) & (time >= begin) & (time <= end)
        ours, own, common, moments = a[inside], random[inside], shared[inside], since[inside] + form.peak
        fit = _fit(moments, ours, own, alike, form)
        moments = moments + np.nan_to_num(fit[2])
        theirs = form(moments)
        relative = float(model["u_peak_contact_radius"][i] / model["peak_contact_radius"][i])
        points.append(np.stack([np.full(ours.size, i + 1.0), since[inside], ours, np.hypot(own, common), theirs]))
        left, of_impact[i] = ours - theirs, (form.peak, *fit)
        deviation = float(np.sqrt(np.mean(left**2))) / max(float(np.max(theirs)), 1e-12)
        along = None
        if ours.size >= _FEWEST:  # each frame with its own noise
            step, middle, rate = float(np.median(np.diff(moments))), float(np.mean(moments)), form.rate(moments)
            effects = [common, relative * theirs, -2.0 * relative * (moments - middle) * rate, step * rate]
            along = along_curve(left, own, effects)
        agreed.append((along, deviation, float(np.mean(left))))
    peak, size, u_size, shift, u_shift = of_impact.T
    largest, u_largest = (model[f"{u}peak_contact_radius"].values[:count] for u in ("", "u_"))
    # where the frames of a whole contact are too few, its largest radius alone
    ours, u_ours = (
        np.where(np.isfinite(fitted), largest * fitted, impacts[name].values[:count])
        for fitted, name in ((size, "peak_radius"), (u_size, "u_peak_radius"))
    )
    beyond = sqrt(max(alike**2 - float(radius.attrs.get("u_systematic_relative", 0.0)) ** 2, 0.0))
    number, since_peak, film, u_film, simulated = np.concatenate(points, axis=1)
    gap = ("impact", ours - largest, np.hypot(u_ours, u_largest), "m", "largest radius, film minus model")
    alike_text = f"part of its uncertainty that all impacts share: {FRAMES}"
    return xr.Dataset(
        with_u("film", "sample", film, u_film, "m", "contact radius, film")
        | {
            "model": variable("sample", simulated, "m", "contact radius, model"),
            "impact_number": variable("sample", number, "1", "impact of a compared frame"),
            "since_peak": variable("sample", since_peak, "s", "time since the largest radius"),
            "peak_radius_alike": variable("impact", beyond * ours, "m", alike_text),
            "peak_radius_model": variable("impact", largest, "m", "largest radius, model"),
            "model_peak_time": variable("impact", peak, "s", "time of the model's largest radius"),
        }
        | with_u("peak_radius_film", "impact", ours, u_ours, "m", "largest radius, film")
        | with_u("peak_radius_difference", *gap)
        | with_u("time_shift", "impact", np.nan_to_num(shift), u_shift, "s", "shift of the model to earlier times")
        | curve_table("impact", agreed, "m"),
        coords={"impact": np.arange(1, count + 1)},
    )


def _fit(
    time: Floats, radius: Floats, random: Floats, alike: float, form: Form, farthest: float = 2.0, longest: float = 0.3
) -> tuple[float, ...]:
    """Fit size (relative), shift [s] and duration of a model's contact; return the first two with their u, or NaN.

    The largest radius lies between frames: the model is shifted by the ``farthest`` interval of frames at most. A
    contact that lasts longer by more than the ``longest`` share does not have its form.
    """
    if time.size < _FEWEST:
        return (np.nan,) * 4
    step, since = float(np.median(np.diff(time))), time - float(np.mean(time))

    def rest(values: Floats) -> Floats:
        return np.asarray((radius - values[0] * form(time + values[1] * step - values[2] * since)) / random)

    found = least_squares(rest, [1.0, 0.0, 0.0], method="lm")
    size, shift, longer = found.x
    if abs(shift) > farthest or abs(longer) > longest:
        return (np.nan,) * 4
    scatter = max(2.0 * float(found.cost) / (time.size - found.x.size), 1.0)
    normal = np.linalg.pinv(found.jac.T @ found.jac, hermitian=True)
    u_size, u_shift = np.sqrt(scatter * np.diagonal(normal)[:2])
    return float(size), float(np.hypot(u_size, size * alike)), float(shift * step), float(u_shift * step)


def largest_radii(impacts: xr.Dataset, comparison: xr.Dataset | None = None) -> tuple[Floats, Floats]:
    """Return the largest radii (impact,) [m] of a film and their u: by all frames of a contact where a model is there.

    Else by a polynomial through the frames around the largest, which a contact of five frames determines poorly.
    """
    found, u = (impacts[name].values.copy() for name in ("peak_radius", "u_peak_radius"))
    if comparison is not None:
        count = comparison.sizes["impact"]
        found[:count], u[:count] = (comparison[f"{of}peak_radius_film"].values for of in ("", "u_"))
    return found, u


def rows(comparison: xr.Dataset, model: xr.Dataset) -> Iterator[Row]:
    """Yield the rows of ``compare``."""
    counts = comparison["impact_number"].values
    for i in range(min(IMPACTS, comparison.sizes["impact"])):
        title, n = f"contact radius, impact {i + 1}", int((counts == i + 1).sum())
        yield curve_row(title, "m", n, comparison.isel(impact=i))
        own = {SCALE: float(comparison["peak_radius_film"][i]), FRAMES: float(comparison["peak_radius_alike"][i])}
        yield row(
            f"largest radius, impact {i + 1}",
            "m",
            1,
            measured=with_its_u(comparison, "peak_radius_film", i),
            model=(comparison["peak_radius_model"][i], model["u_peak_contact_radius"][i]),
            simulated=("peak_contact_radius", i),
            slopes=own | slopes_of(model, "peak_contact_radius", i),
        )
