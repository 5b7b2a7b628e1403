"""Blocks of a Mach-1 file: columns, declared values of the header, and the motion and stiffness in the readings."""

import json
import re
from dataclasses import dataclass
from datetime import datetime
from math import nan
from typing import Any

import numpy as np
import xarray as xr

from labpipe.arrays import Floats
from pipelines.experiments.shared import mach1_readings
from pipelines.experiments.shared.ramps_and_holds import RELAXATION

OSCILLATION, FIND_CONTACT = "Sinusoid", "Find Contact"
_CLEAR, _SHARE = 10.0, 0.2
"""Standard uncertainties, and share of the spread of the readings, by which a force must rise with the position."""


@dataclass(frozen=True, slots=True)
class Part:
    """One block: its columns, and the place of its header in the file.

    ``line`` is the line of ``<INFO>``, ``header_line`` that of the column names; ``outliers`` are the runs of
    readings that were left out and are bridged here, ``lateral`` Fx and Fy where the cell has them.
    """

    number: int
    function: str
    header: dict[str, Any]
    time: Floats
    position: Floats
    force: Floats
    segment: Floats
    line: int
    header_line: int
    outliers: tuple[dict[str, Any], ...] = ()
    lateral: tuple[Floats, ...] = ()

    def declared(self, name: str) -> tuple[float, float, int | None]:
        """Return a declared value [SI] with the uncertainty of its rounding, and its line."""
        for place, parameter in enumerate(self.header["parameters"]):
            value = parameter["value"]
            if parameter["key"].partition(",")[0] == name and value is not None:
                text = str(parameter["text"])
                written = abs(float(text.replace(",", "."))) if text.strip("-+0., ") else 0.0
                last = 10.0 ** -len(re.sub(r"^.*[.,]", "", text)) if re.search(r"[.,]", text) else 1.0
                factor = abs(value) / written if written else 0.0
                return float(value), last * factor / 12**0.5, self.line + len(self.header["info_lines"]) + 3 + place
        return nan, nan, None

    def row_line(self, index: int) -> int:
        """Return the line of a reading; a line divides each segment from the next."""
        return self.header_line + 1 + index + int(self.segment[index] - self.segment[0])

    def header_place(self, key: str) -> int:
        """Return the line of the header that begins with a key."""
        lines = self.header["info_lines"]
        return self.line + 1 + next((i for i, text in enumerate(lines) if text.startswith(key)), 0)

    def text(self, key: str) -> str:
        """Return a parameter as written; empty where there is none."""
        return next((str(p["text"]) for p in self.header["parameters"] if p["key"] == key), "")

    def moved(self, values: Floats) -> float:
        """Return the amplitude of a column, or its change by the first ramp or approach."""
        if self.function == OSCILLATION:
            low, high = np.nanquantile(values, [0.005, 0.995])
            return 0.5 * float(high - low)
        inside = values[self.segment == self.segment[0]]
        if self.function == FIND_CONTACT:
            return float(inside[np.nanargmax(np.abs(inside - inside[0]))] - inside[0])
        return float(np.nanmedian(inside[inside.size // 2 :]) - inside[0])

    @property
    def speed(self) -> float:
        """Speed of the middle of the first ramp [m/s]; NaN where fewer than three readings show it."""
        first = self.segment == self.segment[0]
        time, x, travel = self.time[first], self.position[first], self.moved(self.position)
        if travel == 0.0:
            return nan
        share = (x - x[0]) / travel
        inside = (share > 0.1) & (share < 0.9) & (np.arange(x.size) <= np.argmax(share > 0.99))
        return abs(float(np.polyfit(time[inside], x[inside], 1)[0])) if inside.sum() >= 3 else nan

    @property
    def frequency(self) -> tuple[float, float]:
        """Frequency by counting passages through the middle in one direction, and its uncertainty [Hz]."""
        x = self.position
        low, high = np.nanquantile(x, [0.01, 0.99])
        middle, band = 0.5 * (low + high), 0.15 * (high - low)
        side = np.where(x > middle + band, 1, np.where(x < middle - band, -1, 0))
        known = np.flatnonzero(side)
        rising = known[1:][np.diff(side[known]) > 0]
        if band <= 0.0 or rising.size < 2:
            return nan, nan
        lasted = float(self.time[rising[-1]] - self.time[rising[0]])
        value = (rising.size - 1) / lasted
        return value, value * float(np.median(np.diff(self.time))) / lasted

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
        noise = float(np.diff(f, 2).std()) / np.sqrt(6.0)
        u = noise * float(np.sqrt(1.0 / low.sum() + 1.0 / high.sum()))
        spread = float(np.ptp(np.quantile(f, [0.05, 0.95])))
        return rise / travel, u / travel, spread > 0.0 and abs(rise) > max(_CLEAR * u, _SHARE * spread)


def parts(readings: xr.Dataset) -> list[Part]:
    """Return the blocks of a file with their place in it."""
    found, line = [], 2  # after the title
    force, position = readings.get("force_z"), readings.get("position_z")
    block = readings["block"].values
    left_out = json.loads(readings.attrs.get("outliers", "[]"))
    for number, header in enumerate(json.loads(readings.attrs["blocks"])):
        where = block == number
        names = line + len(header["info_lines"]) + len(header["parameter_lines"]) + 4
        if header["has_data"] and where.any() and force is not None and position is not None:
            sign = float(header["compression_sign"]) or 1.0
            time, segment = readings["time"].values[where], readings["segment"].values[where]
            x, f = (mach1_readings.bridged(column.values[where], time) for column in (position, force))
            runs = tuple(run for run in left_out if run["block"] == number)
            lateral = tuple(readings[n].values[where] for n in ("force_x", "force_y") if n in readings)
            found.append(
                Part(number, header["function"], header, time, x, sign * f, segment, line, names, runs, lateral)
            )
        line = names - 1 + (header["rows"] + len(header["dividers"]) + 3 if header["has_data"] else 0)
    return found


def between(part: Part, after: Part) -> float:
    """Return the time from the beginning of a block to that of a later one [s]; NaN where a header says none."""
    began, next_began = (str(p.header.get("start") or "") for p in (part, after))
    if not (began and next_began):
        return nan
    return (datetime.fromisoformat(next_began) - datetime.fromisoformat(began)).total_seconds()
