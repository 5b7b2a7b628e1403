"""What lies in a session's store, to compare two runs."""

import json
from pathlib import Path

import xarray as xr

from labpipe import files


def results(folder: Path) -> dict[str, bytes]:
    """Return every stored netCDF file by its name."""
    root = folder / "labpipe/store"
    return {p.relative_to(root).as_posix(): p.read_bytes() for p in root.glob("??/*.nc")}


def without_commit(path: Path) -> xr.Dataset:
    """Return a result without the commit of the program: somebody may commit between two runs."""
    found = files.read_dataset(path)
    provenance = json.loads(found.attrs["provenance"])
    provenance["program"].pop("git")
    return found.assign_attrs(provenance=provenance)


def assert_same(one: Path, other: Path) -> None:
    """Fail unless two sessions hold the same results, byte for byte within one commit."""
    ours, theirs = results(one), results(other)
    assert set(ours) == set(theirs)
    for name, data in ours.items():
        if data != theirs[name]:
            xr.testing.assert_identical(*(without_commit(at / "labpipe/store" / name) for at in (one, other)))
