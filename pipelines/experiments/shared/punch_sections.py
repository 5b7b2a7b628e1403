"""Sections that the reports of indentations share."""

import json
import math
from collections.abc import Sequence

import xarray as xr

from labpipe.report import Block, Details, KeyValues, Listed, Section, budget_table, listed, value_with_uncertainty
from labpipe.workflow.context import Context
from pipelines.experiments.shared import pages
from pipelines.experiments.shared.punch_settings import Indentation
from pipelines.experiments.shared.reports import is_there


def measured(
    settings: Indentation,
    context: Context,
    files: Sequence[str],
    readings: Sequence[xr.Dataset | None] | None,
    loads: Sequence[xr.Dataset | None] | None,
    model: xr.Dataset | None,
) -> Section:
    """Show the punch, the model and every file: its blocks, its load cell and its raw header, folded away."""
    punch, rows = settings.punch, [("file" if len(files) == 1 else "files", ", ".join(files), "")]
    if punch is not None:
        rows += [
            ("tip radius", pages.stated(punch.radius), settings.model.profile),
            ("period", pages.stated(punch.period), ""),
            ("tips", f"{punch.tips}, each {punch.depth.value * 1e3:g} mm long", ""),
        ]
    rows += pages.remarks(context)
    if model is not None and is_there(model) and settings.substrate is not None:
        touch = "contact_position"
        rows += [
            ("material", settings.substrate.source, ""),
            *([("first touch", pages.told(model, touch), model.attrs["contact"])] if touch in model else []),
            ("solver", model.attrs["solver"], model.attrs["solver_reason"]),
            ("datum of displacement", model.attrs["datum"], ""),
        ]
    blocks: list[Block] = [KeyValues([row for row in rows if row[1]])]
    nothing = [None] * len(files)
    for name, raw, force in zip(files, readings or nothing, loads or nothing, strict=True):
        inside: list[Block] = [] if raw is None else [_blocks_of(raw)]
        inside += [] if force is None else _cell(force)
        header = pages.raw_header(raw)
        blocks += [Details(name, inside)] if inside else []
        blocks += [header] if header is not None else []
    return pages.folded("What was measured, and its calibration", "File, punch and calibration record", blocks)


def _blocks_of(readings: xr.Dataset) -> Block:
    columns = (
        Listed("block", list(range(1, len(readings["function"]) + 1))),
        Listed("function", [str(f) for f in readings["function"].values]),
        Listed("start", [str(s) for s in readings["start_time"].values]),
        Listed("readings", readings["n_rows"].values.astype(int).tolist()),
    )
    return listed(columns, "Blocks of the file")


def _cell(loads: xr.Dataset) -> list[Block]:
    """Show tare, gain and the budget of the largest force."""
    gain, u_gain = float(loads["gain"]), float(loads["u_gain"])
    known = math.isfinite(u_gain)
    unknown = "as applied by the instrument; its uncertainty is unknown without a calibration record"
    rows = [
        ("tare", pages.told(loads, "tare"), "subtracted" if loads.attrs["is_tared"] else "not subtracted"),
        ("gain of the load cell", value_with_uncertainty(gain, u_gain if known else 0.0), "" if known else unknown),
    ]
    record = loads.attrs["calibration"]
    blocks: list[Block] = [KeyValues(rows), *([pages.calibration_rows(record)] if record.startswith("{") else [])]
    return [*blocks, *budget_table(json.loads(loads.attrs["budget"]), "Budget for the largest force of the file", "N")]
