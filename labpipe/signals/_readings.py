"""Checks of a series of readings before it is analysed."""

import numpy as np
from numpy.typing import ArrayLike

from labpipe.arrays import Floats
from labpipe.errors import InputError

LARGEST, LEAST = 1e75, 1e-75  # no quantity in SI units is beyond; fourth powers of both are still numbers


def checked_times(time: ArrayLike, what: str = "time") -> Floats:
    """Return times as float64; InputError where they are not one-dimensional or do not increase.

    ``what`` names the record in the message.
    """
    t = np.array(time, float)
    if t.ndim != 1:
        raise InputError(f"{what} must be one-dimensional; found the shape {t.shape}")
    with np.errstate(invalid="ignore"):  # infinity minus infinity
        if t.size > 1 and np.min(np.diff(t)) > LEAST and t[0] > -LARGEST and t[-1] < LARGEST:
            return t
    # An infinite time may well follow a finite one, and nothing but infinity follows it.
    after = np.append(-np.inf, t[:-1])
    wrong = np.flatnonzero(~(np.isfinite(t) & (t > after)))
    if wrong.size:
        i = int(wrong[0])
        said = f" after {t[i - 1]} s" if i else ""
        raise InputError(f"{what} must increase and be finite; sample {i} is at {t[i]} s{said}")
    if t.size > 1 or (t.size and abs(t[0]) >= LARGEST):
        steps = f" in steps of {np.min(np.diff(t)):.3g} s" if t.size > 1 else ""
        raise InputError(f"{what} must be in s; found {t[0]:.3g} to {t[-1]:.3g} s{steps}")
    return t


def refuse_infinite(values: Floats, what: str) -> None:
    """Refuse infinite readings, and those larger than any quantity (1e75); NaN says that there is no reading."""
    wrong = np.flatnonzero(np.abs(values) > LARGEST)
    if wrong.size:
        i = int(wrong[0])
        raise InputError(f"{what} must be finite or NaN; sample {i} is {values.ravel()[i]}")


def readings_of(**records: ArrayLike) -> list[Floats]:
    """Return records of one length (n,) as float64, without the readings at which one of them is NaN.

    The keywords name them in the message of the InputError: shapes differ, infinite, or ``time`` does not increase.
    """
    found = {name: np.array(each, float) for name, each in records.items()}
    shapes = [each.shape for each in found.values()]
    if len(shapes[0]) != 1 or len(set(shapes)) > 1:
        names, sizes = (", ".join(map(str, of)) for of in (found, shapes))
        raise InputError(f"{names} must be one-dimensional, of one shape; found the shapes {sizes}")
    for name, each in found.items():
        if name == "time":
            checked_times(each)
        else:
            refuse_infinite(each, name)
    finite = np.all(np.isfinite(list(found.values())), axis=0)
    return [each[finite] for each in found.values()]


def is_constant(values: Floats) -> bool:
    """Return True where finite readings do not vary, or by less than any quantity does (1e-75)."""
    return values.size == 0 or float(np.ptp(values)) <= LEAST
