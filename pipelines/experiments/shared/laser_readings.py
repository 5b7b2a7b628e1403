"""Readings of one laser export; what the file omits comes from the settings."""

from pathlib import Path
from typing import Protocol

import xarray as xr

import instruments
from labpipe.errors import UNSAID, SourceError
from pipelines.experiments.shared.settings import Keyence, named_columns


class _Recorded(Protocol):
    """Settings of an experiment that a laser records."""

    @property
    def keyence(self) -> Keyence: ...


def readings(path: Path, *, settings: _Recorded) -> xr.Dataset:
    """Read one laser export, as a stage of every kind that has one."""
    return read_laser(path, settings.keyence)


def read_laser(path: Path, given: Keyence) -> xr.Dataset:
    """Read one export of a laser sensor, with what the session says of it.

    Raises
    ------
    InputError
        The file holds a film.
    """
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
        raise _with_place(error) from None


def _with_place(error: SourceError) -> SourceError:
    """Add where a session says what the file leaves unsaid."""
    if error.reason != UNSAID:
        return error
    example = 'keyence = { cycle = "50 us", storage_factor = 1, units = ["mm"] }'
    place = {"line": error.line, "column": error.column, "offset": error.offset}
    hint = f"{error.hint} In session.toml, for the experiment: {example}."
    return SourceError(error.path, error.message, **place, hint=hint).because(UNSAID)
