"""Comparison of relaxation tests with the model: force in the ramp, early, late; plateau."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import xarray as xr

from labpipe.judging import Agreement, along_curve, stretch_means, stretches
from labpipe.variables import variable, with_u
from pipelines.experiments.relaxation.measured import samples
from pipelines.experiments.relaxation.settings import Relaxation
from pipelines.experiments.shared import mach1_readings
from pipelines.experiments.shared.comparison_rows import Row, curve_row, curve_table, row, split, with_its_u
from pipelines.experiments.shared.model_inputs import slopes_of, table_of
from pipelines.experiments.shared.punch_model import TOUCH, effects, inputs_behind

_PARTS = ("ramp", "early", "late")


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
    measured, common, slopes, plateaus = loads["force"].values, model.drop_sel(uncertain=TOUCH), [], []
    agreed: dict[str, list[tuple[Agreement | None, float, float]]] = {}
    shared = effects(loads, passed, model)
    for number, inside in enumerate(samples(ramps)):
        ramp, theirs, gap = ramps.isel(ramp=number), passed[inside], (measured - passed)[inside]
        time, begin, end, last = loads["time"].values[inside], *(float(ramp[name]) for name in ("begin", "end", "last"))
        late = time >= float(ramp["plateau_begin"])
        plateaus.append((theirs[late].mean(), model["u_force"].values[inside][late].mean()))
        # half of the hold on a logarithmic scale of time
        until = end + float(np.sqrt((end - begin) * (last - end)))
        spans = {"ramp": (begin, end), "early": (end, until), "late": (until, last)}
        extent = float(np.ptp(theirs))  # a wrong scale must not hide in its own range
        for part, (since, before) in (spans | {"all": (begin, last)}).items():
            there = gap[(time >= since) & (time <= before)]
            error = float(np.sqrt(np.mean(there**2))) / extent if there.size else np.nan
            # the filter is on its way, and details of the ramp count for as long as it lasted
            at = since + max(mach1_readings.filter_settles(loads), end - begin) * (part == "early")
            within = inside.start + np.flatnonzero((time >= at) & (time <= before))
            places = split(loads["time"].values, within, at, before, end) if part != "all" else []
            mean = float(there.mean()) if there.size else np.nan
            along = None
            if places:
                along = along_curve(*stretches(measured - passed, places), stretch_means(shared, places))
            agreed.setdefault(part, []).append((along, error, mean))
        slopes.append(common["slope"].values[:, inside][:, late].mean(axis=1, dtype=float))
    text = "simulated force, behind the cell's filter"
    table = with_u("simulated_force", "sample", passed, u_passed, "N", text, "from touch, punch and solid")
    for part, found in agreed.items():
        table |= curve_table("ramp", found, "N", f"_{part}")
    plateau, u = np.reshape(plateaus, (-1, 2)).T
    table |= with_u("plateau_force_model", "ramp", plateau, u, "N", "plateau force, model")
    changes = [ramps["plateau_force"].values, -plateau, *(-np.transpose(slopes))]
    text = "change of the plateau's force, measured minus model, with an input, SI"
    table["slope"] = variable(("uncertain", "ramp"), np.array(changes), "1", text)
    return xr.Dataset(table, coords={"ramp": ramps["ramp"]}).merge(table_of(inputs_behind(loads, common)))


def rows(ramps: Sequence[xr.Dataset | None], comparison: Sequence[xr.Dataset | None]) -> Iterator[Row]:
    """Yield the rows of ``compare``; none where nothing is simulated."""
    for table, compared in zip(ramps, comparison, strict=True):
        if table is None or compared is None or "nrmse_all" not in compared:
            continue
        for i in range(table.sizes["ramp"]):
            condition = f"{float(table['depth'][i]) * 1e3:.2g} mm"
            for part in _PARTS:
                yield curve_row(f"force, {part}", "N", 1, compared.isel(ramp=i), f"_{part}", condition=condition)
            values = with_its_u(table, "plateau_force", i), with_its_u(compared, "plateau_force_model", i)
            words: dict[str, Any] = {"condition": condition, "slopes": slopes_of(compared, "slope", i)}
            yield row("plateau force", "N", 1, measured=values[0], model=values[1], **words)
