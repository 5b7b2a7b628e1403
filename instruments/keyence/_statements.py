"""Settings in a Keyence header, checked against the options: cycle, units, counts, start.

Nothing is guessed: what neither of them says is asked for, and a contradiction is refused.
"""

import re
from collections.abc import Iterable, Sequence
from pathlib import Path

from instruments._clock import moment
from instruments.keyence._columns import even_interval, seconds
from instruments.keyence._header import Header, KeyenceProfile, is_length_or_volts
from labpipe.errors import UNSAID, InputError, SourceError
from labpipe.text import shorten
from labpipe.units import quantity, unit


def stated_units(path: Path, header: Header, given: Iterable[str] | None) -> tuple[str, ...]:
    """Return the unit of every output, from the file or from the caller.

    Raises
    ------
    SourceError
        There are none, they are not known, their number is not that of the outputs, or the
        caller contradicts the file.
    """
    line, cells, _ = header.entries.get("units", (None, (), ""))
    stated = tuple(cell for cell in cells if cell) or header.unit_texts
    asked = tuple(given) if given is not None else ()
    units = stated or asked
    if not units:
        raise SourceError(
            path,
            "the file does not say the unit of its readings",
            hint='Give one for every output, in order: units=["mm"].',
        ).because(UNSAID)
    if len(units) != len(header.outputs):
        text = f"found {len(units)} units for {len(header.outputs)} outputs"
        hint = 'Give one for every output, in order: units=["mm", "um"].'
        raise SourceError(path, text, line=line, hint=hint).because(UNSAID)
    for text in units:
        if not is_length_or_volts(text):
            message = f"found the unit {shorten(text)}, expected a length, volts or a derivative"
            hint = "Units of Keyence outputs are mm, um, cm, V, mm/s, m/s2, km/s2."
            raise SourceError(path, message, line=line, hint=hint)
    if stated and asked and [unit(a) for a in asked] != [unit(s) for s in stated]:
        raise _contradiction(path, "units", line, ", ".join(stated), ", ".join(asked))
    return units


def _contradiction(path: Path, name: str, line: int | None, stated: object, given: object) -> SourceError:
    text = f"the file says {stated}, the option {name} says {given}"
    return SourceError(path, text, line=line, hint=f"Leave the option {name} out, or correct it.")


_SHORTEST, _LONGEST = 1e-7, 86400.0
"""s; a cycle of any sensor of this family, and the time between stored points, lies within."""
_LARGEST_FACTOR = 1e9


def stated_cycle(path: Path, header: Header, given: str | float | None) -> float:
    """Return the sampling cycle in s, from the file or from the caller.

    Raises
    ------
    SourceError
        Neither says it, it has no unit, or they contradict each other.
    """
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
        hint = 'Correct the line; it should read for example "Sampling cycle,50us".'
        raise SourceError(path, message, line=line, hint=hint)
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
    """Return how many samples one stored point stands for.

    Raises
    ------
    SourceError
        The line is missing or not understood, or contradicts the caller.
    """
    if "storage" not in header.entries:
        if given is None and not is_cycle_given:
            raise SourceError(
                path,
                "the file does not say whether every sample was stored",
                hint="Give the factor between samples and stored points: storage_factor=1.",
            ).because(UNSAID)
        return given or 1
    line, cells, unit_text = header.entries["storage"]
    text = " ".join(cells).strip()
    match = re.fullmatch(r"(?:[x×*]|1/)?\s*([0-9]+)\s*(?:times|回|倍)?", text, re.IGNORECASE)
    interval = _time(f"{text} {unit_text}".strip())
    by_interval = interval / cycle if interval else 0.0
    factor = float(match[1]) if match and not unit_text else by_interval
    if not 1 <= factor <= _LARGEST_FACTOR or abs(factor - round(factor)) > 1e-6 * factor:
        message = f"found the storage cycle {shorten(text)}, expected a whole factor such as x1"
        hint = 'Correct the line; it should read for example "Storage cycle,x10".'
        raise SourceError(path, message, line=line, hint=hint)
    if given is not None and given != round(factor):
        raise _contradiction(path, "storage_factor", line, round(factor), given)
    return round(factor)


def interval_of_times(path: Path, header: Header, texts: Sequence[str], profile: KeyenceProfile) -> tuple[float, int]:
    """Return the sampling cycle in s and the storage factor of a file whose rows carry their times.

    Raises
    ------
    SourceError
        The times do not lie evenly, have no unit, or contradict the cycle.
    """
    has_cycle = profile.cycle is not None or "cycle" in header.entries
    unit_text, first_line = header.columns.unit_text, header.n_lines + 1
    if not (unit_text or ":" in texts[0] or has_cycle):
        hint = 'Name the column "Time [s]" (or ms, us), or give the time between rows: cycle="50 us".'
        raise SourceError(path, "the file does not say the unit of its times", line=header.n_lines, hint=hint)
    unsaid = not unit_text and ":" not in texts[0]
    cycle = stated_cycle(path, header, profile.cycle) if has_cycle else 0.0
    for each in ("s", "ms", "us") if unsaid else (unit_text,):
        time, resolution = seconds(texts, each, path=path, first_line=first_line)
        interval = even_interval(time, resolution, path=path, first_line=first_line)
        if not has_cycle:
            return interval, 1
        factor = max(round(interval / cycle), 1)
        if "storage" in header.entries or profile.storage_factor is not None:
            factor = stated_storage(path, header, profile.storage_factor, cycle, is_cycle_given=True)
        if abs(interval - cycle * factor) <= 2.0 * resolution / (len(texts) - 1) + 1e-6 * interval:
            return cycle, factor
    raise SourceError(
        path,
        f"the times lie {interval:.6g} s apart, by the sampling cycle it is {cycle * factor:.6g} s",
        line=header.entries["cycle"][0] if "cycle" in header.entries else first_line,
        hint="Correct the cycle, or the unit of the times.",
    )


def stated_count(path: Path, header: Header, meaning: str) -> int | None:
    """Return a whole number of the header (number of points, averaging), or None.

    Raises
    ------
    SourceError
        The line holds something else, or not the same number for every output.
    """
    if meaning not in header.entries:
        return None
    line, cells, _ = header.entries[meaning]
    found = {cell for cell in cells if cell}
    if len(found) != 1 or not re.fullmatch(r"[0-9]{1,12}", next(iter(found))):
        raise SourceError(path, f"found {shorten(','.join(cells))}, expected one whole number", line=line)
    return int(found.pop())


def stated_start(header: Header) -> str:
    """Return the ISO start, or "" when there is no date of a form that is not ambiguous."""
    date = " ".join(header.entries.get("date", (0, (), ""))[1]).strip()
    clock = " ".join(header.entries.get("clock", (0, (), ""))[1]).strip()
    for text in (f"{date} {clock}".strip(), date):
        if found := moment(text):
            return found.isoformat()
    return ""
