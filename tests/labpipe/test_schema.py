"""A schema names everything that does not fit, at once."""

import numpy as np
import pytest
import xarray as xr

from labpipe.errors import InputError
from labpipe.schema import Schema, Variable, check

SCHEMA = Schema("motion", {"z": Variable(("time",), "m")})


def dataset(**changes: object) -> xr.Dataset:
    attrs = {"units": "m", "long_name": "position"}
    return xr.Dataset({"z": ("time", np.zeros(3), attrs), **changes})


def test_what_fits_is_returned_unchanged_and_all_that_does_not_is_named_at_once() -> None:
    fits = dataset(noise=((), 1.0, {"units": "m", "long_name": "further ones may be there"}), name=((), "text"))
    assert check(fits, SCHEMA) is fits
    with pytest.raises(InputError) as caught:
        check(xr.Dataset({"u_y": ((), 1.0)}), SCHEMA)
    assert str(caught.value).count(";") == 3


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        (dataset().drop_vars("z"), 'variable "z" is missing'),
        (dataset().rename(time="frame"), "has dimensions"),
        (dataset().assign(z=("time", np.zeros(3), {"units": "mm", "long_name": "z"})), 'is in "mm", expected "m"'),
        (dataset(x=((), 1.0)), '"x" carries no units; "x" carries no long_name'),
        (dataset(u_x=((), 1.0, {"units": "m", "long_name": "u"})), 'stands without "x"'),
    ],
)
def test_what_does_not_fit_is_named(wrong: xr.Dataset, says: str) -> None:
    with pytest.raises(InputError, match=says):
        check(wrong, SCHEMA)
