"""The command inspect: what a file is, what it holds, and what is wrong with it."""

import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from pipelines.commands.options import echo, echo_json, json_option

if TYPE_CHECKING:
    import xarray as xr

    from labpipe.frames import FrameSource


@click.command()
@click.argument("file", type=click.Path(exists=True, path_type=Path))
@click.option("--cycle", help='Keyence: time between stored points, e.g. "50 us".')
@click.option("--unit", "units", multiple=True, help="Keyence: unit of each output, in order.")
@json_option
def inspect(file: Path, cycle: str | None, units: tuple[str, ...], as_json: bool) -> None:
    r"""Say what FILE is: instrument, columns, units, ranges, sampling, problems.

    Works on any single file of a known instrument; nothing is written.

    \b
    Example:
      labpipe inspect my-session/laser/drop_1.csv
    """
    found = describe(file, cycle, list(units))
    if as_json:
        echo_json(found)
        return
    for key, value in found.items():
        if key not in {"variables", "problems"}:
            text = f"{value:.6g}" if isinstance(value, float) else str(value)
            echo(f"{key:18}{text}")
    for row in found.get("variables", []):
        span = f"{row['min']:.6g} … {row['max']:.6g}" if row["min"] is not None else "no value"
        invalid = f", {row['invalid']} invalid" if row["invalid"] else ""
        echo(f"  {row['name']:24}{row['units']:8}{span}{invalid}")
    for line in found["problems"] or ["none found"]:
        echo(f"problem: {line}")


def describe(
    file: Path, cycle: str | None = None, units: list[str] | None = None
) -> dict[str, Any]:
    """Return what is known of a file, as plain values.

    Parameters
    ----------
    file : Path
        A file of a known instrument.
    cycle, units : optional
        What a Keyence export leaves unsaid.

    Raises
    ------
    SourceError
        The file is not known or cannot be read.
    """
    import xarray as xr

    import instruments

    name = instruments.identify(file)
    options: dict[str, Any] = {}
    if name == "keyence":
        options = {k: v for k, v in (("cycle", cycle), ("units", units)) if v}
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        source = instruments.read(file, **options)
        is_table = isinstance(source, xr.Dataset)
        found = _table(source) if isinstance(source, xr.Dataset) else _film(source)
    head = {"file": str(file), "reader": name, "bytes": file.stat().st_size}
    problems = [str(w.message) for w in caught] + found.pop("problems", [])
    return head | {"kind": "table" if is_table else "film"} | found | {"problems": problems}


def _table(dataset: "xr.Dataset") -> dict[str, Any]:
    import numpy as np

    rows = []
    for name, variable in dataset.variables.items():
        if variable.dtype.kind not in "fiu" or variable.size == 0:
            continue
        values = np.asarray(variable.values, float)
        finite = values[np.isfinite(values)]
        rows.append(
            {
                "name": str(name),
                "units": str(variable.attrs.get("units", "")),
                "min": float(finite.min()) if finite.size else None,
                "max": float(finite.max()) if finite.size else None,
                "invalid": int(values.size - finite.size),
            }
        )
    known = ("instrument", "model", "start", "sampling_interval", "layout", "encoding")
    return (
        {key: dataset.attrs[key] for key in known if key in dataset.attrs}
        | {"sizes": ", ".join(f"{k} {v}" for k, v in dataset.sizes.items())}
        | {"variables": rows}
    )


def _film(frames: "FrameSource") -> dict[str, Any]:
    import numpy as np

    count, rows, columns = frames.shape
    time, valid = frames.time, frames.valid
    problems = list(getattr(getattr(frames, "time_axis", None), "warnings", ()))
    if not valid.all():
        problems.append(f"{int((~valid).sum())} of {count} frames are damaged")
    interval = float(np.median(np.diff(time))) if count > 1 else float("nan")
    exposure = frames.exposure
    return {
        "frames": count,
        "image": f"{columns} × {rows} px",
        "interval": f"{interval:.6g} s",
        "time": f"{time[0]:.6g} … {time[-1]:.6g} s from the trigger",
        "exposure": "unknown" if exposure is None else f"{np.nanmedian(exposure):.3g} s",
        "levels": f"{frames.levels[0]:g} black, {frames.levels[1]:g} white",
        "problems": problems,
    }
