"""A simulated drop as the analysis of a record sees it."""

import numpy as np
import xarray as xr

from labpipe.arrays import Floats
from labpipe.errors import InputError
from labpipe.signals._bounces import LABELS, LONGEST_ARC, TOGETHER, combined
from labpipe.signals._floor import Beneath, Floor
from labpipe.signals._impact_fit import fit_impact
from labpipe.signals._shape_prior import PRIORS
from labpipe.variables import variable

_AFTER_LIFTOFF = 0.1  # of the contact, before a flight counts
_ASTRAY = 0.3  # of the contact, by which no fit misses its touch


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

    A fit that knows the shape of a contact's pulse only as that of polymers in general errs by how far
    this solid's departs from it. In a simulation of the solid it errs by the same: a measurement is compared
    with this, and the shape is then in the uncertainty of neither.

    Parameters
    ----------
    displacement : DataArray (time,) [m]
        Upwards positive, at the record's interval, from the release or before.
    touch_time, contact_duration : array (impact,) [s]
        Of the simulation, one more than asked for where it goes on; a touch without lift-off has no duration (NaN).
    count : int
        Impacts from the first on that are wanted.
    noise : float [m]
        Standard deviation of the record's white noise, which weighs the samples against the
        shape that the fit expects.
    gravity, u_gravity : float [m/s2]
        Of the simulation, and its uncertainty in the record.
    contact, floor
        As the record was analysed.

    Returns
    -------
    Dataset
        Over ``impact``: ``restitution``, ``contact_duration`` [s], ``incoming_speed`` [m/s] and
        ``penetration`` [m]; NaN where the simulation ends within the contact, or the fit
        finds another one.

    Raises
    ------
    InputError
        The noise is not positive.

    Examples
    --------
    >>> from labpipe.contact import drop
    >>> from labpipe.materials import Prony
    >>> acrylic = Prony.from_creep(2e9, [0.25e-9], [1e-3], nu=0.35)
    >>> made = drop(acrylic, 9.525e-3, 0.505, 1.5e-3, 0.05, times=np.arange(0.0, 0.05, 5e-5))
    >>> seen = as_fitted(
    ...     made.displacement,
    ...     made.impact_time.values,
    ...     made.contact_duration.values,
    ...     1,
    ...     noise=1e-6,
    ...     gravity=9.81,
    ...     u_gravity=0.01,
    ... )
    >>> abs(float(seen.penetration[0] / made.penetration[0]) - 1) < 0.05
    True
    """
    if not noise > 0.0:
        raise InputError(f"noise = {noise} m: expected the positive standard deviation of the record's noise")
    time, height = displacement["time"].values, displacement.values
    found = np.full((count, len(TOGETHER)), np.nan)
    beneath = None if floor is None else Beneath(floor)
    liftoff = touch_time + contact_duration
    for i in range(min(count, int(np.isfinite(liftoff).sum()))):
        # of the fall, what the record's own fit takes
        begin = liftoff[i - 1] + _AFTER_LIFTOFF * contact_duration[i - 1] if i else touch_time[0] / 3.0
        end = touch_time[i + 1] if i + 1 < touch_time.size and np.isfinite(touch_time[i + 1]) else time[-1]
        between = [max(begin, touch_time[i] - LONGEST_ARC), min(end, liftoff[i] + LONGEST_ARC)]
        window = slice(*(int(n) for n in np.searchsorted(time, between)))
        guess = (float(touch_time[i]), float(liftoff[i]))
        fit = fit_impact(
            time[window], height[window], noise, guess, gravity, u_gravity, PRIORS[contact], beneath=beneath
        )
        beneath = fit.beneath
        if abs(fit.value[0] - touch_time[i]) < _ASTRAY * contact_duration[i]:
            found[i] = [combined(name, fit.value, 1)[0] for name in TOGETHER]
    return xr.Dataset(
        {
            name: variable("impact", values, LABELS[name][0], f"{LABELS[name][1]}, as a fit to the motion finds it")
            for name, values in zip(TOGETHER, found.T, strict=True)
        },
        coords={"impact": np.arange(1, count + 1)},
    )
