"""Sections that the reports of indentations share."""

import json
import math

import xarray as xr

from labpipe.report import Block, Details, KeyValues, Listed, Table, budget_table, listed, value_with_uncertainty
from pipelines.experiments.shared import pages
from pipelines.experiments.shared.punch_settings import Punch, Substrate


def punch_rows(punch: Punch | None) -> list[tuple[str, str, str]]:
    """Describe the punch; nothing when the settings name none."""
    if punch is None:
        return []
    return [
        ("tip radius", value_with_uncertainty(punch.radius.value, punch.radius.u, "m"), ""),
        ("period", value_with_uncertainty(punch.period.value, punch.period.u, "m"), ""),
        ("tips", f"{punch.tips}, each {punch.depth.value * 1e3:g} mm long", ""),
    ]


def substrate_name(substrate: Substrate | None) -> str:
    """Return where the material comes from."""
    return "" if substrate is None else substrate.source


def blocks_table(readings: xr.Dataset) -> Table:
    """List the blocks of a file."""
    columns = (
        Listed("block", list(range(1, len(readings["function"]) + 1))),
        Listed("function", [str(f) for f in readings["function"].values]),
        Listed("start", [str(s) for s in readings["start_time"].values]),
        Listed("readings", readings["n_rows"].values.astype(int).tolist()),
    )
    return listed(columns, "Blocks of the file")


def cell(loads: xr.Dataset) -> list[Block]:
    """Show tare, gain and the budget of the largest force."""
    gain, u_gain = float(loads["gain"]), float(loads["u_gain"])
    known = math.isfinite(u_gain)
    rows = [
        ("tare", pages.told(loads, "tare"), "subtracted" if loads.attrs["is_tared"] else "not subtracted"),
        (
            "gain of the load cell",
            value_with_uncertainty(gain, u_gain if known else 0.0),
            "" if known else "as applied by the instrument; its uncertainty is unknown without a calibration record",
        ),
    ]
    blocks: list[Block] = [KeyValues(rows)]
    if loads.attrs["calibration"].startswith("{"):
        blocks.append(pages.calibration_rows(loads.attrs["calibration"]))
    caption = "Budget for the largest force of the file"
    return [*blocks, *budget_table(json.loads(loads.attrs["budget"]), caption, "N")]


def header_blocks(readings: xr.Dataset | None, loads: xr.Dataset | None, name: str) -> list[Block]:
    """Show one file, folded away: its blocks, its load cell and its raw header."""
    inside: list[Block] = []
    if readings is not None:
        inside.append(blocks_table(readings))
    if loads is not None:
        inside += cell(loads)
    header = pages.raw_header(readings)
    shown: list[Block] = [Details(name, inside)] if inside else []
    return [*shown, *([header] if header is not None else [])]
