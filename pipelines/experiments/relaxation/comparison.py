"""Comparison of relaxation tests with the model: force in the ramp, early, late; plateau."""

from collections.abc import Iterator

import numpy as np
import xarray as xr

from labpipe.arrays import Floats
from labpipe.judging import Agreement, along_curve, stretches
from labpipe.variables import from_rows, variable
from pipelines.experiments.relaxation.model import SLOPES
from pipelines.experiments.relaxation.moduli import through
from pipelines.experiments.relaxation.settings import Relaxation
from pipelines.experiments.shared import mach1_readings, ramps_and_holds
from pipelines.experiments.shared.comparison_rows import (
    FORCE_SCALE,
    STIFFNESS,
    Row,
    curve_table,
    of_curve,
    row,
    with_its_u,
)
from pipelines.experiments.shared.punch_model import INPUTS, inputs_of
from pipelines.experiments.shared.ramps_and_holds import Hold, relative_gain

_PARTS = ("ramp", "early", "late", "all")
_STRETCHED = ("ramp", "early", "late")
_COUNT = 4  # stretches of each
_FEWEST = 10  # samples of a stretch
_FIRST = 0.05  # of the early part, behind which its first stretch begins: the filter is still on its way


def comparison(loads: xr.Dataset, ramps: xr.Dataset, model: xr.Dataset, *, settings: Relaxation) -> xr.Dataset:
    """Lay the simulated force, filtered as the cell filters, over the measured one.

    Errors of ramp, early and late relaxation are all relative to the range of the model in the whole test, so
    that they can be compared with each other.
    """
    if "absent" in model.attrs:
        return xr.Dataset(attrs={"absent": model.attrs["absent"]})
    found = ramps_and_holds.find(loads)
    declared = mach1_readings.declared_filter(loads)
    interval = float(loads["sampling_interval"][found[0].block])
    kind = mach1_readings.filter_kinds(loads)[0]
    passed = through(loads, model["force"].values, interval, declared, kind)
    measured = loads["force"].values
    rows, agreed = [], []
    late_by = mach1_readings.filter_delay(loads).u * np.gradient(passed, interval) if declared else 0.0 * passed
    for number, hold in enumerate(found):
        level = ramps_and_holds.plateau(loads, hold, settings.hold.plateau.value)
        late = loads["time"].values[hold.rows] >= level.begin
        theirs = passed[hold.rows]
        peak, plateau = float(theirs.max()), float(theirs[late].mean())
        u_plateau = float(model["u_force"].values[hold.rows][late].mean())
        at = ramps.isel(ramp=number)
        agreed.append(_along(loads, hold, model, number, measured - passed, late_by, settings.hold.early.value))
        rows.append(
            _errors(loads, hold, measured, passed, settings.hold.early.value)
            | {
                "peak_force_model": peak,
                "plateau_force_model": plateau,
                "u_plateau_force_model": u_plateau,
                "peak_force_difference": float(at["peak_force"]) - peak,
                "plateau_force_difference": float(at["plateau_force"]) - plateau,
                "u_plateau_force_difference": float(np.hypot(float(at["u_plateau_force"]), u_plateau)),
            }
        )
    columns = {f"nrmse_{p}": ("1", f"rms error over range of simulated force, {p}") for p in _PARTS}
    columns |= {f"bias_{p}": ("N", f"mean of measured minus model, {p}") for p in _PARTS}
    columns |= {
        "peak_force_model": ("N", "largest force, model behind the filter"),
        "plateau_force_model": ("N", "plateau force, model"),
        "peak_force_difference": ("N", "largest force, measured minus model"),
        "plateau_force_difference": ("N", "plateau force, measured minus model"),
    }
    made = xr.Dataset(from_rows("ramp", rows, columns), coords={"ramp": ramps["ramp"]})
    made["simulated_force"] = variable("sample", passed, "N", "simulated force, behind the cell's filter")
    u = through(loads, model["u_force"].values, interval, declared, kind)  # one error in common: it passes as a force
    made["u_simulated_force"] = variable("sample", u, "N", "standard uncertainty from first touch, punch and solid")
    for part in _STRETCHED:
        made = made.assign(curve_table("ramp", [one[part] for one in agreed], f"curve_{part}"))
    return made.merge(model[[SLOPES, *INPUTS]])


