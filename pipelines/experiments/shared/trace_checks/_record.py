"""Checks of what a calibration record states of the sensor."""

from collections.abc import Mapping
from math import pi

import numpy as np
import xarray as xr

from labpipe.judging import Check, Level, in_words, not_made, stated
from pipelines.experiments.shared.judgements import day_known

_OBLIQUE = pi / 4  # between line of sight and motion: no makers' sensor sees its spot from further aside
_VAGUE = pi / 60  # u of an inclination: what was measured, even by eye, is known better
_UNKNOWN = 0.2  # relative u of a calibrated length, beyond which it was not calibrated


def of_record(displacements: Mapping[str, xr.Dataset | None], record: str) -> list[Check]:
    """Check what a calibration record states of the sensor that gave the displacements of some recordings."""
    known = {name: each for name, each in displacements.items() if each is not None}
    first = next(iter(known.values()), None)
    days = [day_known(each, record, name) for name, each in known.items()] or [day_known(None, record)]
    worst = min(days, key=lambda check: ("doubtful", "note", None).index(check.level))
    return [sight(first, record), scale_known(first, record), worst]


def sight(displacement: xr.Dataset | None, record: str) -> Check:
    """Hold the inclination that a calibration record states against what a sensor can see.

    Where nothing falls freely no acceleration tells the cosine, and lengths alone would carry it.
    """
    name, law = "line of sight", "a triangulation sensor looks along the motion it measures, not from aside"
    if displacement is None or "inclination" not in displacement:
        return not_made(name, law, "a displacement")
    angle, u = float(displacement["inclination"]), float(displacement["u_inclination"])
    text = f"{record}: inclination ({np.rad2deg(angle):.3g} ± {np.rad2deg(u):.2g})°, lengths are divided by its cosine"
    level: Level | None = "doubtful" if angle > _OBLIQUE or u > _VAGUE else None
    cause = (
        f"u of the inclination in {record} is probably not {np.rad2deg(u):.2g}°: a lost decimal, or another unit"
        if u > _VAGUE
        else f"inclination in {record} is probably not {np.rad2deg(angle):.3g}°: a lost decimal point, or the angle to "
        "the plate in place of that to the motion"
    )
    return stated(name, law, text, level, cause=cause, file=record, setting="values.inclination")


def scale_known(displacement: xr.Dataset | None, record: str) -> Check:
    """Hold the uncertainty of a calibrated length against what a calibration is for."""
    name, law = "uncertainty of the scale", "a calibration tells lengths far better than the eye does"
    if displacement is None or not (relative := float(displacement.attrs.get("u_systematic_relative", 0.0))):
        return not_made(name, law, "a displacement, and the uncertainty of its scale")
    text = f"{record}: lengths are known by {in_words(100 * relative, 2)} %"
    level: Level | None = "doubtful" if relative > _UNKNOWN else None
    cause = f"u of the scale, or of the inclination, in {record} was typed in another unit or with a lost decimal"
    return stated(name, law, text, level, cause=cause, file=record, setting="values.scale")
