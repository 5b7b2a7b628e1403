"""Readings of one laser export; statements that the file omits come from the settings."""

import json
from pathlib import Path
from typing import Any

import xarray as xr

import calibration
import instruments
from calibration import laser
from labpipe.errors import UNSAID, SourceError
from pipelines.experiments.shared.exclusions import left_out, without_readings
from pipelines.experiments.shared.record_checks import without_held
from pipelines.experiments.shared.settings import Keyence, named_columns

OUTLIER = 7
"""Status of a reading that deviates from those around it, beyond the states that a controller writes."""


def readings(path: Path, *, settings: Any) -> xr.Dataset:
    """Read one laser export, as a stage of every kind that has one; outliers become NaN and :data:`OUTLIER`.

    The attribute ``outliers`` holds, as JSON and by output, first and last index and largest deviation [m or V] of
    each run.
    """
    return without_outliers(without_readings(read_laser(path, settings.keyence), settings, "out"))


def without_outliers(readings: xr.Dataset, *, ends: bool = True) -> xr.Dataset:
    """Leave out short runs of readings that leave a record and return to it; see :func:`labpipe.signals.outliers`."""
    made, runs = readings.copy(), {}
    for output in (str(name) for name in readings if str(name).startswith("out")):
        state = output.replace("out", "status")
        values = readings[output].where(readings[state] == 0 if state in readings else True).values.astype(float)
        flags, found = left_out(values, readings["time"].values, ends=ends)
        if found:
            runs[output] = found
            made[output] = readings[output].where(~flags)
        if found and state in readings:
            made[state] = readings[state].where(~flags, OUTLIER).astype(readings[state].dtype)
    return made.assign_attrs(outliers=json.dumps(runs)) if runs else readings


def read_laser(path: Path, given: Keyence) -> xr.Dataset:
    """Read one export of a laser sensor, with the statements of the session."""
    try:
        return instruments.read_table(
            path,
            "displacement",
            "keyence",
            cycle=None if given.cycle is None else given.cycle.value,
            storage_factor=given.storage_factor,
            units=given.units,
            encoding=given.encoding,
            decimal=given.decimal,
            columns=named_columns(given.columns),
        )
    except SourceError as error:
        if error.reason != UNSAID:
            raise
        example = 'keyence = { cycle = "50 us", storage_factor = 1, units = ["mm"] }'
        place = {"line": error.line, "column": error.column, "offset": error.offset}
        hint = f"{error.hint} In session.toml, for the experiment: {example}."
        raise SourceError(error.path, error.message, **place, hint=hint).because(UNSAID) from None


def displacement(readings: xr.Dataset, record: Path, *, settings: Any, **options: Any) -> xr.Dataset:
    """Correct the inclination, as a stage: upward displacement with its uncertainty.

    ``options`` of :func:`calibration.laser.displacement` replace those of the settings.
    """
    sensor = settings.sensor
    if sensor.serial is not None:
        readings = readings.assign_attrs(serial=sensor.serial)
    readings = without_held(readings, sensor.output)
    chosen = {"output": sensor.output, "direction": sensor.direction, "measured": settings.measured_on} | options
    return laser.displacement(readings, calibration.load_record(record), **chosen)
