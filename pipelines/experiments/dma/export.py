"""Exports of a rheometer with their trusted rows, and the isothermal sweeps in them."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import log, pi

import numpy as np
import xarray as xr

from labpipe.arrays import Floats
from labpipe.materials import isothermal_runs, trusted_tables
from pipelines.experiments.dma.settings import Dma


@dataclass(frozen=True, slots=True)
class Export:
    """One export of a rheometer, with its trusted rows."""

    name: str
    data: xr.Dataset
    good: np.ndarray

    @classmethod
    def of(cls, name: str, data: xr.Dataset) -> "Export":
        """Return an export with the rows that the instrument trusts."""
        good = np.zeros(data.sizes["sample"], bool)
        for table in trusted_tables(data):
            good[table.rows] = True
        return cls(name, data, good)

    def values(self, name: str) -> Floats:
        """Return one column at trusted rows."""
        return np.asarray(self.data[name].values[self.good], float)

    def place(self, row: int, *names: str) -> str:
        """Return the file, interval and point of a row of the table."""
        parts = [f"{n} {int(self.data[n].values[row])}" for n in names or ("interval", "point") if n in self.data]
        return f"{self.name}, {', '.join(parts) if parts else f'row {row + 1}'}"

    def intervals(self) -> list[np.ndarray]:
        """Return the trusted rows of every interval; none without a column of intervals."""
        keys = [key for key in ("test", "result", "interval") if key in self.data.variables]
        if not keys:
            return []
        labels = np.stack([np.asarray(self.data[key].values) for key in keys], axis=1)[self.good]
        rows = np.flatnonzero(self.good)
        return [rows[(labels == label).all(axis=1)] for label in np.unique(labels, axis=0)]


@dataclass(frozen=True, slots=True)
class Sweep:
    """One isothermal sweep, in ascending order of frequency."""

    export: Export
    rows: np.ndarray
    temperature: float

    @property
    def place(self) -> str:
        """Return its file, temperature, and interval there."""
        text = f"{self.export.name}, sweep at {self.temperature:.1f} °C"
        if "interval" not in self.export.data:
            return text
        return f"{text}, interval {int(self.export.data['interval'].values[self.rows[0]])}"

    def values(self, name: str) -> Floats:
        """Return one of its columns."""
        return np.asarray(self.export.data.variables[name].values[self.rows], float)

    @property
    def is_positive(self) -> bool:
        """Whether all its storage moduli have a logarithm."""
        return bool((self.values("storage_modulus") > 0).all())

    def level(self, x: Floats) -> Floats:
        """Return log10 of the storage modulus at logarithms of frequencies."""
        return np.asarray(np.interp(x, np.log(self.values("frequency")), np.log10(self.values("storage_modulus"))))


def isotherms(export: Export, settings: Dma) -> Iterator[Sweep]:
    """Yield the isothermal sweeps of an export that have enough trusted rows."""
    options = settings.sweeps
    for run in isothermal_runs(export.data, options.tolerance, options.fewest):
        rows = run.rows[export.good[run.rows]]
        if rows.size >= options.fewest:
            rows = rows[np.argsort(export.data["frequency"].values[rows], kind="stable")]
            yield Sweep(export, rows, float(export.data["temperature"].values[rows].mean()))


def common_frequencies(sweeps: Sequence[Sweep]) -> Floats | None:
    """Return logarithms of seven frequencies that all sweeps reach; None where there are none."""
    low = max(float(s.values("frequency")[0]) for s in sweeps)
    high = min(float(s.values("frequency")[-1]) for s in sweeps)
    if not 0 < low < high or not all(s.is_positive for s in sweeps):
        return None
    return np.linspace(log(low), log(high), 7)


def median_levels(sweeps: Sequence[Sweep]) -> Floats | None:
    """Return the median log10 of every isotherm's modulus over the frequencies that all have."""
    x = common_frequencies(sweeps) if len(sweeps) > 2 else None
    return None if x is None else np.array([float(np.median(s.level(x))) for s in sweeps])


def moduli_apart(a: Sweep, b: Sweep) -> tuple[float, float] | None:
    """Return the median log10 ratio of the storage moduli of two sweeps over common frequencies, and its u."""
    x = common_frequencies((a, b))
    if x is None:
        return None
    gap = a.level(x) - b.level(x)
    # median of noise: pi/2 of the mean's variance; the gap may turn steadily with frequency
    rest = gap - np.polynomial.Polynomial.fit(x, gap, 1)(x)
    return float(np.median(gap)), float(np.sqrt(0.5 * pi * np.mean(rest**2) / (x.size - 2)))
