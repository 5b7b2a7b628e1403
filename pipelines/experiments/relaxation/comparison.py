"""Comparison of relaxation tests with the model: force in the ramp, early, late; plateau."""

from collections.abc import Iterator, Sequence

import numpy as np
import xarray as xr

from labpipe.arrays import Floats, Integers
from labpipe.judging import Agreement
from labpipe.variables import from_rows, variable, with_u
from pipelines.experiments.relaxation.measured import samples
from pipelines.experiments.relaxation.settings import Relaxation
from pipelines.experiments.shared import mach1_readings
from pipelines.experiments.shared.comparison_rows import (
    FORCE_SCALE,
    STIFFNESS,
    Row,
    curve_table,
    of_curve,
    row,
    with_its_u,
)
from pipelines.experiments.shared.model_inputs import INPUTS, inputs_of
from pipelines.experiments.shared.punch_model import TOUCH, laid_along

_SLOPES = "slope_plateau_force"
_PARTS = ("ramp", "early", "late")
_COUNT = 4  # stretches of each
_FEWEST = 10  # samples of a stretch
_FIRST = 0.05  # of the early part, behind which its first stretch begins: the filter is still on its way


def comparison(loads: xr.Dataset, ramps: xr.Dataset, model: xr.Dataset, *, settings: Relaxation) -> xr.Dataset:
    """Lay the simulated force, filtered as the cell filters, over the measured one.

    Errors of ramp, early and late relaxation are all relative to the range of the model in the whole test, so
    that they can be compared with each other.
    """
    del settings
    if "absent" in model.attrs:
        return xr.Dataset(attrs={"absent": model.attrs["absent"]})
    # the uncertainty is one error in common: it passes the filter as a force
    passed, u_passed = (mach1_readings.passed(loads, model[n].values) for n in ("force", "u_force"))
    # each file has a first touch of its own: what the files have in common is the punch and the solid
    measured, common, slopes, rows, agreed = loads["force"].values, model.drop_sel(uncertain=TOUCH), [], [], []
    for number, inside in enumerate(samples(ramps)):
        at, theirs, gap = ramps.isel(ramp=number), passed[inside], (measured - passed)[inside]
        time, begin, end, last = loads["time"].values[inside], *(float(at[name]) for name in ("begin", "end", "last"))
        late = time >= float(at["plateau_begin"])
        plateau, u = float(theirs[late].mean()), float(model["u_force"].values[inside][late].mean())
        row = {
            "plateau_force_model": plateau,
            "u_plateau_force_model": u,
            "plateau_force_difference": float(at["plateau_force"]) - plateau,
            "u_plateau_force_difference": float(np.hypot(float(at["u_plateau_force"]), u)),
        }
        # half of the hold on a logarithmic scale of time
        until = end + float(np.sqrt((end - begin) * (last - end)))
        spans = {"ramp": (begin, end), "early": (end, until), "late": (until, last)}
        extent = float(np.ptp(theirs))  # a wrong scale must not hide in its own range
        for part, (since, before) in (spans | {"all": (begin, last)}).items():
            there = gap[(time >= since) & (time <= before)]
            row[f"nrmse_{part}"] = float(np.sqrt(np.mean(there**2))) / extent if there.size else np.nan
            row[f"bias_{part}"] = float(there.mean()) if there.size else np.nan
        rows.append(row)
        slopes.append(common["slope"].values[:, inside][:, late].mean(axis=1, dtype=float))
        spans["early"] = (end + _FIRST * (until - end), until)
        known: dict[str, Agreement | None] = {}
        for part, span in spans.items():
            places = _stretches(inside.start, time, end, *span)
            known[part] = laid_along(loads, measured, passed, places, model) if places else None
        agreed.append(known)
    columns = {f"nrmse_{p}": ("1", f"rms error over range of simulated force, {p}") for p in (*_PARTS, "all")}
    columns |= {f"bias_{p}": ("N", f"mean of measured minus model, {p}") for p in (*_PARTS, "all")}
    columns |= {
        "plateau_force_model": ("N", "plateau force, model"),
        "plateau_force_difference": ("N", "plateau force, measured minus model"),
    }
    made = xr.Dataset(from_rows("ramp", rows, columns), coords={"ramp": ramps["ramp"]})
    text = "simulated force, behind the cell's filter"
    made = made.assign(with_u("simulated_force", "sample", passed, u_passed, "N", text, "from touch, punch and solid"))
    for part in _PARTS:
        made = made.assign(curve_table("ramp", [one[part] for one in agreed], f"curve_{part}"))
    text = "change of the plateau's force with an input, SI"
    made[_SLOPES] = variable(("ramp", "uncertain"), slopes, "1", text)
    return made.merge(common[list(INPUTS)])


def _stretches(start: int, time: Floats, arrival: float, begin: float, end: float) -> list[Integers]:
    """Return the samples in each stretch of a part of a test, ever longer ones in the hold."""
    inside = np.flatnonzero((time >= begin) & (time <= end))
    count = min(_COUNT, inside.size // _FEWEST)
    if not count:
        return []
    since = max(begin - arrival, 0.0)
    share = np.linspace if begin < arrival else np.geomspace
    at = share(since, since + end - begin, count + 1)[1:-1] + begin - since
    return np.split(start + inside, np.searchsorted(time[inside], at))


def rows(ramps: Sequence[xr.Dataset | None], comparison: Sequence[xr.Dataset | None]) -> Iterator[Row]:
    """Yield the rows of ``compare``; none where nothing is simulated."""
    for table, compared in zip(ramps, comparison, strict=True):
        if table is None or compared is None or "nrmse_all" not in compared:
            continue
        inputs = inputs_of(compared)
        for i in range(table.sizes["ramp"]):
            condition = f"{float(table['depth'][i]) * 1e3:.2g} mm"
            for part in _PARTS:
                nrmse, bias = compared[f"nrmse_{part}"][i], compared[f"bias_{part}"][i]
                told = of_curve(compared.isel(ramp=i), f"curve_{part}")
                yield row(f"force, {part}", "N", 1, condition=condition, nrmse=nrmse, difference=bias, **told)
            seen, simulated = with_its_u(table, "plateau_force", i), with_its_u(compared, "plateau_force_model", i)
            yield row(
                "plateau force",
                "N",
                1,
                slopes={FORCE_SCALE: float(seen[0]), STIFFNESS: -float(simulated[0])}
                | {name: -float(slope) for name, slope in zip(inputs, compared[_SLOPES].values[i], strict=True)},
                condition=condition,
                measured=seen,
                model=simulated,
                difference=with_its_u(compared, "plateau_force_difference", i),
            )
