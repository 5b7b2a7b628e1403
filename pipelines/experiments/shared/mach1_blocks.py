"""Blocks of a Mach-1 file: columns, declared values of the header, and the motion and stiffness in the readings."""

import json
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from math import nan
from typing import Any

import numpy as np
import xarray as xr

from labpipe.arrays import Floats
from labpipe.errors import InputError
from labpipe.judging import IMPOSSIBLE
from labpipe.signals import active_window, fit_sinusoid
from pipelines.experiments.shared.mach1_readings import bridged, hold_of, ramp_speed

OSCILLATION, RELAXATION, FIND_CONTACT = "Sinusoid", "Stress Relaxation", "Find Contact"
_TREND = 3  # degree of the relaxation of an oscillating force
_SHARE = 0.2  # of the spread of the readings, by which a force must rise with the position


@dataclass(frozen=True, slots=True)
class Part:
    """One block: its columns [s, m, N], and the lines of its ``<INFO>`` and of its column names.

    ``outliers`` are the runs of readings that were left out and are bridged here, ``lateral`` Fx and Fy where the cell
    has them.
    """

    file: str
    number: int
    header: dict[str, Any]
    time: Floats
    position: Floats
    force: Floats
    segment: Floats
    line: int
    header_line: int
    outliers: tuple[dict[str, Any], ...] = ()
    lateral: tuple[Floats, ...] = ()

    def __str__(self) -> str:
        return f"{self.file}, block {self.number + 1}"

    @property
    def function(self) -> str:
        """Name of the tester's function."""
        return str(self.header["function"])

    @property
    def place(self) -> dict[str, Any]:
        """File and line of a check of this block."""
        return {"file": self.file, "line": self.header_line}

    def declared(self, name: str) -> tuple[float, int | None]:
        """Return a declared value other than 0 [SI], and its line."""
        for place, parameter in enumerate(self.header["parameters"]):
            if parameter["key"].partition(",")[0] == name and parameter["value"]:
                return float(parameter["value"]), self.line + len(self.header["info_lines"]) + 3 + place
        return nan, None

    @property
    def direction(self) -> float:
        """Declared direction of the motion, +1 or −1; NaN where none is declared."""
        if self.function == RELAXATION:
            return float(np.sign(self.declared("Amplitude")[0]))
        said = next((str(p["text"]) for p in self.header["parameters"] if p["key"] == "Direction"), "")
        return 1.0 if said.startswith("Pos") else -1.0 if said else nan

    def row_line(self, index: int) -> int:
        """Return the line of a reading; a line divides each segment from the next."""
        return self.header_line + 1 + index + int(self.segment[index] - self.segment[0])

    def settling(self) -> Iterator[tuple[int, Floats, int]]:
        """Yield the force of every hold, and that of an oscillation without its waves: both change smoothly.

        Each has the index of its first reading, and the number of those in which the stage was still on its way.
        """
        if self.function == OSCILLATION:
            with suppress(InputError):
                window = active_window(self.time, self.position)
                cycle = 1.0 / window.frequency  # the first and the last are transients
                inside = (self.time > window.start + cycle) & (self.time < window.end - cycle)
                time, force = self.time[inside], self.force[inside]
                fit = fit_sinusoid(time, force, window.frequency, trend_order=_TREND)
                yield int(np.argmax(inside)), force - fit.at(time), 0
        for number in np.unique(self.segment) if self.function == RELAXATION else ():
            rows = np.flatnonzero(self.segment == number)
            held, near = hold_of(self.position[rows])
            yield int(rows[0]), self.force[rows], int(np.argmax(np.abs(self.position[rows] - held) <= near))

    def moved(self, values: Floats) -> float:
        """Return the amplitude of a column, or its change by the first ramp or approach."""
        if self.function == OSCILLATION:
            return 0.5 * float(np.ptp(np.nanquantile(values, [0.005, 0.995])))
        inside = values[self.segment == self.segment[0]]
        if self.function == RELAXATION:
            return float(np.nanmedian(inside[inside.size // 2 :]) - inside[0])
        return float(inside[np.nanargmax(np.abs(inside - inside[0]))] - inside[0])

    @property
    def speed(self) -> float:
        """Speed of the middle of the first ramp [m/s]; NaN where fewer than three readings show it."""
        first, travel = self.segment == self.segment[0], self.moved(self.position)
        arrived = int(np.argmax((self.position[first] - self.position[0]) * np.sign(travel) > 0.95 * abs(travel))) + 1
        return abs(ramp_speed(self.time[:arrived], self.position[:arrived]))

    @property
    def frequency(self) -> tuple[float, float]:
        """Frequency of the motion and its uncertainty [Hz], a reading in its length; NaN without one."""
        try:
            start, end, value = active_window(self.time, self.position)
        except InputError:
            return nan, nan
        return value, value * float(np.median(np.diff(self.time))) / (end - start)

    @property
    def stiffness(self) -> tuple[float, float, bool]:
        """Stiffness between the lowest and the highest tenth of the travel, its u [N/m], and whether force follows."""
        used = np.isfinite(self.position) & np.isfinite(self.force)
        if self.function == RELAXATION:
            used &= self.segment == self.segment[0]
        x, f = self.position[used], self.force[used]
        if x.size < 10 or np.ptp(x) == 0.0:
            return nan, nan, False
        low, high = (np.abs(x - end) < 0.1 * np.ptp(x) for end in (x.min(), x.max()))
        rise, travel = float(f[high].mean() - f[low].mean()), float(x[high].mean() - x[low].mean())
        u = float(np.diff(f, 2).std()) / 6.0**0.5 * float(1.0 / low.sum() + 1.0 / high.sum()) ** 0.5
        spread = float(np.ptp(np.quantile(f, [0.05, 0.95])))
        return rise / travel, u / travel, spread > 0.0 and abs(rise) > max(IMPOSSIBLE * u, _SHARE * spread)


def parts(name: str, readings: xr.Dataset) -> list[Part]:
    """Return the blocks of a file with their place in it."""
    found, line = [], 2  # after the title
    block, time, segment = (readings[column].values for column in ("block", "time", "segment"))
    columns = [readings[column].values for column in ("position_z", "force_z") if column in readings]
    left_out = json.loads(readings.attrs.get("outliers", "[]"))
    for number, header in enumerate(json.loads(readings.attrs["blocks"])):
        where = block == number
        names = line + len(header["info_lines"]) + len(header["parameter_lines"]) + 4
        if header["has_data"] and where.any() and len(columns) == 2:
            x, f = (bridged(column[where], time[where]) for column in columns)
            f = f * (float(header["compression_sign"]) or 1.0)
            runs = tuple(run for run in left_out if run["block"] == number)
            lateral = tuple(readings[n].values[where] for n in ("force_x", "force_y") if n in readings)
            found.append(Part(name, number, header, time[where], x, f, segment[where], line, names, runs, lateral))
        line = names - 1 + (header["rows"] + len(header["dividers"]) + 3 if header["has_data"] else 0)
    return found
