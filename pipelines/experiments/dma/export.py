"""Exports of a rheometer with their trusted rows, and the isothermal sweeps in them."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import log

import numpy as np
import xarray as xr

from labpipe.arrays import Floats
from labpipe.judging import Check, Level, stated
from labpipe.materials import isothermal_runs, trusted_rows
from pipelines.experiments.dma.settings import Dma


@dataclass(frozen=True)
class Export:
    """One export of a rheometer."""

    name: str
    data: xr.Dataset
    settings: Dma

    @cached_property
    def good(self) -> np.ndarray:
        """Whether the instrument trusts a row."""
        good = np.zeros(self.data.sizes["sample"], bool)
        for rows in trusted_rows(self.data):
            good[rows] = True
        return good

    @cached_property
    def sweeps(self) -> "list[Sweep]":
        """Isothermal sweeps that have enough trusted rows, each in ascending order of frequency."""
        options, found = self.settings.sweeps, []
        for run in isothermal_runs(self.data, options.tolerance, options.fewest):
            rows = run[self.good[run]]
            if rows.size >= options.fewest:
                rows = rows[np.argsort(self.data["frequency"].values[rows], kind="stable")]
                found.append(Sweep(self, rows, float(self.data["temperature"].values[rows].mean())))
        return found

    def values(self, name: str) -> Floats:
        """Return one column at trusted rows."""
        return np.asarray(self.data[name].values[self.good], float)

    def place(self, row: int) -> str:
        """Return the file, interval and point of a row of the table."""
        parts = [f"{n} {int(self.data[n].values[row])}" for n in ("interval", "point") if n in self.data]
        return f"{self.name}, {', '.join(parts) if parts else f'row {row + 1}'}"

    def seen(self, name: str, text: str, level: Level | None = None, cause: str = "") -> Check:
        """Return a check of this file."""
        return stated(name, text, level, cause=cause, file=self.name)


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

    def periods(self) -> Floats:
        """Return how many periods its readings took, in the order of time; empty without times."""
        if "time" not in self.export.data:
            return np.empty(0)
        rows = np.sort(self.rows)
        lasts = np.diff(self.export.data["time"].values[rows]) * self.export.data["frequency"].values[rows[1:]]
        return np.asarray(lasts[np.isfinite(lasts) & (lasts > 0.0)])

    def values(self, name: str) -> Floats:
        """Return one of its columns."""
        return np.asarray(self.export.data.variables[name].values[self.rows], float)


def common_levels(sweeps: Sequence[Sweep]) -> Floats | None:
    """Return log10 of the storage moduli (sweep, frequency) at seven frequencies that all reach; None without any."""
    frequencies, moduli = ([s.values(name) for s in sweeps] for name in ("frequency", "storage_modulus"))
    low, high = max((float(f[0]) for f in frequencies), default=0.0), min((f[-1] for f in frequencies), default=0.0)
    if not 0 < low < high or any((modulus <= 0).any() for modulus in moduli):
        return None
    x = np.linspace(log(low), log(high), 7)
    return np.array([np.interp(x, np.log(f), np.log10(m)) for f, m in zip(frequencies, moduli, strict=True)])
