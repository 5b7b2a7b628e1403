"""Settings in a Keyence header, checked against the options: cycle, units, counts, start, and the times of rows.

Nothing is guessed: a value that neither of them states is asked for, and a contradiction is refused.
"""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from instruments._clock import moment
from instruments.keyence._header import CLOCK, Header, is_length_or_volts
from labpipe.arrays import Floats
from labpipe.errors import UNSAID, InputError, SourceError
from labpipe.text import shorten
from labpipe.units import quantity, unit

_SHORTEST, _LONGEST = 1e-7, 86400.0  # s; the time between samples of any sensor of this family
_DAY = 86400.0


class Options(NamedTuple):
    """Settings that the caller gives: cycle, storage factor, units, delimiter and decimal sign."""

    cycle: str | float | None
    storage_factor: int | None
    units: tuple[str, ...] | None
    delimiter: str | None
    decimal: str | None


def _contradiction(path: Path, name: str, line: int | None, stated: object, given: object) -> SourceError:
    text = f"the file says {stated}, the option {name} says {given}"
    return SourceError(path, text, line=line, hint=f"Leave the option {name} out, or correct it.")


def stated_units(path: Path, header: Header, given: tuple[str, ...] | None) -> tuple[str, ...]:
    """Return the unit of every output; SourceError without one, an unknown one, or where file and caller differ."""
    line, cells, _ = header.entries.get("units", (None, (), ""))
    stated, asked = tuple(cell for cell in cells if cell) or header.unit_texts, given or ()
    units = stated or asked
    if len(units) != len(header.outputs):
        text = f"found {len(units)} units for {len(header.outputs)} outputs"
        text = text if units else "the file does not say the unit of its readings"
        hint = 'Give one for every output, in order: units=["mm"].'
        raise SourceError(path, text, line=line, hint=hint).because(UNSAID)
    for text in units:
        if not is_length_or_volts(text):
            message = f"found the unit {shorten(text)}, expected a length, volts or a derivative"
            hint = "Units of Keyence outputs are mm, um, cm, V, mm/s, m/s2, km/s2."
            raise SourceError(path, message, line=line, hint=hint)
    if stated and asked and [unit(a) for a in asked] != [unit(s) for s in stated]:
        raise _contradiction(path, "units", line, ", ".join(stated), ", ".join(asked))
    return units


def stated_cycle(path: Path, header: Header, given: str | float | None) -> float:
    """Return the sampling cycle in s; SourceError without one, without its unit, or where file and caller differ."""
    asked = None if given is None else _time(str(given) if isinstance(given, str) else f"{given} s")
    if given is not None and asked is None:
        raise InputError(f'cycle must be a time such as "50 us", found "{given}"')
    if "cycle" not in header.entries:
        if asked is None:
            message = "the file does not say its sampling cycle"
            raise SourceError(path, message, hint='Give it: cycle="50 us".').because(UNSAID)
        return asked
    line, cells, unit_text = header.entries["cycle"]
    text = f"{' '.join(cells)} {unit_text}".strip()
    stated = _time(text)
    if stated is None:
        message = f"found the sampling cycle {shorten(text)}, expected a time with its unit"
        raise SourceError(path, message, line=line, hint='The line should read for example "Sampling cycle,50us".')
    if asked is not None and abs(asked - stated) > 1e-9 * stated:
        raise _contradiction(path, "cycle", line, f"{stated:g} s", f"{asked:g} s")
    return stated


def _time(text: str) -> float | None:
    """Read a time, or a rate as its inverse; None when it is neither, or cannot be meant."""
    try:
        found = quantity(text.replace(",", "."))
    except InputError:
        return None
    if found.value <= 0 or found.si not in ("s", "Hz"):
        return None
    seconds = found.value if found.si == "s" else 1.0 / found.value
    return seconds if _SHORTEST <= seconds <= _LONGEST else None


def stated_storage(path: Path, header: Header, given: int | None, cycle: float, *, is_cycle_given: bool) -> int:
    """Return the samples per stored point; SourceError without them, or where file and caller differ."""
    if "storage" not in header.entries:
        if given is None and not is_cycle_given:
            hint = "Give the factor between samples and stored points: storage_factor=1."
            raise SourceError(path, "the file does not say whether every sample was stored", hint=hint).because(UNSAID)
        return given or 1
    line, cells, unit_text = header.entries["storage"]
    text = " ".join(cells).strip()
    match = re.fullmatch(r"(?:[x×*]|1/)?\s*([0-9]{1,9})\s*(?:times|回|倍)?", text, re.IGNORECASE)
    factor = float(match[1]) if match and not unit_text else (_time(f"{text} {unit_text}".strip()) or 0.0) / cycle
    if not 1 <= factor <= 1e9 or abs(factor - round(factor)) > 1e-6 * factor:
        message = f"found the storage cycle {shorten(text)}, expected a whole factor such as x1"
        raise SourceError(path, message, line=line, hint='The line should read for example "Storage cycle,x10".')
    if given is not None and given != round(factor):
        raise _contradiction(path, "storage_factor", line, round(factor), given)
    return round(factor)


