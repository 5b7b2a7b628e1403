"""What lies in a session's store, to compare two runs."""

import json
from pathlib import Path
from typing import Any

import netCDF4


def results(folder: Path) -> dict[str, bytes]:
    """Return every stored netCDF file by its name."""
    root = folder / "labpipe/store"
    return {p.relative_to(root).as_posix(): p.read_bytes() for p in root.glob("??/*.nc")}


def without_commit(data: bytes) -> dict[str, Any]:
    """Return all that a netCDF file holds, but for the commit of the program that wrote it.

    Two processes see two commits when somebody commits between them; nothing else may differ.
    """
    with netCDF4.Dataset("memory.nc", memory=data) as opened:
        opened.set_auto_maskandscale(False)
        attributes = {name: opened.getncattr(name) for name in opened.ncattrs()}
        provenance = json.loads(attributes.pop("provenance"))
        provenance["program"].pop("git")
        variables = {
            name: (
                variable.dimensions,
                str(variable.dtype),
                {key: repr(variable.getncattr(key)) for key in variable.ncattrs()},
                variable[...].tobytes() if variable.dtype is not str else list(variable[...].flat),
            )
            for name, variable in opened.variables.items()
        }
    return {
        "attributes": {name: repr(value) for name, value in attributes.items()},
        "provenance": provenance,
        "variables": variables,
    }


def assert_same(one: Path, other: Path) -> None:
    """Fail unless two sessions hold the same results, byte for byte within one commit."""
    ours, theirs = results(one), results(other)
    assert set(ours) == set(theirs)
    for name, data in ours.items():
        if data != theirs[name]:
            assert without_commit(data) == without_commit(theirs[name]), name
