"""Datasets as netCDF-4: types that can be stored, and the checks on writing and reading.

Every chunk carries a Fletcher-32 checksum, but attributes, scalars, text and the file's own tables do not, and a
single wrong bit in those can crash the HDF5 library. So the file ends with a mark and the SHA-256 of all bytes before
it, compared before the library sees the file; HDF5 and every netCDF program pass over bytes behind the end of data.
"""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import xarray as xr

from labpipe.errors import InputError, StoreError

_MARK = b"labpipe1"
_TRAILER = len(_MARK) + hashlib.sha256().digest_size
_SLACK = 1 << 20
"""Bytes that may be declared beyond the file's size: small variables that were never written."""
_LARGEST_RATIO = 1100
"""Deflate compresses by at most 1032; a compressed file that declares more is not one."""


def prepare(dataset: xr.Dataset) -> xr.Dataset:
    """Return a copy that netCDF gives back unchanged: no encoding, JSON text where needed."""
    clean = dataset.drop_encoding()
    variables = {}
    for name in {**clean.variables, **clean.sizes}:
        if not isinstance(name, str) or not name or "/" in name:
            raise InputError(f"the name of a variable or dimension must be text without a slash, found {name!r}")
    for name, variable in clean.variables.items():
        values = variable.values
        kind = values.dtype.kind
        if kind in "OUT" and all(isinstance(item, str) for item in values.ravel().tolist()):
            values = np.array([_text(item) for item in values.ravel().tolist()], dtype=str).reshape(values.shape)
        elif kind not in "fiub" or values.dtype.itemsize > 8 or values.dtype == np.float16:
            found = "Python objects" if kind == "O" else f"values of type {values.dtype}"
            raise InputError(
                f'variable "{name}" holds {found}; store float32, float64, integers, booleans or text '
                "(times as numbers in s, complex numbers as two)"
            )
        else:
            values = values.astype(values.dtype.newbyteorder("="), copy=False)
        variables[name] = xr.Variable(variable.dims, values, _attributes(variable.attrs))
    coordinates = {name: variables.pop(name) for name in clean.coords}
    return xr.Dataset(variables, coordinates, _attributes(clean.attrs))


def _attributes(attributes: Mapping[Any, Any]) -> dict[str, Any]:
    """Return attributes as netCDF gives them back: text, numbers, arrays of one type, and JSON text of all else."""
    made = {}
    for name, given in attributes.items():
        value = given.tolist() if isinstance(given, np.ndarray | np.generic) else given
        if isinstance(given, np.ndarray) and given.ndim == 1 and given.size > 1 and given.dtype.kind in "iuf":
            value = given  # flags have the type of their variable
        elif isinstance(value, str):
            value = _text(str(value))
        elif isinstance(value, list | tuple) and len(value) > 1 and {*map(type, value)} in ({int}, {float}):
            value = np.asarray(value)  # a mixture would come back changed
        elif isinstance(value, bool) or not isinstance(value, int | float):
            try:
                value = json.dumps(value, ensure_ascii=False, sort_keys=True)
            except (TypeError, ValueError):
                raise InputError(f'attribute "{name}" holds {type(value).__name__}, which cannot be stored') from None
        made[str(name)] = value
    return made


def _text(text: str) -> str:
    """Text as netCDF keeps it: NUL would end it, and half a surrogate pair has no UTF-8."""
    return text.replace("\0", "\u2400").encode("utf-8", "replace").decode("utf-8")


def write(path: Path, prepared: xr.Dataset) -> xr.Dataset:
    """Write a prepared Dataset with checksums and NaN as it is, and its digest; return the Dataset read back.

    Raises InputError: that differs from the prepared one.
    """
    form: dict[str, dict[str, Any]] = {str(name): {"_FillValue": None} for name in prepared.variables}
    for name, variable in prepared.variables.items():
        form[str(name)]["fletcher32"] = variable.ndim > 0 and variable.size > 0 and variable.dtype.kind != "U"
    prepared.to_netcdf(path, engine="netcdf4", encoding=form)
    with path.open("r+b") as stream:  # a digest of what the disk holds, to its end
        stream.write(_MARK + hashlib.file_digest(stream, "sha256").digest())
    try:
        found = decode(path.read_bytes())
    except Exception as error:  # the libraries answer damage with anything
        raise RuntimeError(f"what was written cannot be read back: {error}") from error
    types = ({n: v.dtype for n, v in each.variables.items() if v.dtype.kind != "U"} for each in (found, prepared))
    if not found.identical(prepared) or next(types) != next(types):
        raise InputError("the Dataset holds something that netCDF does not store unchanged")
    return found


def decode(data: bytes) -> xr.Dataset:
    """Return the Dataset of the bytes of a file, after comparing their digest, and the declared sizes with their own.

    Raises StoreError: they have changed, or cannot be true; what the libraries raise of others is anything.
    """
    body, trailer = data[:-_TRAILER], data[-_TRAILER:]
    # A mark at another place than its own means that bytes were cut off or added behind it; others' files have none.
    if _MARK in data[-2 * _TRAILER :] and trailer != _MARK + hashlib.sha256(body).digest():
        raise StoreError("its contents do not match its digest")
    with netCDF4.Dataset("its bytes", memory=data) as handle:
        declared, is_compressed = 0, False
        for variable in handle.variables.values():
            item = 1 if variable.dtype is str else np.dtype(variable.dtype).itemsize
            declared += int(np.prod([int(n) for n in variable.shape], dtype=object)) * item
            filters: Mapping[str, Any] = variable.filters()
            is_compressed |= any(bool(filters.get(f)) for f in ("zlib", "zstd", "bzip2", "szip"))
        if declared > len(data) * (_LARGEST_RATIO if is_compressed else 1) + _SLACK:
            raise StoreError(f"it declares {declared} bytes of data but is {len(data)} bytes long")
        source = xr.backends.NetCDF4DataStore(handle)  # type: ignore[no-untyped-call]
        # packed values and times of other programs are not converted
        found = xr.open_dataset(source, mask_and_scale=False, decode_times=False).load().drop_encoding()
    return found.assign({name: one.astype(str) for name, one in found.variables.items() if one.dtype.kind == "O"})
