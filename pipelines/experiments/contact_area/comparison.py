"""Comparison of film and model: contact radii around an impact, and the largest ones."""

from collections.abc import Iterator
from dataclasses import dataclass
from math import sqrt

import numpy as np
import xarray as xr
from scipy.interpolate import CubicSpline

from labpipe.arrays import Floats
from labpipe.judging import Agreement, along_curve
from labpipe.variables import variable, with_u
from pipelines.experiments.contact_area.measured import BESIDE, STILL, WINDOW, peak_of
from pipelines.experiments.contact_area.settings import ContactArea
from pipelines.experiments.shared.comparison_rows import IMPACTS, Row, curve_table, of_curve, row, with_its_u
from pipelines.experiments.shared.drop_model import slopes_of

SCALE = "scale of the image"
"""Input of the rows beside those of the model."""
WAVELENGTH = "wavelength"
FRAMES = "radius in all frames alike"
"""Of the rows: what frames have in common beside the length of a pixel, as the light's phase."""

_MOST_SHIFT = 2.0
"""Frame intervals by which the model may be shifted against the largest radius: it lies between frames."""
_MOST_LONGER = 0.3  # by which a contact may last longer than in the model and still have its form
_SIZE_STEPS = 8  # of Gauss and Newton, from the model's own size and time
_FEWEST = 5  # frames of a contact from which its shift in time can be told from its size


