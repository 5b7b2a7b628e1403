"""Results of a film: displacements relative to the static frames, as a Dataset over (frame, point)."""

from __future__ import annotations

import json
import warnings
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Flags, Floats, Integers
from labpipe.imaging.dic._neighbour_outliers import carried
from labpipe.imaging.dic._occlusion import is_occluded
from labpipe.imaging.dic._periodic_ambiguity import is_ambiguous
from labpipe.imaging.dic._reference import Reference, Status
from labpipe.imaging.dic._tracker import Attempt

if TYPE_CHECKING:
    import xarray as xr

#: Range of the displacement over the static frames (px), median of the points, from which they
#: are not static.
_STATIC_RANGE = 0.3


@dataclass(frozen=True)
class Table:
    """Results of the tracker over (frame, usable point); see :class:`.Attempt`."""

    motion: Floats
    quality: Floats
    covariance: Floats
    hidden: Floats
    iterations: NDArray[np.int32]
    status: NDArray[np.int8]

    @classmethod
    def empty(cls, frames: int, points: int) -> Table:
        """Return a table in which every frame counts as damaged until it is filled in."""
        shape = (frames, points)
        quality, spread = np.full((2, *shape, 4), np.nan)
        status = np.full(shape, Status.FRAME_DAMAGED, np.int8)
        return cls(np.full((*shape, 6), np.nan), quality, spread, np.zeros(shape), np.zeros(shape, np.int32), status)

    def fill(self, row: int, found: Attempt, reference: Reference, min_zncc: float) -> None:
        """Take the results of one frame, and refuse those that cannot be believed."""
        for name in ("motion", "quality", "covariance", "hidden", "iterations"):
            getattr(self, name)[row] = getattr(found, name)
        status = np.where(found.trusted, Status.OK, Status.LOST).astype(np.int8)
        status[is_ambiguous(found.zncc, reference.repetition, min_zncc) & found.trusted] = Status.PERIODIC
        status[np.isnan(found.covariance[:, 0]) & found.trusted] = Status.TEXTURELESS
        status[is_occluded(found.quality[:, 3]) & found.trusted] = Status.OCCLUDED
        status[(found.hidden > 0.0) & ~found.trusted] = Status.COVERED
        status[found.outvoted] = Status.OUTVOTED
        status[found.reached & ~found.trusted] = Status.OUTSIDE
        self.status[row] = status


