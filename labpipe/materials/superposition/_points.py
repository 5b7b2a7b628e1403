"""Checks of isothermal frequency sweeps before shifting.

Everything that would spoil a master curve is refused or named here, with the temperature and the
frequency where it was found. Single readings far off their own sweep are left out.
"""

import warnings
from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from labpipe.arrays import Flags, Floats
from labpipe.errors import InputError
from labpipe.materials.superposition._joint_fit import Points
from labpipe.materials.superposition._noise import LEAST_OF_SWEEP, off_its_sweep
from labpipe.materials.superposition._parameters import LEAST_SPACING
from labpipe.units import ZERO_CELSIUS

# A reading is left out when it is off the cubic through its sweep by this (of ln E), and by this many times the median
# of others.
_FAR, _SCATTERS = 0.3, 8.0
# Share of readings that may be left out: of a sweep, for being off it, and of all, for a loss modulus at or below zero,
# which is noise about a small value; more is a sign convention or a material without loss.
_MOST_SHARE = 0.25
_UNITS = {"storage": "Pa", "loss": "Pa", "frequency": "Hz", "temperature": "degC"}
# Fewer points than this over the whole set say nothing about a spectrum.
_LEAST_POINTS = 4
# Moduli beyond this (Pa) and below its inverse are of no material, in whatever unit.
_MOST = 1e30


@dataclass(frozen=True, slots=True)
class SweepData:
    """Valid points of all sweeps and their places in the Dataset.

    ``points``: of the isotherms that hold any, numbered in the order of ``kept``; ``temperature`` (isotherm,) [degC]:
    of the isotherms in use; ``kept`` (isotherm,): index of every isotherm in use along the Dataset's ``temperature``;
    ``row``, ``column`` (point,): index of every point along ``temperature`` and ``frequency``; ``warnings``:
    sentences for the report.
    """

    points: Points
    temperature: Floats
    kept: NDArray[np.intp]
    row: NDArray[np.intp]
    column: NDArray[np.intp]
    warnings: tuple[str, ...]


def read_sweeps(sweeps: xr.Dataset) -> SweepData:
    """Check a Dataset of sweeps and flatten it into points; :func:`.master_curve` describes its contents.

    Raises
    ------
    InputError
        Variables or coordinates are missing or in another unit; a modulus is infinite or the
        storage modulus not positive; hardly any loss modulus is positive; too few points.
    """
    storage, loss, temperature, frequency = _arrays(sweeps)

    def where(mask: Flags) -> str:
        row, column = (int(i[0]) for i in np.nonzero(mask))
        return f"first at {temperature[row]:g} °C, {frequency[column]:.4g} Hz"

    if (bad := np.isinf(storage) | (storage <= 0)).any():
        text = (
            f"storage modulus zero, negative or infinite at {bad.sum()} points, {where(bad)}; expected positive values"
        )
        raise InputError(f"{text}: mark failed readings as NaN")
    for name, values in (("storage", storage), ("loss", loss)):
        far = (np.abs(values) > _MOST) | ((values != 0) & (np.abs(values) < 1.0 / _MOST))
        if far.any():
            raise InputError(
                f"{name} modulus of {values[far][0]:.3g} Pa, {where(far)}; no "
                "material has it: check the unit of its column, or mark failed readings as NaN"
            )
    notes: list[str] = []
    present, half = np.isfinite(storage) & np.isfinite(loss), np.isfinite(storage) ^ np.isfinite(loss)
    if half.any():
        notes.append(f"{half.sum()} points have only one of the two moduli and are left out, {where(half)}")
    lost = present & ~(loss > 0)
    if lost.sum() > _MOST_SHARE * present.sum():
        raise InputError(
            f"loss modulus zero or negative at {lost.sum()} of {present.sum()} points, "
            f"{where(lost)}; expected positive values: check the sign "
            "convention of the phase, or treat the material as elastic"
        )
    if lost.any():
        notes.append(
            f"loss modulus zero or negative at {lost.sum()} points, {where(lost)}; left out (noise around a small loss)"
        )
    present &= ~lost
    if present.sum() < _LEAST_POINTS:
        raise InputError(f"only {present.sum()} points with both moduli; a spectrum needs {_LEAST_POINTS} at least")
    far = np.zeros_like(present)
    far[present] = outliers(_flat(present, storage, loss, frequency))
    if far.any():
        present &= ~far
        notes.append(f"{far.sum()} readings lie far off the other readings of their sweep, {where(far)}; left out")
    used = present.any(axis=1)
    notes += [f"no valid point at {temperature[k]:g} °C; its shift is NaN" for k in np.flatnonzero(~used)]
    kept = np.flatnonzero(used)
    ordered = np.sort(temperature[kept])
    notes += [
        f"temperature {ordered[k]:g} °C was measured more than once; every sweep keeps a shift of "
        "its own, their difference shows the repeatability"
        for k in np.flatnonzero(np.diff(ordered) < LEAST_SPACING)
    ]
    for note in notes:
        warnings.warn(note, UserWarning, stacklevel=3)
    row, column = np.nonzero(present)
    return SweepData(_flat(present, storage, loss, frequency), temperature[kept], kept, row, column, tuple(notes))


def outliers(points: Points) -> Flags:
    """Return the readings (point,) far off their own sweep, in storage or in loss."""
    found = np.zeros(points.omega.size, dtype=bool)
    rows = [np.flatnonzero(points.isotherm == k) for k in range(points.count)]
    rows = [row for row in rows if row.size >= LEAST_OF_SWEEP]
    for values in (points.storage, points.loss) if rows else ():
        off = [off_its_sweep(points.omega[row], values[row]) for row in rows]
        limit = max(_FAR, _SCATTERS * float(np.median(np.abs(np.concatenate(off)))))
        for row, distance in zip(rows, off, strict=True):
            kept, left = row, distance
            while np.max(np.abs(left)) > limit and row.size - kept.size < _MOST_SHARE * row.size:
                worst = int(np.argmax(np.abs(left)))
                found[kept[worst]] = True
                kept = np.delete(kept, worst)
                left = off_its_sweep(points.omega[kept], values[kept])
    return found


def _flat(present: Flags, storage: Floats, loss: Floats, frequency: Floats) -> Points:
    """Flatten the readings in use."""
    kept = np.flatnonzero(present.any(axis=1))
    row, column = np.nonzero(present)
    omega, isotherm = 2.0 * np.pi * frequency[column], np.searchsorted(kept, row)
    return Points(omega, isotherm, storage[row, column], loss[row, column], kept.size)


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