@dataclass(frozen=True, slots=True)
class Form:
    """A course of the radius from touch to lift-off.

    The radius begins and ends as a root of time: straight lines between its values lie below it, by 10 µm beside
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
    time, a = radius["time"].values, radius["radius"].values
    seen = radius["in_contact"].values.astype(bool) & np.isfinite(a)
    random, shared = radius["u_radius"].values, radius["radius_systematic"].values
    points: list[Floats] = []
    table: dict[str, list[float]] = {name: [] for name in ("peak", "shift", "u_shift", "size", "u_size", "nrmse")}
    agreed: list[Agreement | None] = []
    for i in range(count):
        peak, form = _model_peak(model, i), Form.of(model, i)
        since = time - float(impacts["peak_time"][i])
        begin, end = float(impacts["first_seen"][i]), float(impacts["last_seen"][i])
        inside = seen & (np.abs(since) < WINDOW) & (time >= begin) & (time <= end)
        ours, own, common, moments = a[inside], random[inside], shared[inside], since[inside] + peak
        relative = float(model["u_peak_contact_radius"][i] / model["peak_contact_radius"][i])
        shift = _time_shift(moments, ours, common, form, relative)
        size = _size(moments, ours, own, common, form)
        theirs = form(moments + shift[0])
        points.append(np.stack([np.full(ours.size, i + 1.0), since[inside], ours, np.hypot(own, common), theirs]))
        agreed.append(_along(moments + shift[0], ours - theirs, own, common, form, relative))
        nrmse = float(np.sqrt(np.mean((ours - theirs) ** 2))) / max(float(np.max(theirs)), 1e-12)
        for name, value in zip(table, (peak, *shift, *size, nrmse), strict=True):
            table[name].append(value)
    number, since, film, u_film, expected = np.concatenate([np.empty((5, 0)), *points], axis=1)
    known = {name: np.array(values, dtype=float) for name, values in table.items()}
    theirs = model["peak_contact_radius"].values[:count]
    # where the frames of a whole contact are too few, its largest radius alone
    ours, u_ours = (
        np.where(np.isfinite(known[of]), theirs * known[of], impacts[name].values[:count])
        for of, name in (("size", "peak_radius"), ("u_size", "u_peak_radius"))
    )
    alike = float(np.nanmedian(shared / a)) if np.isfinite(shared / a).any() else 0.0
    beyond = sqrt(max(alike**2 - float(radius.attrs.get("u_systematic_relative", 0.0)) ** 2, 0.0))
    u = np.hypot(u_ours, model["u_peak_contact_radius"].values[:count])
    edge, u_edge = (model[name].values[:count] for name in ("adhesion_shift", "u_adhesion_shift"))
    u_edge, apart = np.hypot(u_ours, u_edge), "largest radius, film minus model"
    of_frames = {
        "impact_number": (number, "1", "impact of a compared frame"),
        "since_peak": (since, "s", "time since the largest radius"),
        "film": (film, "m", "contact radius, film"),
        "u_film": (u_film, "m", "standard uncertainty: contact radius, film"),
        "model": (expected, "m", "contact radius, model"),
    }
    of_impacts = {
        "nrmse": (known["nrmse"], "1", "root-mean-square error over largest radius of the model"),
        "peak_radius_alike": (beyond * ours, "m", f"part of its uncertainty that all impacts share: {FRAMES}"),
        "peak_radius_model": (theirs, "m", "largest radius, model"),
        "model_peak_time": (known["peak"], "s", "time of the model's largest radius"),
    }
    return xr.Dataset(
        {
            **{name: variable("sample", *each) for name, each in of_frames.items()},
            **{name: variable("impact", *each) for name, each in of_impacts.items()},
            **with_u("peak_radius_film", "impact", ours, u_ours, "m", "largest radius, film"),
            **with_u("peak_radius_difference", "impact", ours - theirs, u, "m", apart),
            **with_u("edge_radius", "impact", ours + edge, u_edge, "m", "radius of the edge of the contact"),
            **with_u(
                "time_shift", "impact", known["shift"], known["u_shift"], "s", "shift of the model to earlier times"
            ),
            **curve_table("impact", agreed),
        },
        coords={"impact": np.arange(1, count + 1)},
    )


def _along(time: Floats, left: Floats, random: Floats, shared: Floats, form: Form, relative: float) -> Agreement | None:
    """Lay the frames of a contact against the model, each with its own noise.

    They share the scale, the moment of the largest radius, which lies between frames, and what the inputs of the
    model do to its size (`relative`). What makes a contact smaller by E^-0.2 makes it shorter by E^-0.4.
    """
    if time.size < _FEWEST:
        return None
    step = float(np.median(np.diff(time)))
    return along_curve(left, random, [*_alike(time, shared, form, relative), step * form.rate(time)])


def _alike(time: Floats, shared: Floats, form: Form, relative: float) -> tuple[Floats, ...]:
    """Return what all radii (m) of a contact have in common: scale, size of the model, and how long it lasts."""
    longer = -2.0 * relative * form.rate(time) * (time - float(np.mean(time)))
    return shared, relative * form(time), longer


def _time_shift(time: Floats, radius: Floats, shared: Floats, form: Form, relative: float) -> tuple[float, float]:
    """Time added to the model's clock with which it comes nearest to the film, and its uncertainty.

    By the square of the radius, which begins and ends evenly; the radius itself begins as a root, and a frame
    just after the touch would decide. A model that lasts too long shifts it as well. 0, with an uncertainty of
    NaN, where there are too few frames, or where the best lies beyond what the alignment at the largest radius
    can miss.
    """
    if len(time) < _FEWEST:
        return 0.0, np.nan
    shift = 0.0
    for _ in range(_SIZE_STEPS):
        at = time + shift
        theirs = form(at)
        slope = 2.0 * theirs * form.rate(at)
        rest, weight = radius**2 - theirs**2, max(float(slope @ slope), 1e-300)
        shift += float(slope @ rest) / weight
    is_better = rest @ rest <= ((radius**2 - form(time) ** 2) ** 2).sum()
    if not abs(shift) < 0.95 * _MOST_SHIFT * float(np.median(np.diff(time))) or not is_better:
        return 0.0, np.nan
    scatter = np.sqrt(rest @ rest / (len(time) - 1) / weight)
    moved = (slope @ (2.0 * theirs * each) / weight for each in _alike(at, shared, form, relative))
    return shift, float(np.hypot(scatter, np.sqrt(sum(each**2 for each in moved))))


def _size(time: Floats, radius: Floats, random: Floats, shared: Floats, form: Form) -> tuple[float, float]:
    """Return how many times as large a contact is in the film as in the model, and its uncertainty.

    All frames of the contact tell it, in the model's form, together with its shift in time and how much
    longer it lasts: the largest radius lies between frames, and by itself is known as badly as they are
    far apart. A form that the frames do not follow enlarges the uncertainty; another duration is no
    other form, or a model of a wrong mass would hide what it has wrong. NaN where there are too few frames.
    """
    if len(time) < _FEWEST:
        return np.nan, np.nan
    since = time - float(np.mean(time))
    size, shift, longer = 1.0, 0.0, 0.0
    for _ in range(_SIZE_STEPS):
        at = time + shift - longer * since
        theirs, rate = form(at), size * form.rate(at)
        rows = np.column_stack([theirs, rate, -rate * since]) / random[:, None]
        if not np.isfinite(rows).all():  # a size that runs away: the frames do not follow the form
            return np.nan, np.nan
        rest = (radius - size * theirs) / random
        normal = np.linalg.pinv(rows.T @ rows, hermitian=True)
        size, shift, longer = np.array([size, shift, longer]) + normal @ rows.T @ rest
    if abs(shift) > _MOST_SHIFT * float(np.median(np.diff(time))) or abs(longer) > _MOST_LONGER:
        return np.nan, np.nan
    scatter = float(rest @ rest) / (len(time) - rows.shape[1])
    common = float(np.mean(shared / np.maximum(radius, 1e-12)))
    return size, float(np.hypot(np.sqrt(normal[0, 0] * max(scatter, 1.0)), size * common))


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


def rows(comparison: xr.Dataset, model: xr.Dataset) -> Iterator[Row]:
    """Yield the rows of ``compare``."""
    counts = comparison["impact_number"].values
    for i in range(min(IMPACTS, comparison.sizes["impact"])):
        inside = counts == i + 1
        gap = (comparison["film"] - comparison["model"]).values[inside]
        title, n, curve = f"contact radius, impact {i + 1}", int(inside.sum()), of_curve(comparison.isel(impact=i))
        yield row(title, "m", n, nrmse=comparison["nrmse"][i], difference=gap.mean(), **curve)
        own = {SCALE: float(comparison["peak_radius_film"][i]), FRAMES: float(comparison["peak_radius_alike"][i])}
        yield row(
            f"largest radius, impact {i + 1}",
            "m",
            1,
            measured=with_its_u(comparison, "peak_radius_film", i),
            model=(comparison["peak_radius_model"][i], model["u_peak_contact_radius"][i]),
            difference=with_its_u(comparison, "peak_radius_difference", i),
            simulated=("peak_contact_radius", i),
            slopes=own | slopes_of(model, "peak_contact_radius", i),
        )
