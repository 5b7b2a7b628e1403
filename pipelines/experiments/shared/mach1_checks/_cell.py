"""Checks of the load cell of a tester: sign, response, saturation, capacity, calibration and delay."""

import json
import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from math import isfinite, log

import numpy as np
import xarray as xr

from labpipe.judging import Check, Level, bounded, compared, not_made, stated
from labpipe.report import quantity
from pipelines.experiments.shared import mach1_readings
from pipelines.experiments.shared.judgements import day_known
from pipelines.experiments.shared.mach1_checks._motion import direction_of_motion
from pipelines.experiments.shared.mach1_checks._parts import OSCILLATION, Part, line_of, response_of
from pipelines.experiments.shared.mach1_checks._titles import CAPACITY, DELAY, SCALE, SIGN
from pipelines.experiments.shared.punch_settings import LoadCell
from pipelines.experiments.shared.ramps_and_holds import RELAXATION

_RUN, _LEAVES = 5, 20.0
"""Readings in a row at an extreme, and steps of the cell by which a force changes in as many before
or after: behind a smooth peak that stays on one step for n readings it changes by 8 in n more."""
_EXPLAINED = 0.2  # share of a force that its motion must explain, if the cell lives
_SOONER, _LATER = 0.25, 0.6
"""Of the delay that order and cutoff of a Butterworth say, by which another filter may have less or more: three equal
poles have 0.76 times as much, Bessel's 0.88, Chebyshev's more."""
_OWN_FACTOR, _WRONG_FACTOR = 1.25, 3.0  # of true over displayed force: worth a doubt, and wrong


def sign_of_stiffness(name: str, blocks: Sequence[Part]) -> Iterator[Check]:
    title = SIGN
    found = [(p, *response_of(p)) for p in blocks if p.function in (OSCILLATION, RELAXATION)]
    known = [(p, k, u) for p, k, u, share in found if isfinite(k) and share > _EXPLAINED]
    if not known:
        yield not_made(title, "a motion in contact, and a force that follows it")
        return
    part, k, u = known[0]
    text = f"{name}, block {part.number + 1}: stiffness {quantity(k, 'N/m')}"
    check = bounded(title, text, k, max(u, 1e-3 * abs(k)), at_least=0.0, file=name, line=part.header_line)
    if check.level is not None and direction_of_motion(name, blocks).level is None:
        cause = (
            f"the sign of the column of the force is wrong (line {part.header_line}), or the load cell's type "
            f"(line {line_of(part, 'Load Cell Type')}), which says the sign of compression"
        )
        check = replace(check, cause=cause)
    elif check.level is not None:
        check = replace(check, cause=direction_of_motion(name, blocks).cause)
    yield check


def response_of_cell(name: str, blocks: Sequence[Part]) -> Check:
    title = "response of the cell"
    found = [(p, response_of(p)[2]) for p in blocks if p.function in (OSCILLATION, RELAXATION)]
    known = [(p, share) for p, share in found if isfinite(share)]
    if not known:
        return not_made(title, "a motion of the stage")
    share = max(s for _, s in known)
    part = known[0][0]
    if share > _EXPLAINED:
        return stated(title, f"{name}: the force follows the motion", None, file=name)
    spread = max(float(np.nanmax(p.force) - np.nanmin(p.force)) for p, _ in known)
    kind = "is constant" if spread == 0.0 else f"scatters over {quantity(spread, 'N')} and"
    text = f"{name}: the force {kind} {'while' if spread == 0.0 else 'does not follow, while'} the stage moves"
    cause = f"the load cell was dead or not connected, or another axis was recorded (line {part.header_line})"
    return stated(title, text, "impossible", cause=cause, file=name, line=part.header_line)


