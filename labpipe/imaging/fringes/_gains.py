"""What would be gained by fitting more, to first order: a score test of all explanations at once."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from labpipe.imaging.fringes._ring_fit import RingFit, fit_ring, ring_around
from labpipe.imaging.fringes._ring_parameters import AXES, RADIAL, Parameter
from labpipe.imaging.fringes._view import View

#: Difference of the shares that two explanations promise up to which the simpler comes first: a flat that explained all
#: promised 0.89, and a distance from focus with harmonics and a scale, which there was not, 0.99.
_NEARLY = 0.25
_Name = TypeVar("_Name")


@dataclass(frozen=True)
class Gains:
    """What fits of some frames would gain.

    Attributes
    ----------
    fits : tuple of RingFit
        Fits that ask for all that may be fitted as well.
    excess : float
        Mean squared misfit of the frames.
    """

    fits: tuple[RingFit, ...]
    excess: float

    def explained(self, parameters: Sequence[Parameter], *, is_common: bool = True) -> float:
        """Return by how much the mean squared misfit would fall, with one value in all frames or with several."""
        slopes, bends = [], []
        for fit in self.fits:
            rows = [fit.asked.index(p) for p in dict.fromkeys(parameters) if p in fit.asked]
            if fit.slope is not None and fit.bend is not None:
                size = max(fit.pixels * float(fit.parameters[Parameter.MODULATION]) ** 2, 1e-12)
                slopes.append(fit.slope[rows] / size)
                bends.append(fit.bend[np.ix_(rows, rows)] / size)
        pairs = [(sum(slopes), sum(bends))] if is_common and slopes else zip(slopes, bends, strict=True)
        return sum(float(slope @ np.linalg.lstsq(bend, slope)[0]) for slope, bend in pairs) / max(len(self.fits), 1)

    def share(self, parameters: Sequence[Parameter], *, is_common: bool = True) -> float:
        """Return the share of the mean squared misfit that they would explain."""
        return self.explained(parameters, is_common=is_common) / max(self.excess, 1e-300)


def gains_of(images: Sequence[NDArray[np.generic]], fits: Sequence[RingFit], view: View) -> Gains:
    """Tell what fits would gain by what changes the light with the distance alone, and by an oblique view.

    Parameters
    ----------
    images : sequence of arrays (row, column)
        Grey levels.
    fits : sequence of RingFit
        Fits of them.
    view : View
        The view they were made with; its settings tell how many pixels are used.

    Notes
    -----
    A step of Gauss and Newton from where the fits ended. On 46 films of 23 kinds the right explanation gained 0.9 times
    as much as this said to 1.6 times, and what was wrong promised less than half of it or explained as much.
    """
    asking: list[RingFit] = []
    for image, fit in zip(images, fits, strict=True):
        settings = replace(view.settings, free=fit.free, asks=(*RADIAL, *AXES), max_iterations=1, tells_memory=False)
        ring = ring_around(image, fit.parameters, view.optics, settings, view.levels)
        if ring is not None:
            asking.append(fit_ring(ring, fit.parameters, view.optics, settings))
    return Gains(tuple(asking), float(np.mean([fit.misfit**2 for fit in fits])))


def in_order(shares: dict[_Name, float]) -> list[_Name]:
    """Return explanations that promise about as much as the best one, the simpler first, and the others after them."""
    most = max(shares.values(), default=0.0)
    return sorted(shares, key=lambda name: shares[name] < most - _NEARLY)
