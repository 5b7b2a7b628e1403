"""One laser export as readings; what it leaves unsaid comes from the settings."""

from pathlib import Path
from typing import Any

import xarray as xr

import instruments
from labpipe.errors import InputError
from pipelines.settings.common import Keyence


def read_laser(path: Path, given: Keyence) -> xr.Dataset:
    """Read one export of a Keyence controller.

    Parameters
    ----------
    path : Path
        The file.
    given : Keyence
        What the session says of it.

    Raises
    ------
    InputError
        The file holds a film.
    """
    options: dict[str, Any] = {
        "cycle": None if given.cycle is None else given.cycle.value,
        "storage_factor": given.storage_factor,
        "units": given.units,
        "encoding": given.encoding,
        "decimal": given.decimal,
    }
    found = instruments.read(
        path, instrument="keyence", **{k: v for k, v in options.items() if v is not None}
    )
    if not isinstance(found, xr.Dataset):
        message = f"{path}: expected a table of readings, found a film"
        raise InputError(message)
    return found
