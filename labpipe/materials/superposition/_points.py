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
from labpipe.units import ZERO_CELSIUS

# A reading is left out when it is off the parabola through its neighbours by this (of ln E), and by this many times the
# median of others.
_FAR, _SCATTERS = 0.3, 8.0
# Readings from which a sweep can show which of them is wrong, the share of it that may be left out, and
# neighbours on either side.
_LEAST_OF_SWEEP, _MOST_SHARE, _SIDE = 5, 0.25, 3


def outliers(points: Points) -> Flags:
    """Return the readings (point,) far off their own sweep, in storage or in loss."""
    found = np.zeros(points.omega.size, dtype=bool)
    rows = [np.flatnonzero(points.isotherm == k) for k in range(points.count)]
    rows = [row[np.argsort(points.omega[row], kind="stable")] for row in rows if row.size >= _LEAST_OF_SWEEP]
    for values in (points.storage, points.loss) if rows else ():
        off = [_off_neighbours(points.omega[row], values[row]) for row in rows]
        limit = max(_FAR, _SCATTERS * float(np.median(np.abs(np.concatenate(off)))))
        for row, distance in zip(rows, off, strict=True):
            kept, left = row, distance
            while np.max(np.abs(left)) > limit and row.size - kept.size < _MOST_SHARE * row.size:
                worst = int(np.argmax(np.abs(left)))
                found[kept[worst]] = True
                kept = np.delete(kept, worst)
                left = _off_neighbours(points.omega[kept], values[kept])
    return found


def _off_neighbours(omega: Floats, values: Floats) -> Floats:
    """Return the distance of ln E from the parabola through its neighbours, in units of that of one reading."""
    x, y = np.log(omega), np.log(values)
    count = x.size
    width = min(2 * _SIDE + 1, count)
    first = np.clip(np.arange(count) - _SIDE, 0, count - width)
    near = first[:, None] + np.arange(width)
    near = near[near != np.arange(count)[:, None]].reshape(count, width - 1)
    away = x[near] - x[:, None]
    reach = np.max(np.abs(away), axis=1)
    powers = (away / np.maximum(reach, np.finfo(float).tiny)[:, None])[..., None] ** np.arange(3)
    normal = powers.transpose(0, 2, 1) @ powers + 1e-9 * np.eye(3)  # defined for repeats of one frequency too
    # The value of the parabola at the reading itself, as weights of its neighbours.
    weights = (powers @ np.linalg.solve(normal, np.eye(3)[:, :1]))[..., 0]
    return np.asarray((y - np.sum(weights * y[near], axis=1)) / np.sqrt(1.0 + np.sum(weights**2, axis=1)))


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
    """Check a Dataset of sweeps and flatten it into points; :func:`.master_curve` says what it holds.

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
    if lost.sum() > _MAX_SHARE_OF_LOST_POINTS * present.sum():
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
        for k in np.flatnonzero(np.diff(ordered) < _REPEAT)
    ]
    points = _flat(present, storage, loss, frequency)
    notes += _falling(points, temperature[kept])
    for note in notes:
        warnings.warn(note, UserWarning, stacklevel=3)
    row, column = np.nonzero(present)
    return SweepData(points, temperature[kept], kept, row, column, tuple(notes))


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


def _falling(points: Points, temperature: Floats) -> list[str]:
    """Name the isotherms whose storage modulus falls with frequency beyond the scatter."""
    masks = [np.flatnonzero(points.isotherm == k) for k in range(points.count)]
    curves = [np.log(points.storage[mask][np.argsort(points.omega[mask])]) for mask in masks]
    scatters = [float(np.sqrt(np.mean(np.diff(y, 2) ** 2) / 6.0)) for y in curves if y.size > 2]
    scatter = float(np.median(scatters)) if scatters else 0.0
    notes = []
    for y, T in zip(curves, temperature, strict=True):
        # the largest drop between means of neighbouring points
        window = max(y.size // 4, 1)
        means = np.convolve(y, np.full(window, 1.0 / window), mode="valid")
        fall = float(np.max(np.maximum.accumulate(means) - means))
        if fall > max(_FALL_SCATTERS * scatter * np.sqrt(2.0 / window), _LEAST_FALL):
            notes.append(
                f"storage modulus falls with frequency by {100 * (1 - np.exp(-fall)):.1f} % at {T:g} °C; no linear "
                "viscoelastic material does that (resonance, slip, or a sample that was still changing)"
            )
    return notes
