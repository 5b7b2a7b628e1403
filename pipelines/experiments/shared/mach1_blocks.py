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
_CLEAR = 5.0  # rise of a force over its noise, if the cell lives


@dataclass(frozen=True, slots=True)
class Part:
    """One block: its columns, and where its header stands in the file.

    ``line`` is the line of ``<INFO>``, ``header_line`` that of the column names; ``outliers`` are the runs of
    readings that were left out and are bridged here.
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


def parts(readings: xr.Dataset) -> list[Part]:
    """Return the blocks of a file with their place in it."""
    found, line = [], 2  # after the title
    force = readings.get("force_z")
    position = readings.get("position_z")
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
            found.append(Part(number, header["function"], header, time, x, sign * f, segment, line, names, runs))
        line = names - 1 + (header["rows"] + len(header["dividers"]) + 3 if header["has_data"] else 0)
    return found


def between(part: Part, after: Part) -> float:
    """Return the time from the beginning of a block to that of a later one [s]; NaN where a header says none."""
    began, next_began = (str(p.header.get("start") or "") for p in (part, after))
    if not (began and next_began):
        return nan
    return (datetime.fromisoformat(next_began) - datetime.fromisoformat(began)).total_seconds()


def moved_by(part: Part, values: Floats) -> float:
    """Return by how much a column moves as the command of a block means it; NaN without one."""
    if part.function == OSCILLATION:
        low, high = np.nanquantile(values, [0.005, 0.995])
        return 0.5 * float(high - low)
    first = part.segment == part.segment[0]
    inside = values[first]
    return float(np.nanmedian(inside[inside.size // 2 :]) - inside[0])


def counted_frequency(part: Part) -> tuple[float, float]:
    """Return the frequency of a motion by counting its turns, and its uncertainty [Hz]."""
    x = part.position
    low, high = np.nanquantile(x, [0.01, 0.99])
    middle, band = 0.5 * (low + high), 0.15 * (high - low)
    side = np.where(x > middle + band, 1, np.where(x < middle - band, -1, 0))
    known = np.flatnonzero(side)
    turns = known[1:][np.diff(side[known]) != 0]
    if band <= 0.0 or turns.size < 3:
        return nan, nan
    # one way through the middle only, so that an offset of the level does not count
    rising = turns[side[turns] == side[turns[0]]]
    if rising.size < 2:
        return nan, nan
    lasted = float(part.time[rising[-1]] - part.time[rising[0]])
    interval = float(np.median(np.diff(part.time)))
    value = (rising.size - 1) / lasted
    return value, value * interval / lasted


def travel_and_speed(part: Part) -> tuple[float, float, float]:
    """Return travel, speed and duration of the rest of a ramp or an approach [m, m/s, s]."""
    first = part.segment == part.segment[0]
    time, x = part.time[first], part.position[first]
    travel = float(np.nanmedian(x[x.size // 2 :]) - x[0]) if part.function == RELAXATION else float(x[-1] - x[0])
    if part.function == FIND_CONTACT and x.size:
        far = int(np.nanargmax(np.abs(x - x[0])))
        travel = float(x[far] - x[0])
    if travel == 0.0 or x.size < 4:
        return travel, nan, nan
    share = (x - x[0]) / travel
    arrived = int(np.argmax(share > 0.99))
    inside = (share > 0.1) & (share < 0.9) & (np.arange(x.size) <= arrived)
    # the readings on either side of the middle make a rate of two of them too
    speed = float(np.polyfit(time[inside], x[inside], 1)[0]) if inside.sum() >= 3 else nan
    return travel, speed, float(time[-1] - time[arrived])


def response_of(part: Part) -> tuple[float, float, float]:
    """Return stiffness [N/m] of a block, its uncertainty, and the share of force explained."""
    used = np.isfinite(part.position) & np.isfinite(part.force)
    if part.function != OSCILLATION:
        used &= part.segment == part.segment[0]
    x, f, t = part.position[used], part.force[used], part.time[used]
    if x.size < 10 or np.ptp(x) == 0.0:
        return nan, nan, nan
    if part.function == RELAXATION:
        step = x - x[0]
        held = np.abs(step) > 0.9 * np.abs(step).max()
        arrived = int(np.argmax(held))
        soon = f[arrived : arrived + max(10, min(50, f.size // 10))]
        late = f[-max(f.size // 10, 10) :]
        noise = float((late - np.polyval(np.polyfit(np.arange(late.size), late, 1), np.arange(late.size))).std())
        before = f[:1]
        rise = float(soon[np.argmax(np.abs(soon - before[0]))] - before[0])
        travel = float(step[arrived])
        share = 1.0 if abs(rise) > 2 * _CLEAR * noise and rise != 0.0 else 0.0
        return rise / travel, 1.5 * noise / abs(travel), share
    rate = np.gradient(x, t)
    base = np.column_stack([np.ones_like(t), t - t.mean(), x - x.mean(), rate])
    scale = np.maximum(np.abs(base).max(axis=0), 1e-300)
    answer, *_ = np.linalg.lstsq(base / scale, f, rcond=None)
    drift = f - (base[:, :2] / scale[:2]) @ answer[:2]
    rest = drift - (base[:, 2:] / scale[2:]) @ answer[2:]
    variance = float(np.var(drift))
    share = 1.0 - float(np.var(rest)) / variance if variance > 0.0 else 0.0
    u = float(rest.std()) / (float(x.std()) * np.sqrt(x.size / 10))
    return float(answer[2] / scale[2]), u, share