def interval_of_times(path: Path, header: Header, texts: Sequence[str], given: Options) -> tuple[float, int]:
    """Return the sampling cycle in s and the storage factor of a file whose rows carry their times.

    Raises
    ------
    SourceError
        The times are uneven, have no unit, or contradict the cycle.
    """
    has_cycle = given.cycle is not None or "cycle" in header.entries
    first_line, unsaid = header.n_lines + 1, not header.time_unit and ":" not in texts[0]
    if unsaid and not has_cycle:
        hint = 'Name the column "Time [s]" (or ms, us), or give the time between rows: cycle="50 us".'
        raise SourceError(path, "the file does not say the unit of its times", line=header.n_lines, hint=hint)
    cycle = stated_cycle(path, header, given.cycle) if has_cycle else 0.0
    for each in ("s", "ms", "us") if unsaid else (header.time_unit,):
        time, resolution = _seconds(texts, each, path, first_line)
        interval = _even_interval(time, resolution, path, first_line)
        if not has_cycle:
            return interval, 1
        factor = max(round(interval / cycle), 1)
        if "storage" in header.entries or given.storage_factor is not None:
            factor = stated_storage(path, header, given.storage_factor, cycle, is_cycle_given=True)
        if abs(interval - cycle * factor) <= 2.0 * resolution / (len(texts) - 1) + 1e-6 * interval:
            return cycle, factor
    raise SourceError(
        path,
        f"the times are {interval:.6g} s apart, by the sampling cycle it is {cycle * factor:.6g} s",
        line=header.entries["cycle"][0] if "cycle" in header.entries else first_line,
        hint="Correct the cycle, or the unit of the times.",
    )


def _seconds(texts: Sequence[str], unit_text: str, path: Path, first_line: int) -> tuple[Floats, float]:
    """Return the times of all rows [s] from the first, over midnight too, and the last decimal written [s]."""
    factor = 1.0
    if unit_text:
        try:
            factor = unit(unit_text).factor if unit(unit_text).si == "s" else np.nan
        except InputError:
            factor = np.nan
        if not factor > 0:
            raise SourceError(path, f"found times in {shorten(unit_text)}, expected s, ms or us", line=first_line - 1)
    found, decimals = np.empty(len(texts)), 0
    for row, text in enumerate(texts):
        clock = CLOCK.fullmatch(text)
        last = (clock[3] if clock else text).replace(",", ".")
        try:
            value = float(last)
        except ValueError:
            value = np.nan
        if not np.isfinite(value):
            raise SourceError(path, f"found {shorten(text)}, expected a time", line=first_line + row)
        found[row] = int(clock[1]) * 3600 + int(clock[2]) * 60 + value if clock else value
        decimals = max(decimals, len(last.partition(".")[2]) if last[-1].isdigit() else 0)
    time = (found - found[0]) * factor
    if CLOCK.fullmatch(texts[0]):
        time += _DAY * np.cumsum(np.diff(time, prepend=0.0) < -_DAY / 2)
    return time, factor * 10.0**-decimals


def _even_interval(time: Floats, resolution: float, path: Path, first_line: int) -> float:
    """Return the interval of even times, each within its last decimal; SourceError if they are uneven."""
    n, steps = len(time), np.diff(time)
    interval = float(time[-1] / (n - 1))
    allowed = 1.001 * resolution + 1e-9 * abs(interval)
    if interval > 0 and np.max(np.abs(time - interval * np.arange(n))) <= allowed:
        return interval
    usual = float(np.median(steps))
    row = int(np.argmax(np.abs(steps - usual))) + 1
    raise SourceError(
        path,
        f"the times are uneven: a step of {steps[row - 1]:.6g} s, {usual:.6g} s elsewhere",
        line=first_line + row,
        hint="Rows are missing, repeated or moved: export the file again, without gaps.",
    )


def stated_count(path: Path, header: Header, meaning: str) -> int | None:
    """Return a whole number of the header (number of points, averaging), or None; SourceError for any other cell."""
    if meaning not in header.entries:
        return None
    line, cells, _ = header.entries[meaning]
    found = {cell for cell in cells if cell}
    if len(found) != 1 or not re.fullmatch(r"[0-9]{1,12}", next(iter(found))):
        raise SourceError(path, f"found {shorten(','.join(cells))}, expected one whole number", line=line)
    return int(found.pop())


def stated_start(header: Header) -> str:
    """Return the ISO start, or "" when there is no date of a form that is not ambiguous."""
    date, clock = (" ".join(header.entries.get(name, (0, (), ""))[1]).strip() for name in ("date", "clock"))
    found = moment(f"{date} {clock}".strip()) or moment(date)
    return found.isoformat() if found else ""
