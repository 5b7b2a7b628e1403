"""All checks of one record."""

from math import pi

import numpy as np
import xarray as xr

from labpipe.judging import Check, not_made
from labpipe.signals import Hum
from pipelines.experiments.shared.trace_checks._copies import repeated_rows
from pipelines.experiments.shared.trace_checks._inertia import jumps, single_rows, steady_noise, timing, wave
from pipelines.experiments.shared.trace_checks._range import held_readings, resolution, unread
from pipelines.experiments.shared.trace_checks._rest import beginning, hum, rest_of, smoothed, swing, swing_at_rest
from pipelines.experiments.shared.trace_checks._trace import FLAT, Trace


def checks_of(trace: Trace, gravity: float, *found_in: xr.Dataset | None) -> list[Check]:
    """Make all checks of a trace, those first that explain others; a hum is told by the last result there is."""
    if np.isfinite(trace.reading).sum() < 10 * FLAT:
        return [not_made("readings", "a record has readings", "sixty valid readings")]
    held = held_readings(trace)
    found = [unread(trace), held, repeated_rows(trace), wave(trace)]
    if held.level is None:
        found += [jumps(trace), single_rows(trace)]
    results = [one for one in found_in if one is not None]
    line = Hum.of_text(results[-1].attrs.get("hum")) if results else None
    found += [hum(trace, line, is_known=bool(results)), resolution(trace), timing(trace), steady_noise(trace)]
    rest = rest_of(trace, results)
    found.append(smoothed(trace, rest))
    if line is None:
        shaken = swing(trace, rest)
        found.append(shaken)
        if not shaken.level:
            found.append(beginning(trace, gravity))
    return found


def speed_of_swing(trace: Trace, *found_in: xr.Dataset | None) -> float:
    """Return the speed [m/s] that a swing before the release adds and takes while it lasts; 0 without one."""
    found = swing_at_rest(trace, rest_of(trace, [one for one in found_in if one is not None]))
    return 0.0 if found is None else 2 * pi * found[0] * found[1]
