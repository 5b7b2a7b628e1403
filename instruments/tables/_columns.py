"""Which columns of a table belong together, and what those without a clear heading hold.

Columns side by side belong to frequencies or temperatures that the headings state; of columns with the
same quantity the first counts; a time of day is no time, and the only column in degrees is the temperature.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from instruments import anton_paar
from instruments._symbols import FREQUENCIES, MODULI, RESPONSES, TIMES
from instruments.tables import _layout, _words
from instruments.tables._cells import is_clock
from instruments.tables._layout import Block
from instruments.tables._words import Heading
from labpipe.arrays import Floats
from labpipe.errors import SourceError, warn_of
from labpipe.text import shorten

Pair = tuple[Heading, Floats]

#: Quantities without a unit.
UNITLESS = ("loss_factor", "log10_aT", "ln_aT", "a_T", "b_T", "set")
#: What no modulus and no response is made of.
BESIDE = frozenset({"torque", "normal_force", "deflection_angle", "gap", "shear_rate", "viscosity", "stress", "strain"})
_ROUNDED = 2e-3  # of a column that was rounded to three digits
_ABOVE = re.compile(rf"([+-]?\d+(?:[.,]\d+)?)\s*({_words.DEGREES}|C)\b")


_EXAMPLE = {
    "frequency": "Hz", "angular_frequency": "rad/s", "temperature": "degC", "temperature_set": "degC", "time": "s",
    "interval_time": "s", "phase_angle": "deg", "storage_compliance": "1/MPa", "loss_compliance": "1/MPa",
    "complex_compliance": "1/MPa", "creep_compliance": "1/MPa", "complex_viscosity": "Pa s",
    "complex_viscosity_real": "Pa s", "complex_viscosity_imaginary": "Pa s",
}  # fmt: skip


def parted(path: Path, block: Block, values: Floats) -> Iterator[list[Pair]]:
    """Yield the columns of a table, or of each of several that stand side by side.

    Columns side by side belong to frequencies or temperatures that the headings state
    (``E'(1 Hz)``, ``E'(10 Hz)``), or to temperatures in the line above.
    """
    pairs = list(zip(block.headings, values.T, strict=True))
    places = list(dict.fromkeys(heading.at for heading in block.headings if heading.at is not None))
    if places:
        shared = [pair for pair in pairs if pair[0].at is None]
        _refuse_specimens(path, block, [pair for pair in shared if pair[0].name in MODULI])
        for place in places:
            its = [pair for pair in pairs if pair[0].at == place]
            _refuse_specimens(path, block, its)
            name = _layout.place_of(its[0][0])
            kept = [pair for pair in _nearest(shared, pairs, its[0]) if pair[0].name != name]
            constant = (Heading("", name, place[1], is_known=True), np.full(len(values), place[0]))
            yield [*kept, *its, constant]
        return
    names = [heading.name for heading in block.headings if heading.is_known]
    count = max((names.count(name) for name in names if name in MODULI | RESPONSES), default=1)
    if count == 1:
        yield _unique(path, block, pairs)
        return
    twice = {name for name in names if names.count(name) == count}
    stated = _ABOVE.findall(block.above[1])
    if ("temperature" in names and "temperature" not in twice) or ("temperature" not in twice and len(stated) != count):
        titles = [heading.text for heading in block.headings if heading.name in twice]
        raise SourceError(
            path,
            f"several columns hold the same quantity: {shorten(', '.join(titles))}",
            line=block.line,
            hint="Delete or rename all but one of them; of isotherms side by side, state each temperature with its "
            "unit in the line above, or in the headings: E' @ 25 °C (MPa).",
        )
    for k in range(count):
        seen: dict[str, int] = {}
        part = []
        for heading, column in pairs:
            index = seen.get(heading.name, 0)
            seen[heading.name] = index + 1
            if heading.name not in twice or index == k:
                part.append((heading, column))
        if "temperature" not in twice:
            value = float(stated[k][0].replace(",", "."))
            unit = _words.degrees(stated[k][1])
            part.append((Heading("", "temperature", unit, is_known=True), np.full(len(values), value)))
        yield part


def of_their_unit(headings: Sequence[Heading]) -> list[Heading]:
    """Take for other quantities what has a unit of none of its namesakes: a stiffness ``K* (N/m)`` beside E*."""
    fitting = {heading.name for heading in headings if _words.fits(heading.name, heading.unit)}
    return [
        replace(heading, name=anton_paar.slug(heading.text), is_known=False)
        if heading.unit and heading.name in fitting and not _words.fits(heading.name, heading.unit)
        else heading
        for heading in headings
    ]


def without_clocks(block: Block, headings: Sequence[Heading]) -> list[Heading]:
    """Take times of day, beside frequencies, for text: they are no time since a beginning."""
    found = list(headings)
    if any(h.name in FREQUENCIES for h in headings):
        for k, heading in enumerate(headings):
            if heading.name in TIMES and any(is_clock(row[k]) for _, row in block.rows if k < len(row)):
                found[k] = replace(heading, name=anton_paar.slug(heading.text), is_known=False)
    return found


def name_the_temperature(path: Path, block: Block) -> None:
    """Take the only column in degrees for the temperature, where none is called so, and say it."""
    if block.names() & {"temperature", "temperature_set"}:
        return
    places = [
        k for k, h in enumerate(block.headings) if not h.is_known and h.unit and _words.fits("temperature", h.unit)
    ]
    names = shorten(", ".join(block.headings[k].text for k in places))
    if len(places) > 1:
        warn_of(
            path,
            f"several columns are in degrees, none is called temperature and none taken: {names}. "
            f'Name the columns in order: columns="{example(block)}"',
            line=block.line,
        )
    elif places:
        block.headings[places[0]] = replace(block.headings[places[0]], name="temperature", is_known=True)
        warn_of(path, f"{names}, the only column in degrees, is taken for the temperature", line=block.line)


def _nearest(shared: Sequence[Pair], pairs: Sequence[Pair], first: Pair) -> list[Pair]:
    """Return the columns of all places; of repeated ones, such as a temperature before each, the next to the left."""
    at = next(k for k, pair in enumerate(pairs) if pair is first)
    places = {id(pair): k for k, pair in enumerate(pairs)}
    found: dict[str, Pair] = {}
    for pair in shared:
        if pair[0].name not in found or places[id(pair)] < at:
            found[pair[0].name] = pair
    return list(found.values())


def _refuse_specimens(path: Path, block: Block, its: Sequence[Pair]) -> None:
    """Refuse columns side by side that are several readings of one quantity at one frequency or temperature."""
    seen: dict[str, Pair] = {}
    for pair in its:
        before = seen.setdefault(pair[0].name, pair)
        if before is not pair and pair[0].is_known and not _is_the_same(before, pair):
            raise SourceError(
                path,
                f"several columns are {shorten(pair[0].text)} and differ, as of several specimens or runs side by side",
                line=block.line,
                hint="Export each specimen to a file of its own, or name the columns of one and - for all others: "
                f'columns="{example(block, is_once=True)}".',
            )


def _unique(path: Path, block: Block, pairs: Sequence[Pair]) -> list[Pair]:
    """Keep the first of columns with the same quantity; told where the others differ and are made use of.

    Beside frequencies, of which each reading takes a time, several clocks are no contradiction.
    """
    is_swept = any(heading.name in FREQUENCIES for heading, _ in pairs)
    beside = BESIDE | (TIMES if is_swept else frozenset())
    kept: dict[str, Pair] = {}
    for heading, column in pairs:
        if heading.name not in kept:
            kept[heading.name] = (heading, column)
        elif (
            heading.is_known and heading.name not in beside and not _is_the_same(kept[heading.name], (heading, column))
        ):
            warn_of(
                path,
                f"two columns hold {_words.SPOKEN.get(heading.name, heading.name)} and differ; "
                f'the first, "{kept[heading.name][0].text}", is taken',
                line=block.line,
            )
    return list(kept.values())


def _is_the_same(one: Pair, other: Pair) -> bool:
    """Tell two columns with the same readings, be they in units of their own, Hz and rad/s, or of fewer digits."""
    if np.array_equal(one[1], other[1], equal_nan=True):
        return True
    ratio = 1.0
    if one[0].unit != other[0].unit:
        ratio = float(np.nanmedian(other[1] / np.where(one[1] == 0, np.nan, one[1])))
    return bool(np.allclose(other[1], ratio * one[1], rtol=_ROUNDED, equal_nan=True))


def example(block: Block, *, is_once: bool = False) -> str:
    """Spell the columns with units, as they might be given; of repeated ones the first, if that is asked for."""
    texts = []
    seen: set[tuple[str, tuple[float, str] | None]] = set()
    for heading in block.headings:
        place = (heading.name, heading.at)
        if is_once and place in seen:
            texts.append("-")
            continue
        seen.add(place)
        unit = (
            heading.unit.strip("[]()") if _words.fits(heading.name, heading.unit) else _EXAMPLE.get(heading.name, "MPa")
        )
        bare = re.split(r"\s*[(\[/,]", heading.text)[0].strip() if heading.is_known else heading.text
        bare = re.sub(r'[";]', "''", bare)
        bare += f" @ {heading.at[0]:g} {heading.at[1]}" if heading.at is not None else ""
        texts.append(f"{bare} ({unit})" if heading.is_known and heading.name not in UNITLESS else bare or "-")
    return ", ".join(texts)
