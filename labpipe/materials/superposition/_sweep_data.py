"""Checks of isothermal frequency sweeps before shifting.

Everything that would spoil a master curve is refused or said here, with the temperature and the
frequency where it was found.
"""

import warnings
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from labpipe.arrays import Flags, Floats
from labpipe.errors import InputError
from labpipe.materials.superposition._dense_sweeps import means_of
from labpipe.materials.superposition._joint_fit import Points
from labpipe.materials.superposition._outlying import outlying
from labpipe.units import ZERO_CELSIUS

_UNITS = {"storage": "Pa", "loss": "Pa", "frequency": "Hz", "temperature": "degC"}
# A loss modulus at or below zero is noise about a small value; more than this share of them is
# a sign convention or a material without loss.
_MAX_SHARE_OF_LOST_POINTS = 0.25
# Fewer points than this over the whole set say nothing about a spectrum.
_LEAST_POINTS = 4
# A storage modulus that falls with frequency by more than this many times its scatter
# (and by this share at least) is not that of a linear viscoelastic material.
_FALL_SCATTERS, _LEAST_FALL = 5.0, 0.02
# Moduli beyond this (Pa) and below its inverse are of no material, in whatever unit.
_MOST = 1e30
# Isotherms closer than this (K) are the same temperature measured twice.
_REPEAT = 0.5


@dataclass(frozen=True, slots=True)
class SweepData:
    """Valid points of all sweeps and where they sit in the Dataset.

    ``points``: of the isotherms that hold any, numbered in the order of ``kept``; means of neighbouring readings where
    there are very many; ``readings``: all readings; ``temperature`` (isotherm,) [degC]: of the isotherms in use;
    ``kept`` (isotherm,): index of every isotherm in use along the Dataset's ``temperature``; ``row``, ``column``
    (reading,): index of every reading along ``temperature`` and ``frequency``; ``warnings``: what the report has to
    say.
    """

    points: Points
    readings: Points
    temperature: Floats
    kept: NDArray[np.intp]
    row: NDArray[np.intp]
    column: NDArray[np.intp]
    warnings: tuple[str, ...]


def read_sweeps(sweeps: xr.Dataset, is_robust: bool = True) -> SweepData:
    """Check a Dataset of sweeps and flatten it into points.

    Parameters
    ----------
    sweeps : Dataset
        Variables ``storage`` and ``loss`` [Pa] over ``temperature`` [degC] and ``frequency``
        [Hz]; NaN where a sweep has no point. Any order, repeated temperatures allowed.
    is_robust : bool
        Whether readings far off their own sweep are left out.

    Raises
    ------
    InputError
        Variables or coordinates are missing or in another unit; a modulus is infinite or the
        storage modulus not positive; hardly any loss modulus is positive; too few points.
    """
    storage, loss, temperature, frequency = _arrays(sweeps)
    notes: list[str] = []
    present = np.isfinite(storage) & np.isfinite(loss)
    half = np.isfinite(storage) ^ np.isfinite(loss)
    if half.any():
        where = _where(half, temperature, frequency)
        notes.append(f"{half.sum()} points have only one of the two moduli and are left out, {where}")
    _refuse_impossible(storage, loss, temperature, frequency)
    lost = present & ~(loss > 0)
    if lost.sum() > _MAX_SHARE_OF_LOST_POINTS * present.sum():
        raise InputError(
            f"loss modulus zero or negative at {lost.sum()} of {present.sum()} points, "
            f"{_where(lost, temperature, frequency)}; expected positive values: check the sign "
            "convention of the phase, or treat the material as elastic"
        )
    if lost.any():
        where = _where(lost, temperature, frequency)
        notes.append(
            f"loss modulus zero or negative at {lost.sum()} points, {where}; left out (noise around a small loss)"
        )
    present &= ~lost
    if present.sum() < _LEAST_POINTS:
        raise InputError(f"only {present.sum()} points with both moduli; a spectrum needs {_LEAST_POINTS} at least")
    if is_robust:
        notes += _leave_out_outlying(present, storage, loss, temperature, frequency)
    kept = np.flatnonzero(present.any(axis=1))
    notes += [
        f"no valid point at {temperature[k]:g} °C; its shift is NaN" for k in np.flatnonzero(~present.any(axis=1))
    ]
    notes += _repeated(temperature[kept])
    row, column = np.nonzero(present)
    readings = _points(present, storage, loss, frequency)
    notes += _falling(readings, temperature[kept])
    for note in notes:
        warnings.warn(note, UserWarning, stacklevel=3)
    return SweepData(means_of(readings), readings, temperature[kept], kept, row, column, tuple(notes))


def without_readings(data: SweepData, far: Flags) -> SweepData:
    """Leave readings out that lie far off the master curve of all others, and say so."""
    points = data.points
    first = int(np.flatnonzero(far)[0])
    note = (
        f"{far.sum()} readings lie far off the master curve of all others, first at "
        f"{data.temperature[points.isotherm[first]]:g} °C, {points.omega[first] / (2.0 * np.pi):.4g} Hz; left out"
    )
    warnings.warn(note, UserWarning, stacklevel=3)
    kept = points.only(~far)
    if data.readings is not points:
        return replace(data, points=kept, warnings=(*data.warnings, note))
    row, column = data.row[~far], data.column[~far]
    return replace(data, points=kept, readings=kept, row=row, column=column, warnings=(*data.warnings, note))


