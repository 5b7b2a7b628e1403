"""Mistakes with a file, a column or a setting that would explain what the checks of a Mach-1 file see."""

from collections.abc import Iterator, Mapping, Sequence
from math import log

import numpy as np
import xarray as xr

from labpipe.judging import Cause, Check, in_words, too_large
from labpipe.report import quantity
from pipelines.experiments.shared.mach1_checks import _titles as titles
from pipelines.experiments.shared.mach1_checks._parts import OSCILLATION, Part, counted_frequency, moved_by, parts
from pipelines.experiments.shared.punch_settings import LoadCell, Punch

_FACTORS = (1e3, 1e-3, 1e6, 1e-6, 10.0, 0.1, 100.0, 0.01, 2.0, 0.5, 60.0, 1 / 60.0)
_GRAVITY = 9.80665


def causes(
    name: str, readings: xr.Dataset, punch: Punch | None, load_cell: LoadCell, checks: Sequence[Check] = ()
) -> Iterator[Cause]:
    """Yield the mistakes with a file, a column or a setting that multiply what is seen.

    A factor that all oscillations share is more likely one of a column, one that a single block
    has is one of its header.
    """
    blocks = parts(readings)
    if not blocks:
        return
    names = blocks[0].header_line
    position, force_unit = (
        _SPELT.get(text := str(readings[name].attrs["original_unit"]), text) for name in ("position_z", "force_z")
    )
    columns = [
        Cause(
            {titles.FREQUENCY: -1.0, titles.SPEED: -1.0, titles.APPROACH: -1.0, titles.HOLD: 1.0, titles.CLOCK: 1.0},
            lambda k: f"the column of the time is {too_large(k)}{_unit_of(k, 's', _TIMES)} (line {names})",
            _FACTORS,
            file=name,
            line=names,
        ),
        Cause(
            {titles.AMPLITUDE: 1.0, titles.TRAVEL: 1.0, titles.SPEED: 1.0, titles.APPROACH: 1.0, titles.RATIO: -1.1},
            lambda k: f"the column of the position is {too_large(k)}{_unit_of(k, position, _LENGTHS)} (line {names})",
            _FACTORS,
            file=name,
            line=names,
        ),
    ]
    headers = [
        Cause(
            {check.name: -1.0},
            lambda k, check=check: (  # type: ignore[misc]
                f"the declared {_DECLARED[check.name]} is {too_large(k)} (line {check.line} of {name})"
            ),
            (10.0, 0.1, 2.0, 0.5, 1e3, 1e-3, 100.0, 0.01),
            file=name,
            line=check.line,
        )
        for check in checks
        if check.name in _DECLARED and check.level is not None
    ]
    yield from [*columns, *headers] if _shared(blocks) else [*headers, *columns]
    force = Cause(
        {titles.RATIO: 1.0},
        lambda k: f"the column of the force is {too_large(k)}{_unit_of(k, force_unit, _FORCES)} (line {names})",
        tuple(_FORCES[force_unit] / size for unit, size in _FORCES.items() if unit != force_unit),
        only_usual=True,
        file=name,
        line=names,
    )
    yield force
    # a record that hardly changes what the tester shows is not where a factor of ten comes from
    is_held = any(check.name == titles.SCALE and check.is_made and check.level is None for check in checks)
    if load_cell.record and not is_held:
        yield Cause(
            {titles.RATIO: 1.0},
            lambda k: f"the scale of the load cell in {load_cell.record} is {too_large(k)}",
            (10.0, 100.0),
            only_usual=True,
            file=load_cell.record,
            setting="values.scale",
        )
    yield Cause(
        {titles.RATIO: 1.0},
        lambda k: (
            f"no slip of a unit explains it: another material, {in_words(k)} times as stiff, was pressed or is named"
        ),
        setting="substrate.material",
    )
    if punch is None:
        return
    for what, setting, value in (
        ("number of tips", "punch.tips", float(punch.tips)),
        ("length of a tip", "punch.depth", punch.depth.value),
    ):
        unit = "1" if setting == "punch.tips" else "m"
        yield Cause(
            {titles.RATIO: -1.0},
            lambda k, what=what, value=value, unit=unit, setting=setting: (  # type: ignore[misc]
                f"the {what} is probably {quantity(value / k, unit)}, not {quantity(value, unit)} "
                f"({setting} in session.toml)"
            ),
            (*(10.0,) * (punch.tips % 10 == 0), 0.1) if setting == "punch.tips" else (1e3, 1e-3, 100.0, 10.0, 0.1),
            only_usual=True,
            setting=setting,
        )


_DECLARED = {
    titles.AMPLITUDE: "amplitude",
    titles.FREQUENCY: "frequency",
    titles.TRAVEL: "amplitude",
    titles.SPEED: "velocity",
    titles.APPROACH: "stage velocity",
}
_TIMES = {"s": 1.0, "ms": 1e-3}
_LENGTHS = {"mm": 1e-3, "µm": 1e-6}
_FORCES = {"N": 1.0, "gf": 1e-3 * _GRAVITY, "mN": 1e-3, "kN": 1e3, "kgf": _GRAVITY}
"""What a column may be in, whatever its header says, in SI."""
_SPELT = {"um": "µm"}


def _unit_of(factor: float, header: str, units: Mapping[str, float]) -> str:
    """Say in which unit a column would be that many times too large under its header; "" for none of them."""
    away = {unit: abs(log(factor * size / units[header])) for unit, size in units.items() if unit != header}
    nearest = min(away, key=lambda unit: away[unit])
    return f": in {nearest} under {header}" if away[nearest] < log(1.1) else ""


def _shared(blocks: Sequence[Part]) -> bool:
    """Whether all of several oscillations differ from their commands by one factor."""
    rows = [
        (moved_by(p, p.position) / p.declared("Amplitude")[0], counted_frequency(p)[0] / p.declared("Frequency")[0])
        for p in blocks
        if p.function == OSCILLATION
    ]
    if len(rows) < 2:
        return False
    spread = np.ptp(np.log(np.maximum(np.array(rows), 1e-12)), axis=0)
    return bool((spread < 0.2).all())
