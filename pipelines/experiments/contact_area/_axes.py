"""The rings of a contact as ellipses: what a camera that looks aslant leaves open of a radius."""

from math import pi, sqrt

import numpy as np
import xarray as xr


def axes_ratio(radius: xr.Dataset) -> tuple[float, float] | None:
    """Return the shorter over the longer axis of the rings of most frames, and the longer one's direction [rad].

    None where no fringes tell it.
    """
    if "semi_axis_minor" not in radius:
        return None
    ratio = (radius["semi_axis_minor"] / radius["semi_axis_major"]).values
    known = np.flatnonzero(np.isfinite(ratio))
    if not known.size:
        return None
    middle = known[np.argsort(ratio[known])[known.size // 2]]
    return float(ratio[middle]), float(radius["axis_angle"].values[middle]) % pi


def u_of_view(radius: xr.Dataset) -> float:
    """Return the relative uncertainty of lengths where it is not told along which axis the scale was measured.

    An oblique view shortens one of them. The radius is that of equal area, between both.
    """
    found = axes_ratio(radius)
    return 0.0 if found is None else (1.0 - sqrt(found[0])) / sqrt(3.0)


def with_uneven_scale(radius: xr.Dataset, relative: float) -> xr.Dataset:
    """Widen what all radii share by that uncertainty."""
    beyond = relative * radius["radius"].values
    part = radius["systematic_part"].copy(deep=True)
    part.loc[{"source": "pixel_size"}] = np.hypot(part.sel(source="pixel_size").values, beyond)
    whole = radius["radius_systematic"].copy(data=np.hypot(radius["radius_systematic"].values, beyond))
    return radius.assign(systematic_part=part, radius_systematic=whole)