def make_dataset(
    table: Table,
    reference: Reference,
    time: Floats,
    places: Floats,
    half: Integers,
    indices: Integers,
    wanted: Integers,
    is_static: Flags,
    attrs: dict[str, object],
) -> xr.Dataset:
    """Assemble the Dataset over (frame, point).

    Parameters
    ----------
    table : Table
        Results of all tracked frames.
    reference : Reference
        Reference and status of all points in it.
    time : array of all frames [s]
    places : array (point, 2) [px]
    half : integer array (point,) [px]
    indices, wanted : integer arrays
        Frames that were tracked, and those of them that are asked for.
    is_static : bool array (tracked frame,)
        Frames in which nothing moves.
    attrs : dict
        Attributes.
    """
    import xarray as xr

    motion = table.motion
    turn = np.arctan2(motion[..., 4] - motion[..., 2], 2.0 + motion[..., 1] + motion[..., 5])
    place = np.concatenate([carried(motion, reference.offset), turn[..., None]], axis=-1)
    place -= _origin(place, table.status, is_static)
    rows = np.searchsorted(indices, wanted)
    shape = (len(wanted), len(places))

    def spread(values: NDArray[np.generic], missing: float = np.nan) -> NDArray[np.generic]:
        result = np.full(shape, missing, values.dtype)
        result[:, reference.usable] = values[rows]
        return result

    status = np.tile(reference.status, (shape[0], 1))
    status[:, reference.usable] = table.status[rows]
    valid = status == Status.OK
    gain = np.where(table.quality[..., 0] > 0.0, table.quality[..., 0], np.nan)
    texts = {
        "dx": (place[..., 0], "px", "displacement to the right"),
        "dy": (place[..., 1], "px", "displacement downwards"),
        "rotation": (place[..., 2], "rad", "rotation from x towards y"),
        "u_dx": (np.sqrt(table.covariance[..., 0]), "px", "standard uncertainty of the displacement to the right"),
        "u_dy": (np.sqrt(table.covariance[..., 1]), "px", "standard uncertainty of the displacement downwards"),
        "u_rotation": (np.sqrt(table.covariance[..., 3]), "rad", "standard uncertainty of the rotation"),
        "cov_dx_dy": (table.covariance[..., 2], "px2", "covariance of the two displacements"),
        "stretch_x": (np.hypot(1.0 + motion[..., 1], motion[..., 4]) - 1.0, "1", "relative growth of the rows"),
        "stretch_y": (np.hypot(motion[..., 2], 1.0 + motion[..., 5]) - 1.0, "1", "relative growth of the columns"),
    }
    dims = ("frame", "point")
    variables: dict[str, tuple[tuple[str, str], NDArray[np.generic], dict[str, object]]] = {}
    for name, (values, units, text) in texts.items():
        kept = np.where(valid, spread(values), np.nan)
        variables[name] = (dims, kept, {"units": units, "long_name": text})
    # the hypotenuse of a rotation is 1 but for rounding
    for name in ("stretch_x", "stretch_y"):
        variables[name][1][np.abs(variables[name][1]) < 1e-9] = 0.0
    plain = {
        "zncc": (spread(table.quality[..., 2]), "zero-normalised cross-correlation"),
        "contrast": (spread(1.0 / gain), "contrast of the pattern over that of the reference"),
        "iterations": (spread(table.iterations, 0), "evaluations of the subset"),
        "hidden": (spread(table.hidden, 0.0), "share of the subset behind stated obstructions"),
        "valid": (valid, "there is a displacement"),
        "status": (status, "reason why there is a displacement or none"),
    }
    for name, (values, text) in plain.items():
        variables[name] = (dims, values, {"units": "1", "long_name": text})
    variables["status"][2]["flag_values"] = [int(code) for code in Status]
    variables["status"][2]["flag_meanings"] = " ".join(code.name.lower() for code in Status)
    pixel = {"units": "px"}
    coordinates = {
        "frame": ("frame", wanted, {"units": "1", "long_name": "frame of the film"}),
        "time": ("frame", time[wanted], {"units": "s", "long_name": "time"}),
        "point": ("point", np.arange(len(places)), {"units": "1", "long_name": "point"}),
        "x": ("point", places[:, 0], pixel | {"long_name": "column of the point"}),
        "y": ("point", places[:, 1], pixel | {"long_name": "row of the point"}),
        "subset": ("point", 2 * half + 1, pixel | {"long_name": "width of the subset"}),
    }
    attrs = attrs | {"work": json.dumps(attrs["work"])}
    return xr.Dataset(variables, coordinates, attrs)


def _origin(place: Floats, status: NDArray[np.int8], is_static: Flags) -> Floats:
    """Mean (point, 3) of the motion over the static frames, with a warning where they move; unseen points are lost."""
    seen = is_static[:, None] & (status == Status.OK)
    count = seen.sum(axis=0)
    without = count == 0
    status[:, without] = np.where(status[:, without] == Status.OK, Status.LOST, status[:, without])
    origin = np.where(seen[..., None], place, 0.0).sum(axis=0) / np.maximum(count, 1)[:, None]
    whole = count == is_static.sum()
    if is_static.sum() > 1 and whole.any():
        spread = float(np.median(np.ptp(place[is_static][:, whole, :2], axis=0).max(axis=1)))
        if spread > _STATIC_RANGE:
            warnings.warn(
                f"the {int(is_static.sum())} static frames move by {spread:.2f} px, so that their mean is a "
                "blurred reference: take fewer static frames",
                UserWarning,
                stacklevel=4,
            )
    return np.asarray(origin)
