"""Checks of the arguments of a drop, before anything is computed."""

import warnings
from math import isfinite
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from labpipe.arrays import Floats
from labpipe.contact.impact._dataset import Setting
from labpipe.contact.impact._line_springs import Profile
from labpipe.errors import InputError
from labpipe.units import Measure

Solver = Literal["mdr", "rings", "thesis"]

# Where rtol may lie: below, rounding; above, the estimates of the error mean nothing.
_RTOL_RANGE = (1e-8, 1e-2)

# A radius like these, in m, is one in mm; a larger one is a wish for a flat.
_MILLIMETRES = (1.0, 50.0)


def warn_of_millimetres(radius: Measure, mass: Measure, height: Measure) -> None:
    """Warn of a sphere of metres, given as a bare number, and say what to write."""
    if isinstance(radius, int | float) and _MILLIMETRES[0] < radius <= _MILLIMETRES[1]:
        texts = [f'radius="{radius:g} mm"']
        texts += [f'mass="{mass:g} g"'] if isinstance(mass, int | float) and mass > 1 else []
        texts += [f'height="{height:g} mm"'] if isinstance(height, int | float) else []
        message = f"radius={radius:g} is a sphere of {radius:g} m; if millimetres were meant, write {', '.join(texts)}"
        warnings.warn(message, UserWarning, stacklevel=3)


def checked(setting: Setting) -> Setting:
    """Refuse what is out of range, with the reason."""
    for name, value, low in (
        ("radius", setting.radius, "positive"),
        ("mass", setting.mass, "positive"),
        ("duration", setting.duration, "positive"),
        ("gravity", setting.gravity, "positive"),
        ("height", setting.height, "0 or positive"),
    ):
        if not (isfinite(value) and (value > 0.0 or (value == 0.0 and low != "positive"))):
            raise InputError(f"{name} is {value}, expected a finite number, {low}")
    if setting.solver not in get_args(Solver):
        raise InputError(f'solver is "{setting.solver}", expected one of {", ".join(get_args(Solver))}')
    if setting.profile not in get_args(Profile):
        raise InputError(f'profile is "{setting.profile}", expected one of {", ".join(get_args(Profile))}')
    low_rtol, high_rtol = _RTOL_RANGE
    if not low_rtol <= setting.rtol <= high_rtol:
        raise InputError(f"rtol is {setting.rtol}, expected {low_rtol} to {high_rtol}")
    if setting.plate is not None and setting.solver == "thesis":
        raise InputError("the thesis's scheme has a rigid substrate; drop the plate or use another solver")
    return setting


def checked_times(name: str, times: ArrayLike, duration: float) -> Floats:
    """Refuse instants that do not rise within the duration; return them as an array (time,)."""
    wanted = np.atleast_1d(np.asarray(times, dtype=float))
    is_inside = np.all((wanted >= 0.0) & (wanted <= duration))
    if wanted.ndim != 1 or not wanted.size or not is_inside or np.any(np.diff(wanted) <= 0.0):
        raise InputError(f"{name} must increase strictly and lie within 0 and {duration} s")
    return wanted