def _points(present: Flags, storage: Floats, loss: Floats, frequency: Floats) -> Points:
    """Flatten the readings in use."""
    kept = np.flatnonzero(present.any(axis=1))
    row, column = np.nonzero(present)
    omega, isotherm = 2.0 * np.pi * frequency[column], np.searchsorted(kept, row)
    return Points(omega, isotherm, storage[row, column], loss[row, column], kept.size)


def _leave_out_outlying(
    present: Flags, storage: Floats, loss: Floats, temperature: Floats, frequency: Floats
) -> list[str]:
    """Drop readings far off their own sweep from those in use, and say so."""
    far = np.zeros_like(present)
    far[present] = outlying(_points(present, storage, loss, frequency))
    if not far.any():
        return []
    present &= ~far
    where = _where(far, temperature, frequency)
    return [f"{far.sum()} readings lie far off the other readings of their sweep, {where}; left out"]


def _arrays(sweeps: xr.Dataset) -> tuple[Floats, Floats, Floats, Floats]:
    """Return moduli as (temperature, frequency) arrays with both coordinates, units checked."""
    missing = [name for name in _UNITS if name not in sweeps.variables]
    if missing:
        raise InputError(
            f"sweeps lack {', '.join(missing)}; expected variables storage and loss (Pa) over the "
            "coordinates temperature (°C) and frequency (Hz)"
        )
    for name, unit in _UNITS.items():
        found = sweeps[name].attrs.get("units", unit)
        if found != unit:
            raise InputError(f'"{name}" is in "{found}", expected "{unit}"; convert it first')
    for name in ("storage", "loss"):
        if set(sweeps[name].dims) != {"temperature", "frequency"}:
            raise InputError(f'"{name}" has dimensions {tuple(sweeps[name].dims)}, expected (temperature, frequency)')
    order = ("temperature", "frequency")
    storage, loss = (np.asarray(sweeps[name].transpose(*order).values, dtype=float) for name in ("storage", "loss"))
    temperature, frequency = (np.asarray(sweeps[name].values, dtype=float) for name in order)
    if not (np.isfinite(temperature) & (temperature > -ZERO_CELSIUS)).all():
        raise InputError(f"temperature {temperature} °C: expected finite values above {-ZERO_CELSIUS} °C")
    if not (np.isfinite(frequency) & (frequency > 0)).all():
        raise InputError(f"frequency {frequency} Hz: expected positive, finite values")
    return storage, loss, temperature, frequency


def _refuse_impossible(storage: Floats, loss: Floats, temperature: Floats, frequency: Floats) -> None:
    bad = np.isinf(storage) | (storage <= 0)
    if bad.any():
        raise InputError(
            f"storage modulus zero, negative or infinite at {bad.sum()} points, {_where(bad, temperature, frequency)}; "
            "expected positive values: mark failed readings as NaN"
        )
    for name, values in (("storage", storage), ("loss", loss)):
        far = (np.abs(values) > _MOST) | ((values != 0) & (np.abs(values) < 1.0 / _MOST))
        if far.any():
            raise InputError(
                f"{name} modulus of {values[far][0]:.3g} Pa, {_where(far, temperature, frequency)}; no "
                "material has it: check the unit of its column, or mark failed readings as NaN"
            )


def _where(mask: Flags, temperature: Floats, frequency: Floats) -> str:
    row, column = (int(i[0]) for i in np.nonzero(mask))
    return f"first at {temperature[row]:g} °C, {frequency[column]:.4g} Hz"


def _repeated(temperature: Floats) -> list[str]:
    ordered = np.sort(temperature)
    close = np.flatnonzero(np.diff(ordered) < _REPEAT)
    return [
        f"temperature {ordered[k]:g} °C was measured more than once; every sweep keeps a shift of "
        "its own, their difference shows the repeatability"
        for k in close
    ]


def _falling(points: Points, temperature: Floats) -> list[str]:
    """Name the isotherms whose storage modulus falls with frequency beyond the scatter."""
    curves = []
    for k in range(points.count):
        mask = points.isotherm == k
        curves.append(np.log(points.storage[mask][np.argsort(points.omega[mask])]))
    scatters = [float(np.sqrt(np.mean(np.diff(y, 2) ** 2) / 6.0)) for y in curves if y.size > 2]
    scatter = float(np.median(scatters)) if scatters else 0.0
    notes = []
    for y, T in zip(curves, temperature, strict=True):
        fall, spread = _largest_fall(y, scatter)
        if fall > max(_FALL_SCATTERS * spread, _LEAST_FALL):
            notes.append(
                f"storage modulus falls with frequency by {100 * (1 - np.exp(-fall)):.1f} % at {T:g} °C; no linear "
                "viscoelastic material does that (resonance, slip, or a sample that was still changing)"
            )
    return notes


def _largest_fall(y: Floats, scatter: float) -> tuple[float, float]:
    """Return the largest drop between means of neighbouring points, and its scatter."""
    window = max(y.size // 4, 1)
    means = np.convolve(y, np.full(window, 1.0 / window), mode="valid")
    fall = float(np.max(np.maximum.accumulate(means) - means))
    return fall, scatter * float(np.sqrt(2.0 / window))
