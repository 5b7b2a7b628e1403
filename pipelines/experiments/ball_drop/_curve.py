"""The path of a drop against the model's: chi square of its fall and flights."""

import numpy as np
import xarray as xr

from labpipe.arrays import Floats
from labpipe.judging import Agreement, along_curve, stretch_means, stretches
from pipelines.experiments.ball_drop._model_uncertainty import FOLLOWED, path_by_input, stored_slopes
from pipelines.experiments.shared.flights import flights, moved_by_scatter

_LOST = 0.03  # of a flight, uncertainty of its end from which sensitivities do not tell the path
_FEW_REPEATS = 3.0  # by which the variance of two or three is taken larger


def along(repeats: xr.Dataset, model: xr.Dataset, since: Floats, left: Floats) -> Agreement | None:
    """Lay fall and flights against the model, each in a few stretches.

    They share the scale of length, the moment of first touch, what the model takes of its inputs, and the
    scatter between repeats, of each as a whole and of each impact, which moves what follows.
    """
    flown = np.diff(model["impact_time"].values[:FOLLOWED], prepend=0.0)
    lost = np.flatnonzero(model["u_impact_time"].values[:FOLLOWED] > _LOST * flown)
    known = slice(int(lost[0]) if lost.size else FOLLOWED)
    touches = model["impact_time"].values[known] - float(model["impact_time"][0])
    leaves = touches + model["contact_duration"].values[known]
    places = flights(repeats["time"].values, touches, leaves, float(since[0]))
    if not places:
        return None
    means, own = stretches(left, places)
    time, path = repeats["time"].values, model["displacement"].values
    on_grid = (np.interp(time, since, one) for one in path_by_input(model, stored_slopes(model)))
    relative, u_touch = float(repeats.attrs["u_systematic_relative"]), float(repeats["u_touch_time"][0])
    # a touch that is taken too late has its level too low
    later = np.interp(time, since, np.gradient(path, since))
    touched = u_touch * (later + float(model["impact_speed"][0]))
    shared = [relative * np.interp(time, since, path), touched, *on_grid]
    n = repeats.sizes["repeat"]
    if n > 1:
        wider = np.sqrt((n - 1) / (n - 3) if n > 3 else _FEW_REPEATS)  # variance of Student's distribution
        apart = (repeats["displacement"] - repeats["displacement"].mean("repeat", skipna=False)).values
        shared += list(apart * wider / np.sqrt(n * (n - 1)))
        sd = repeats["touch_time_sd"].values * wider / np.sqrt(n)
        shared += moved_by_scatter(time, repeats["touch_time"].values, sd, later)
    return along_curve(means, own, stretch_means(shared, places))
