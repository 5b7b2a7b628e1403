"""Whether the flights of a film last as long as the contacts after them say."""

from math import hypot, sqrt

import numpy as np
import xarray as xr

from labpipe.arrays import Floats
from labpipe.judging import DOUBTFUL, Check, not_made, stated
from labpipe.report import quantity
from pipelines.experiments.contact_area.settings import ContactArea

_POWER = 2.5  # of the largest radius, with which the speed of an impact goes (Hertz)
_ROUGH = 0.02  # relative, by which a plate that swings changes a flight
_LIKE_MODEL = 1.1  # of what weight and relaxation add to that law: the model may be of another material
_SHORTEST = 0.25  # of the longest flight: the swing of a plate is a large part of what ends a shorter one
_LAW = 0.012  # relative, by which a model misses how restitution goes with the radii
_MISSED = 1.6  # times as long as its contacts say: one bounce left out makes a flight 1 + 1/e times as long, 2 and more


def restitution_by_radii(impacts: xr.Dataset, model: xr.Dataset, u_scale: float) -> tuple[float, float]:
    """Return the first restitution by the radii of two impacts and the model's law between both, and its relative u.

    ``u_scale`` is the relative uncertainty that all radii share.
    """
    a, ours = impacts["peak_radius"].values, model["peak_contact_radius"].values
    bounced = float(model["restitution"][0] * (a[1] / a[0] * ours[0] / ours[1]) ** _POWER)
    return bounced, hypot(_LAW, _POWER * float(np.hypot(*_own(impacts, u_scale)[:2])))


def _own(impacts: xr.Dataset, u_scale: float) -> Floats:
    """Return the relative uncertainty of the largest radii without that of the scale, which they share."""
    return np.sqrt(np.maximum((impacts["u_peak_radius"] / impacts["peak_radius"]).values ** 2 - u_scale**2, 0.0))


def begins_late(too_high: float, radius: xr.Dataset | None, impacts: xr.Dataset | None, settings: ContactArea) -> bool:
    """Tell whether an impact may lie before the film, where the stated height is too large by a factor.

    The flight before the first impact that is seen would have lasted as long as its speed says, and the film shows less
    of it.
    """
    if too_high <= 1.0 or radius is None or impacts is None or not impacts.sizes["impact"]:
        return False
    flight = 2 * sqrt(2 * settings.height.value / too_high / settings.model.gravity.value)
    return float(impacts["first_seen"][0] - radius["time"][0]) < flight


def none_missed(radius: xr.Dataset, impacts: xr.Dataset, settings: ContactArea) -> Check:
    """Look for an impact that lies between two others and that no frame shows.

    All that follow would be held against the wrong ones of the model. The fall from the stated height takes the
    place of the flight before the first impact, so that two impacts are enough.
    """
    name = "impacts in turn"
    time, a = impacts["peak_time"].values, impacts["peak_radius"].values
    if time.size < 2 or not np.all(np.isfinite(a)):
        return not_made(name, "two impacts")
    fall = 2 * sqrt(2 * settings.height.value / settings.model.gravity.value)
    lasts = np.diff(time)
    longer = lasts / fall * (a[0] / a[1:]) ** _POWER
    worst = int(np.argmax(longer))
    text = (
        f"{settings.film}: {quantity(float(lasts[worst]), 's')} between impacts {worst + 1} and {worst + 2}, "
        f"{longer[worst]:.2g} times what the radii of the two and the stated height say"
    )
    if longer[worst] < _MISSED:
        return stated(name, text, None, file=settings.film)
    begin, end = (int(np.argmin(np.abs(radius["time"].values - time[k]))) for k in (worst, worst + 1))
    frames = radius["frame"].values
    cause = (
        f"an impact between frames {frames[begin]} and {frames[end]} was not recorded, so that those after it are held "
        "against the wrong ones of the model; or the stated height is far too small"
    )
    return stated(name, text, "doubtful", cause=cause, file=settings.film, setting="film")


def flights_alike(
    radius: xr.Dataset, impacts: xr.Dataset, settings: ContactArea, model: xr.Dataset | None = None
) -> Check:
    """Hold the flights against each other by the radii of the contacts that end them.

    A flight lasts 2 v/g, and its speed is that of the impact after it, whose largest radius goes with
    v^(2/5). So every flight over the 5/2 power of that radius is one number, whatever the polymer,
    but for weight and relaxation, which the model shows.
    """
    name = "durations of the flights"
    peak, a, u_a = (impacts[n].values for n in ("peak_time", "peak_radius", "u_peak_radius"))
    if model is None or min(peak.size, model.sizes["impact"]) < 3:
        return not_made(name, "three impacts, and a model of them")
    count = min(peak.size, model.sizes["impact"])
    peak, a, u_a, touches = peak[:count], a[:count], u_a[:count], model["contact_duration"].values[:count]
    lasts = np.diff(peak) - 0.5 * (touches[1:] + touches[:-1])
    long = np.flatnonzero(lasts > _SHORTEST * lasts.max())
    theirs = np.diff(model["impact_time"].values[:count]) - touches[:-1]
    known = (lasts[long] > 0) & (theirs[long] > 0) & np.isfinite(a[long + 1]) & np.isfinite(u_a[long + 1])
    long = long[known]
    if long.size < 2:
        return not_made(name, "two flights that last longer than contacts")
    of_model = np.log(theirs[long]) - _POWER * np.log(model["peak_contact_radius"].values[long + 1])
    told = np.log(lasts[long]) - _POWER * np.log(a[long + 1]) - of_model
    own = _own(impacts, float(radius.attrs["u_systematic_relative"]))[long + 1]
    interval = float(np.median(np.diff(radius["time"].values)))
    u = np.hypot(_POWER * own, interval / lasts[long])
    centre, of_law = (np.array([np.median(np.delete(q, k)) for k in range(q.size)]) for q in (told, of_model))
    bent = np.abs(of_model - of_law)
    u_told = np.hypot(u, float(np.median(u)))
    beyond = np.abs(told - centre) - _ROUGH - _LIKE_MODEL * bent - DOUBTFUL * u_told
    # of two, the one that is less like the model's
    worst = int(np.argmax(beyond if long.size > 2 else np.abs(np.log(lasts[long] / theirs[long]))))
    flight, apart = int(long[worst]), float(np.expm1(told[worst] - centre[worst]))
    text = (
        f"{settings.film}: the flight before impact {flight + 2} lasts {quantity(float(lasts[flight]), 's')}, "
        f"{abs(100 * apart):.0f} % {'longer' if apart > 0 else 'shorter'} than the radii of the contacts after the "
        "flights say"
    )
    if beyond[worst] <= 0:
        return stated(name, text, None, file=settings.film)
    begin, end = (int(np.argmin(np.abs(radius["time"].values - peak[k]))) for k in (flight, flight + 1))
    frames = radius["frame"].values
    between = f"between frames {frames[begin]} and {frames[end]}"
    cause = (
        f"frames {'are repeated' if apart > 0 else 'were lost'} {between}, or those of another flight "
        f"{'were lost' if apart > 0 else 'are repeated'}; or films were joined or the lens changed there"
    )
    return stated(name, text, "doubtful", cause=cause, file=settings.film)
