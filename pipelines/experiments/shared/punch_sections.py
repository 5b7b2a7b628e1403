"""Sections that the reports of indentations share."""

import math
from typing import Any

from labpipe.arrays import Floats
from labpipe.report import Block, Details, KeyValues, Listed, Section, listed, value_with_uncertainty
from labpipe.workflow.context import Context
from pipelines.experiments.shared import pages
from pipelines.experiments.shared.punch_model import NOTHING_NAMED
from pipelines.experiments.shared.punch_settings import Indentation
from pipelines.experiments.shared.reports import is_there


def without_model(settings: Indentation) -> list[tuple[str, str, str]]:
    """Return why nothing is compared with a model, as a row of the summary."""
    is_named = settings.punch is not None and settings.substrate is not None
    return [] if is_named else [("model", "none", NOTHING_NAMED)]


def simulated_by(errors: Floats) -> str:
    """Write how the force was simulated, and the errors (test,), for a manuscript."""
    return (
        "The force was simulated by periodic boundary elements with the measured displacement; the normalised "
        f"root-mean-square error was {pages.spanned(100 * errors, '.2f')} %."
    )


def measured(settings: Any, context: Context, readings: Any = None, loads: Any = None, model: Any = None) -> Section:
    """Show the punch, the model and every file: its blocks, its load cell and its raw header, folded away.

    Results are those of one file, or one for each of several.
    """
    files = [settings.mach1] if isinstance(settings.mach1, str) else settings.mach1
    given = (readings, loads, model)
    read, tared, models = (one if isinstance(one, list | tuple) else [one] * len(files) for one in given)
    made = next((one for one in models if one is not None and is_there(one)), None)
    punch, rows = settings.punch, [("file" if len(files) == 1 else "files", ", ".join(files), "")]
    if punch is not None:
        rows += [
            ("tip radius", pages.stated(punch.radius), settings.model.profile),
            ("period", pages.stated(punch.period), ""),
            ("tips", f"{punch.tips}, each {punch.depth.value * 1e3:g} mm long", ""),
        ]
    rows += pages.remarks(context)
    if made is not None and settings.substrate is not None:
        rows += [
            ("material", settings.substrate.source, ""),
            ("solver", made.attrs["solver"], ""),
            ("datum of displacement", made.attrs["datum"], ""),
        ]
    blocks: list[Block] = [KeyValues([row for row in rows if row[1]])]
    for name, raw, force in zip(files, read, tared, strict=True):
        inside: list[Block] = []
        if raw is not None:
            of_blocks = {"function": "function", "start_time": "start", "n_rows": "readings"}
            columns = [Listed(title, raw[name].values.tolist()) for name, title in of_blocks.items()]
            numbers = Listed("block", list(range(1, raw.sizes["block_index"] + 1)))
            inside.append(listed((numbers, *columns), "Blocks of the file"))
        if force is not None:
            gain, u_gain, record = float(force["gain"]), float(force["u_gain"]), force.attrs["calibration"]
            unknown = "as applied by the instrument; its uncertainty is unknown without a calibration record"
            shown = value_with_uncertainty(gain, u_gain if math.isfinite(u_gain) else 0.0)
            cell = [
                ("tare", pages.told(force, "tare"), "subtracted" if force.attrs["is_tared"] else "not subtracted"),
                ("gain of the load cell", shown, "" if math.isfinite(u_gain) else unknown),
            ]
            inside += [KeyValues(cell), *([pages.calibration_rows(record)] if record.startswith("{") else [])]
        blocks += [Details(name, inside)] if inside else []
        blocks += [] if raw is None else pages.raw_headers([raw])
    return pages.folded("What was measured, and its calibration", "File, punch and calibration record", blocks)
