"""Image scale of a camera view, and conversion of motion in pixels to metres.

A scale belongs to ONE view. The record of another view is refused: between the front camera and
the one under the disc of the thesis, the mistake would be a factor of 36 (appendix D).
"""

import json
import math
from datetime import date
from typing import Any, cast

import xarray as xr

from calibration.record import CameraRecord, Record, require
from labpipe.errors import InputError
from labpipe.uncertainty import Source, budget_rows, combined_uncertainty
from labpipe.units import Quantity
from labpipe.variables import with_u

__all__ = ["image_scale", "motion", "pixel_size"]


def pixel_size(reference_length: Quantity, pixel_length: Quantity) -> Quantity:
    """Length of one pixel [m/px], from a length [m] and the pixels [px] that it spans (thesis D.1).

    Raises InputError where one of them is not positive, or not finite.

    Examples
    --------
    >>> size = pixel_size(Quantity(30e-3, 0, "m"), Quantity(386, 1.5, "px"))
    >>> round(size.value * 1e3, 5), round(size.u / size.value * 100, 2)
    (0.07772, 0.39)
    """
    if not (0.0 < reference_length.value < math.inf and 0.0 < pixel_length.value < math.inf):
        message = f"lengths must be positive and finite, found {reference_length.value} m and {pixel_length.value} px"
        raise InputError(message)
    value = reference_length.value / pixel_length.value
    relative = math.hypot(reference_length.u / reference_length.value, pixel_length.u / pixel_length.value)
    return Quantity(value, value * relative, "m/px")


def image_scale(
    record: Record, view: str, *, measured: str | date | None = None, recorded: str = ""
) -> tuple[Quantity, dict[str, Any]]:
    """Return the length of one pixel [m/px] of a view, and the checks that were made with the budget of the scale.

    ``recorded`` is the day that the film itself says, as ISO text; "" where it says none. The other arguments, and the
    errors, are those of :func:`calibration.record.require`.
    """
    checked = require(record, "camera", {"start": recorded}, measured=measured, view=view)
    values = cast("CameraRecord", record).values
    if values.scale is not None:
        size, sources = values.scale, [Source.of("scale", values.scale, 1.0)]
    else:
        length, pixels = cast("Quantity", values.reference_length), cast("Quantity", values.pixel_length)
        size = pixel_size(length, pixels)
        sources = [
            Source.of("reference length", length, 1 / pixels.value),
            Source.of("pixel distance", pixels, size.value / pixels.value),
        ]
    if values.out_of_plane is not None:
        sources.append(Source("out of plane", 0.0, values.out_of_plane.u, "1", size.value, "systematic"))
    tilt = None if values.tilt is None else values.tilt.value
    checked |= {"view": record.view, "budget": budget_rows(sources), "tilt": tilt}
    return Quantity(size.value, combined_uncertainty(sources), "m/px"), checked


def motion(track: xr.Dataset, record: Record, *, view: str, measured: str | date | None = None) -> xr.Dataset:
    """Turn displacements in pixels into metres, upwards positive.

    Parameters
    ----------
    track : Dataset (frame, point)
        ``dx``, ``dy`` [px] with ``u_dx``, ``u_dy``, as :func:`labpipe.imaging.track` returns; attribute
        ``recorded``: the day that the film itself says, where it does.
    record : Record
        Of the kind ``camera``.
    view : str
        The view of the film.
    measured
        See :func:`calibration.record.require`.

    Returns
    -------
    Dataset (frame, point)
        ``displacement_x`` and ``displacement_y`` [m], the latter upwards, with random ``u_``;
        scalar ``pixel_size`` [m/px] with ``u_``; attributes ``u_systematic_relative``,
        ``budget`` and ``calibration``.

    Raises
    ------
    CalibrationError
        The record is of another kind, view or time.
    InputError
        The track has no displacements.
    """
    for name in ("dx", "dy", "u_dx", "u_dy"):
        if name not in track:
            raise InputError(f'the track has no "{name}"; expected the result of labpipe.imaging.track')
    day = str(track.attrs.get("recorded", ""))
    size, checked = image_scale(record, view, measured=measured, recorded=day)
    result = track.drop_vars(["dx", "dy", "u_dx", "u_dy"])
    # image rows count downwards, heights upwards
    for axis, sign, text in (("x", 1.0, "to the right"), ("y", -1.0, "upwards")):
        moved = sign * size.value * track[f"d{axis}"]
        random = size.value * track[f"u_d{axis}"]
        result[f"displacement_{axis}"] = moved.assign_attrs(units="m", long_name=f"displacement {text}")
        result[f"u_displacement_{axis}"] = random.assign_attrs(
            units="m", long_name=f"standard uncertainty (random): displacement {text}"
        )
    result = result.assign(with_u("pixel_size", (), size.value, size.u, "m/px", "length of one pixel"))
    result.attrs["u_systematic_relative"] = size.u / size.value
    result.attrs["budget"] = json.dumps(checked.pop("budget"))
    result.attrs["calibration"] = json.dumps(checked, ensure_ascii=False)
    return result
