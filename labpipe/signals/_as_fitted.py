"""A simulated drop as the analysis of a record sees it."""

import numpy as np
import xarray as xr

from labpipe.arrays import Floats
from labpipe.signals._bounces import TOGETHER, fitted
from labpipe.signals._impact_fit import LABELS, OUTPUTS
from labpipe.signals._noise_spectrum import WHITE
from labpipe.signals._reversals import Turn
from labpipe.signals._shape_prior import PRIORS, Floor
from labpipe.variables import variable


def as_fitted(
    displacement: xr.DataArray,
    touch_time: Floats,
    contact_duration: Floats,
    count: int,
    *,
    noise: float,
    gravity: float,
    u_gravity: float,
    contact: str = "any",
    floor: Floor | None = None,
) -> xr.Dataset:
    """Return the result of :func:`labpipe.signals.bounces` for a motion without noise.

    A fit that knows the shape of a contact's pulse only as that of polymers in general errs by the same in a record and
    in a simulation of the solid: where they are compared, the shape is in the uncertainty of neither.

    Parameters
    ----------
    displacement : DataArray (time,) [m]
        Upwards positive, at the record's interval, from the release or before.
    touch_time, contact_duration : array (impact,) [s]
        Of the simulation, one more than asked for where it goes on; a touch without lift-off has no duration (NaN).
    count : int
        Impacts from the first on that are wanted.
    noise, gravity, u_gravity : float [m, m/s2]
        The record's white noise, which weighs the samples against the expected shape; the simulation's acceleration,
        and its uncertainty in the record.
    contact, floor
        As the record was analysed.

    Returns
    -------
    Dataset
        Over ``impact`` the quantities that are compared together, such as ``restitution``; NaN where the simulation
        ends within the contact, or the fit finds another one.
    """
    time, height = displacement["time"].values, displacement.values
    ends = np.searchsorted(time, np.append(touch_time[1:], np.inf))
    turns = [
        Turn(int(np.searchsorted(time, touch)), 0, int(end), float(touch), float(touch + lasts), 0.0)
        for touch, lasts, end in zip(touch_time, contact_duration, ends, strict=True)
        if np.isfinite(lasts)
    ]
    fits, _ = fitted(time, height, (noise, WHITE), turns[:count], (gravity, u_gravity), PRIORS[contact], floor)
    found = np.full((count, len(TOGETHER)), np.nan)
    for row, fit, turn in zip(found, fits, turns, strict=False):
        if abs(fit.value[0] - turn.touch) < 0.3 * turn.duration:  # no fit of the same impact is further off
            row[:] = [fit.value[OUTPUTS.index(name)] for name in TOGETHER]
    return xr.Dataset(
        {
            name: variable("impact", values, LABELS[name][0], f"{LABELS[name][1]}, as a fit to the motion finds it")
            for name, values in zip(TOGETHER, found.T, strict=True)
        },
        coords={"impact": np.arange(1, count + 1)},
    )