def saturation(name: str, blocks: Sequence[Part]) -> Check:
    title = "saturation of the cell"
    for part in (p for p in blocks if p.function in (OSCILLATION, RELAXATION)):
        force = part.force[np.isfinite(part.force)]
        steps = np.abs(np.diff(force))
        step = float(np.min(steps[steps > 0.0])) if (steps > 0.0).any() else 0.0
        if step == 0.0:
            continue
        for extreme in (float(force.max()), float(force.min())):
            at = np.abs(force - extreme) < 0.5 * step
            edges = np.flatnonzero(np.diff(np.concatenate([[False], at, [False]]).astype(int)))
            starts, ends = edges[::2], edges[1::2]
            longest = int(np.argmax(ends - starts))
            first, after = int(starts[longest]), int(ends[longest])
            n = after - first
            sides = [force[max(first - n, 0)], force[min(after + n - 1, force.size - 1)]]
            leaves = max(abs(s - extreme) for s in sides)
            wide = max(step, 1e-4 * float(np.ptp(force)))
            if n >= _RUN and leaves > _LEAVES * wide:
                text = (
                    f"{name}, block {part.number + 1}: the force stays at {quantity(extreme, 'N')} for {n} readings "
                    f"from {quantity(float(part.time[first]), 's')}, then changes by {quantity(leaves, 'N')}"
                )
                cause = "the cell or its amplifier was saturated: peaks and work are not measured; use a larger range"
                return stated(title, text, "impossible", cause=cause, file=name, line=part.header_line)
    return stated(title, f"{name}: no flat extremes", None, file=name)


def capacity_of_cell(name: str, blocks: Sequence[Part]) -> Check:
    cell = str((blocks[0].header.get("load_cell") or {}).get("name") or "")
    capacity = _capacity(cell)
    if capacity is None:
        return not_made(CAPACITY, "a load cell whose name says its capacity")
    largest = max(float(np.nanmax(np.abs(p.force))) for p in blocks)
    text = f"{name}: up to {quantity(largest, 'N')} with a cell of {quantity(capacity, 'N')} ({cell})"
    part = blocks[0]
    check = bounded(CAPACITY, text, largest, 0.1 * capacity, at_most=1.1 * capacity, file=name, line=part.header_line)
    cause = f"the column of the force is in gf or mN, not in N (header of the columns, line {part.header_line})"
    return replace(check, cause=cause)


def _capacity(name: str) -> float | None:
    """Return the force [N] that the name of a cell says, such as "25kg SN:1886652"; None where it says none."""
    said = re.search(r"(\d+(?:\.\d+)?)\s*(kg|g|kN|N)\b", name)
    factor = {"kg": 9.80665, "g": 9.80665e-3, "N": 1.0, "kN": 1e3}
    return None if said is None else float(said[1]) * factor[said[2]]


def of_cell(load_cell: LoadCell, loads: xr.Dataset) -> list[Check]:
    """Check the record of the load cell: its scale, and the delay of its filter."""
    gain = float(loads["gain"])
    record = load_cell.record or ""
    found = [day_known(loads, record)]
    if not record:
        found.append(not_made(SCALE, "a calibration record of the load cell"))
    else:
        off = abs(log(abs(gain))) if gain else np.inf
        level: Level | None = (
            "impossible" if off > log(_WRONG_FACTOR) else "doubtful" if off > log(_OWN_FACTOR) else None
        )
        text = f"{record}: true force is {gain:.4g} times the displayed one"
        cause = f"the scale of the load cell in {record} is wrong: about 1 is expected, not {gain:.4g}"
        found.append(stated(SCALE, text, level, cause=cause, file=record, setting="values.scale"))
    declared = mach1_readings.declared_filter(loads)
    measured = json.loads(loads.attrs.get("filter_delay", "null"))
    if declared is None or measured is None:
        return [*found, not_made(DELAY, "a measured delay, and a declared filter")]
    value, u_value = measured
    expected = mach1_readings.filter_delay(loads.assign_attrs(filter_delay="null"))
    text = (
        f"{record}: the delay is {quantity(value, 's')}, a filter of order {int(declared['order'])} and "
        f"{declared['cutoff']:.3g} Hz has about {quantity(expected.value, 's')}"
    )
    check = compared(
        DELAY,
        text,
        value,
        u_value,
        expected.value,
        0.1 * expected.value,
        allowance=(_LATER if value > expected.value else _SOONER) * expected.value,
        file=record,
        setting="values.filter_delay",
    )
    if check.level is not None:
        wrong = f"the delay of the filter in {record} is probably {quantity(expected.value, 's')}"
        check = replace(check, cause=f"{wrong}, not {quantity(value, 's')}")
    return [*found, check]
