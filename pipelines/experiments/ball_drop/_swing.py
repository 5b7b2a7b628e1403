"""What slopes miss where a touch comes so much later that it meets the plate elsewhere in its swing."""

from collections.abc import Callable, Mapping

import numpy as np
import xarray as xr

from labpipe import contact
from labpipe.arrays import Floats
from labpipe.variables import variable
from pipelines.experiments.ball_drop.measured import padded

SWUNG = ("restitution", "contact_duration")
"""Results of a later impact that depend on how the plate swings when it comes."""
_TIME = "impact_time"
_SMALL = 1e-3  # relative change of the height by which slopes are found


def with_swing(
    made: xr.Dataset,
    repeats: xr.Dataset,
    plate: contact.Plate | None,
    height: float,
    falls: Callable[[Floats, int], Mapping[str, Floats]],
    most: int,
) -> xr.Dataset:
    """Add to a simulated drop what its slopes miss at the moments at which touches were measured.

    A body that falls from so much higher that a touch comes when it was measured meets the plate as the measured
    one did, and little else is changed. What its impact is off the line of the height's slope is the curvature.

    ``repeats`` holds ``touch_time`` (impact,) [s] as measured, from the first; ``falls`` takes heights (drop,) [m] and
    a number of impacts and returns results (drop, impact) by name, of which ``most`` are compared. If later impacts are
    on a plate, ``swing_restitution`` [1] and ``swing_contact_duration`` [s] (impact,) are added.
    """
    count = min(most, repeats.sizes["impact"])
    touches = made[_TIME].values[:count]
    late = np.nan_to_num(repeats["touch_time"].values[:count] - (touches - touches[:1]))
    if plate is None or count < 2:
        return made
    # a delay by more than half a swing is no longer told from others
    late = np.clip(late, -0.5 / plate.frequency, 0.5 / plate.frequency)
    step = _SMALL * height
    near = falls(height + step * np.array([0.0, -1.0, 1.0]), count)
    slopes = {name: (near[name][2] - near[name][1]) / (2 * step) for name in (*SWUNG, _TIME)}
    higher = np.divide(late, slopes[_TIME], out=np.zeros(count), where=np.arange(count) > 0)
    moved = falls(height + higher, count)
    for name in SWUNG:
        apart = np.abs(np.diagonal(moved[name]) - near[name][0] - slopes[name] * higher)
        made[f"swing_{name}"] = variable(
            "impact",
            padded(apart, made.sizes["impact"]),
            made[name].attrs["units"],
            f"what slopes miss where the touch meets the plate elsewhere in its swing: {name}",
        )
    return made
