"""Exports and isothermal sweeps as their checks look at them: trusted rows, places in the file, common frequencies."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import log, log10, pi

import numpy as np
import xarray as xr

from labpipe.arrays import Floats
from labpipe.judging import in_words
from labpipe.materials import isothermal_runs, trusted_tables
from pipelines.experiments.dma.settings import Dma

POLYMERS = (3e4, 5e10)
"""Pa in tension: the stiffest reading of a polymer, from a gel to a fibre composite."""
SAME_PLACE = 2.0  # K, ln(frequency) 0.05: readings of one condition
OWN = 0.005  # decades of modulus that drift, drying and clamping add to noise
_TRANSITION = 0.1  # decades of modulus per kelvin of the steepest glass transition
FEW_ROWS, MOST = 4, 0.6  # readings, and share of them at one temperature, that make an isothermal interval


@dataclass(frozen=True, slots=True)
class Export:
    """One export of a rheometer, with its trusted rows."""

    name: str
    data: xr.Dataset
    good: np.ndarray

    def values(self, name: str) -> Floats:
        """Return one column at trusted rows."""
        return np.asarray(self.data[name].values[self.good], float)

    def place(self, row: int) -> str:
        """Say where a row of the table stands."""
        parts = [
            f"{word} {int(self.data[key].values[row])}"
            for key, word in (("interval", "interval"), ("point", "point"))
            if key in self.data.variables
        ]
        return f"{self.name}, {', '.join(parts) if parts else f'row {row + 1}'}"


@dataclass(frozen=True, slots=True)
class Sweep:
    """One isothermal sweep, in ascending order of frequency."""

    export: Export
    rows: np.ndarray
    temperature: float

    @property
    def place(self) -> str:
        """Return its file, temperature, and interval there."""
        interval = self.export.place(int(self.rows[0])).rpartition(", point")[0].removeprefix(self.export.name)
        return f"{self.export.name}, sweep at {self.temperature:.1f} °C{interval}"

    def values(self, name: str) -> Floats:
        """Return one of its columns."""
        return np.asarray(self.export.data.variables[name].values[self.rows], float)


def trusted_rows(data: xr.Dataset) -> np.ndarray:
    good = np.zeros(data.sizes["sample"], bool)
    for table in trusted_tables(data):
        good[table.rows] = True
    return good


def isothermal_sweeps(export: Export, settings: Dma) -> Iterator[Sweep]:
    options = settings.sweeps
    for run in isothermal_runs(export.data, options.tolerance, options.fewest):
        rows = run.rows[export.good[run.rows]]
        if rows.size >= options.fewest:
            rows = rows[np.argsort(export.data["frequency"].values[rows], kind="stable")]
            yield Sweep(export, rows, float(export.data["temperature"].values[rows].mean()))


def factor_in_words(ratio: float, decades: float = 0.05) -> str:
    """Write a factor, as a power of ten where it is that within some decades."""
    power = log10(ratio)
    is_power = abs(power) > 0.5 and abs(power - round(power)) < decades
    return in_words(10.0 ** round(power) if is_power else ratio)


def rows_of_intervals(export: Export) -> list[np.ndarray]:
    """Return the trusted rows of every interval; none where no column tells intervals."""
    keys = [key for key in ("test", "result", "interval") if key in export.data.variables]
    if not keys:
        return []
    labels = np.stack([np.asarray(export.data[key].values) for key in keys], axis=1)[export.good]
    rows = np.flatnonzero(export.good)
    return [rows[(labels == label).all(axis=1)] for label in np.unique(labels, axis=0)]


def median_levels(isotherms: Sequence[Sweep]) -> Floats | None:
    """Return the median log10 of every isotherm's modulus over the frequencies that all have."""
    if len(isotherms) < 3:
        return None
    low = max(float(s.values("frequency")[0]) for s in isotherms)
    high = min(float(s.values("frequency")[-1]) for s in isotherms)
    if not 0 < low < high:
        return None
    x = np.linspace(log(low), log(high), 7)
    found = []
    for s in isotherms:
        storage = s.values("storage_modulus")
        if not (storage > 0).all():
            return None
        found.append(float(np.median(np.interp(x, np.log(s.values("frequency")), np.log10(storage)))))
    return np.array(found)


def steepest_slope(isotherms: Sequence[Sweep]) -> float:
    """Return the steepest change of the modulus over temperature [decades/K], at most that of a glass transition."""
    levels = median_levels(isotherms)
    if levels is None:
        return _TRANSITION
    T = np.array([s.temperature for s in isotherms])
    far = np.diff(T) > SAME_PLACE
    steps = np.abs(np.diff(levels)[far] / np.diff(T)[far])
    return min(float(steps.max()), _TRANSITION) if steps.size else _TRANSITION


def moduli_apart(a: Sweep, b: Sweep) -> tuple[float, float] | None:
    """Return the median log10 ratio of the storage moduli of two sweeps over common frequencies, and its u."""
    fa, fb = a.values("frequency"), b.values("frequency")
    low, high = max(fa[0], fb[0]), min(fa[-1], fb[-1])
    ya, yb = a.values("storage_modulus"), b.values("storage_modulus")
    if not low < high or not ((ya > 0).all() and (yb > 0).all()):
        return None
    x = np.linspace(log(low), log(high), 7)
    gap = np.interp(x, np.log(fa), np.log10(ya)) - np.interp(x, np.log(fb), np.log10(yb))
    # median of noise: pi/2 of the mean's variance; the gap may turn steadily with frequency
    rest = gap - np.polynomial.Polynomial.fit(x, gap, 1)(x)
    return float(np.median(gap)), float(np.sqrt(0.5 * pi * np.mean(rest**2) / (x.size - 2)))