def _along(
    loads: xr.Dataset, hold: Hold, model: xr.Dataset, number: int, left: Floats, late_by: Floats, early: float
) -> dict[str, Agreement | None]:
    """Lay each part of a test against the model in stretches of it, ever longer ones in the hold.

    They share tare and gain, what the model takes of touch, punch and solid, and the delay of the cell.
    """
    time = loads["time"].values[hold.rows]
    force = loads["force"].values
    nodes, effects = model["node"].values[number], model["effect"].values[number].T
    until = min(hold.end + early, hold.last)
    begins = {"ramp": hold.begin, "early": hold.end + _FIRST * (until - hold.end), "late": until}
    ends = {"ramp": hold.end, "early": until, "late": hold.last}
    found: dict[str, Agreement | None] = {}
    for part, begin in begins.items():
        inside = np.flatnonzero((time >= begin) & (time <= ends[part]))
        count = min(_COUNT, inside.size // _FEWEST)
        if not count:
            found[part] = None
            continue
        share = np.linspace if part == "ramp" else np.geomspace
        start = 0.0 if part == "ramp" else begin - hold.end
        at = share(start, start + ends[part] - begin, count + 1)[1:-1] + begin - start
        places = np.split(hold.rows.start + inside, np.searchsorted(time[inside], at))
        means, own = stretches(left, places)
        of_cell = [
            np.full(len(places), float(loads["u_tare"])),
            relative_gain(loads) * np.array([force[place].mean() for place in places]),
            np.array([late_by[place].mean() for place in places]),
        ]
        of_model = [[np.interp(place, nodes, one).mean() for place in places] for one in effects]
        found[part] = along_curve(means, own, np.array([*of_cell, *of_model]))
    return found


def _errors(loads: xr.Dataset, hold: Hold, measured: Floats, simulated: Floats, early: float) -> dict[str, float]:
    """Return nRMSE and bias of the parts of one test."""
    time = loads["time"].values[hold.rows]
    ours, theirs = measured[hold.rows], simulated[hold.rows]
    extent = float(np.ptp(theirs))  # a wrong scale must not hide in its own range
    parts = {
        "ramp": (time >= hold.begin) & (time <= hold.end),
        "early": (time > hold.end) & (time <= hold.end + early),
        "late": time > hold.end + early,
        "all": time >= hold.begin,
    }
    row = {}
    for name, inside in parts.items():
        gap = ours[inside] - theirs[inside]
        row[f"nrmse_{name}"] = float(np.sqrt(np.mean(gap**2))) / extent if gap.size else np.nan
        row[f"bias_{name}"] = float(gap.mean()) if gap.size else np.nan
    return row


def rows(tests: xr.Dataset) -> Iterator[Row]:
    """Yield the rows of ``compare``; none where nothing is simulated."""
    if "nrmse_all" not in tests:
        return
    inputs = inputs_of(tests)
    for i in range(tests.sizes["test"]):
        condition = f"{float(tests['depth'][i]) * 1e3:.2g} mm"
        for part in _STRETCHED:
            nrmse, bias = tests[f"nrmse_{part}"][i], tests[f"bias_{part}"][i]
            told = of_curve(tests.isel(test=i), f"curve_{part}")
            yield row(f"force, {part}", "N", 1, condition=condition, nrmse=nrmse, difference=bias, **told)
        yield row(
            "plateau force",
            "N",
            1,
            slopes={FORCE_SCALE: float(tests["plateau_force"][i]), STIFFNESS: -float(tests["plateau_force_model"][i])}
            | {name: -float(slope) for name, slope in zip(inputs, tests[SLOPES].values[i], strict=True)},
            condition=condition,
            measured=with_its_u(tests, "plateau_force", i),
            model=with_its_u(tests, "plateau_force_model", i),
            difference=with_its_u(tests, "plateau_force_difference", i),
        )
