"""Checks of the force in a motion: it falls in a hold, and lags as a solid's does."""

from dataclasses import replace
from math import hypot, isfinite, pi

import numpy as np

from labpipe.judging import Check, bounded, not_made
from labpipe.report import quantity
from pipelines.experiments.shared.mach1_checks._parts import Part, travel_and_speed
from pipelines.experiments.shared.mach1_checks._titles import FALL, PHASE


def falls(name: str, part: Part) -> Check:
    """Hold a force under a held depth against relaxation: it falls, or stays."""
    title = FALL
    travel, _, rest = travel_and_speed(part)
    inside = part.segment == part.segment[0]
    time, force = part.time[inside], part.force[inside]
    end = float(time[-1])
    if not (isfinite(rest) and rest > 0.0) or travel * part.declared("Amplitude")[0] < 0.0:
        return not_made(title, "a hold after a ramp into the material")
    early = force[(time > end - 0.75 * rest) & (time <= end - 0.5 * rest)]
    late = force[time > end - 0.25 * rest]
    if min(early.size, late.size) < 5:
        return not_made(title, "a hold of some seconds")
    rise = float(late.mean() - early.mean())
    size = max(abs(float(late.mean())), float(np.ptp(force)))
    u = hypot(float(late.std()) / (late.size / 10 + 1) ** 0.5, 2e-3 * size)
    text = f"{name}, block {part.number + 1}: the force changes by {quantity(rise, 'N')} in the second half of its hold"
    check = bounded(title, text, rise, u, at_most=0.0, file=name, line=part.header_line)
    cause = (
        "the sign of the force is wrong, the rows stand in reverse order, or the stage crept on: a "
        "force in a hold falls"
    )
    return replace(check, cause=cause)


def phase(name: str, lag: float, u: float, frequency: float, record: str | None) -> Check:
    """Hold a phase lag [rad] against 0 to pi/2."""
    title = PHASE
    text = f"{name}: the force {'lags' if lag < 0.0 else 'leads'} by {abs(lag) * 180 / pi:.2f}° at {frequency:.3g} Hz"
    cause = "the columns are swapped, a sign is wrong, or the delay of the cell's filter is not what "
    cause += f"{record} says" if record else "its header says"
    cause += ", or the stage has play (backlash)" if lag < 0.0 else ""
    return bounded(title, text, lag, max(u, 1e-3), at_least=0.0, at_most=pi / 2, file=name, cause=cause)
