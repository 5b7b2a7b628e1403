"""Exports of a rheometer with their trusted rows, and the isothermal sweeps in them."""

from collections.abc import Sequence
from math import log
from typing import NamedTuple

import numpy as np
import xarray as xr

from labpipe.arrays import Floats
from labpipe.judging import Check, Level, stated
from labpipe.materials import isothermal_runs, trusted_rows
from pipelines.experiments.dma.settings import Dma


class Export(NamedTuple):
    """One export: its trusted rows, and the isothermal sweeps that have enough of them.

    Sweeps are in ascending order of frequency, with the attributes ``file``, ``temperature`` (the mean, degC) and
    ``place``: file, temperature, and interval there.
    """

    name: str
    data: xr.Dataset
    sweeps: list[xr.Dataset]
    settings: Dma

    @classmethod
    def of(cls, name: str, data: xr.Dataset, settings: Dma) -> "Export":
        """Take the readings of a file."""
        good, options, sweeps = np.concatenate([[], *trusted_rows(data)]).astype(int), settings.sweeps, []
        for run in isothermal_runs(data, options.tolerance, options.fewest):
            one = data.isel(sample=np.intersect1d(run, good))
            if one.sizes["sample"] >= options.fewest:
                T = float(one["temperature"].mean())
                place = f"{name}, sweep at {T:.1f} °C"
                place += f", interval {int(one['interval'][0])}" if "interval" in one else ""
                one = one.isel(sample=np.argsort(one["frequency"].values, kind="stable"))
                sweeps.append(one.assign_attrs(file=name, temperature=T, place=place))
        return cls(name, data.isel(sample=np.sort(good)), sweeps, settings)

    def values(self, name: str) -> Floats:
        """Return one column."""
        return np.asarray(self.data[name].values, float)

    def seen(self, name: str, text: str, level: Level | None = None, cause: str = "") -> Check:
        """Return a check of this file."""
        return stated(name, text, level, cause=cause, file=self.name)


def common_levels(sweeps: Sequence[xr.Dataset]) -> Floats | None:
    """Return log10 of the storage moduli (sweep, frequency) at seven frequencies that all reach; None without any."""
    frequencies, moduli = ([s[name].values for s in sweeps] for name in ("frequency", "storage_modulus"))
    low, high = max((float(f[0]) for f in frequencies), default=0.0), min((f[-1] for f in frequencies), default=0.0)
    if not 0 < low < high or any((modulus <= 0).any() for modulus in moduli):
        return None
    x = np.linspace(log(low), log(high), 7)
    return np.array([np.interp(x, np.log(f), np.log10(m)) for f, m in zip(frequencies, moduli, strict=True)])
