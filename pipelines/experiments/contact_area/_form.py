"""The contact radius of one simulated impact at any time, between the times that the model holds."""

from dataclasses import dataclass

import numpy as np
import xarray as xr
from scipy.interpolate import CubicSpline

from labpipe.arrays import Floats
from pipelines.experiments.contact_area._peaks import STILL


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
