"""Checks of a plate vibration: one plate in all recordings, and blows as stated.

Frequency and damping belong to the plate, so all recordings give the same. The amplitude says how
much momentum came: a height or a material that is stated wrongly moves that of its drops alone.
"""

from collections.abc import Iterator
from dataclasses import replace
from math import hypot, inf, log, nan
from typing import Any

import numpy as np
import xarray as xr

from labpipe import signals
from labpipe.judging import SLIPS, Cause, Check, bounded, compared, not_made
from labpipe.report import quantity
from labpipe.units import Quantity
from labpipe.workflow.context import Context
from pipelines.experiments.plate_vibration.comparison import HEIGHT, SERIES, amplitudes, from_others, rows
from pipelines.experiments.plate_vibration.measured import drops_label
from pipelines.experiments.plate_vibration.model import relative_uncertainty
from pipelines.experiments.plate_vibration.settings import PlateVibration
from pipelines.experiments.shared import fall_checks, judgements, record_checks
from pipelines.experiments.shared.fall_checks import Fall, Repeated
from pipelines.experiments.shared.given import Given
from pipelines.experiments.shared.judgements import Scene, Title

_MOMENTUM = 0.03
"""Relative standard uncertainty of the momentum of an impact, which goes with 1 + e, for a solid known by its name or
its DMA."""
_INTERVAL = 0.05  # relative, within which frequencies differ by a factor of sampling intervals
_PLATES = (0.3, 3e3)  # kg, modal masses of what spheres are dropped on in a laboratory
_MOMENTUM_OF, _WAY, _BLOWS = "momentum of the blow", "direction of the first motion", "later blows"
_COUNTED = 0.3  # of the largest blow; of smaller ones several fall into one period
_STATED = (
    "what falls is stated wrongly: sphere.mass, or a height, or the material of one of the drops; or a file is of "
    "another drop"
)
_AMPLITUDE = (Repeated("amplitude", "amplitude at impact", "m"),)
_OF_ONE_PLATE = (
    Repeated("natural_frequency", "frequency of the plate", "Hz", 5e-3, 5e-3),
    Repeated("damping_ratio", "damping of the plate", "1", 0.2, 0.2),
)
"""A frequency changes a little when a plate is touched or warmed; damping depends on its support and the amplitude."""
_ANOTHER_PLATE = (
    "something else struck plate or table, the plate was changed, the sampling interval of this file is not what it "
    "says, or it is of another plate"
)
_FAILED = record_checks.CAUSES | {
    "ringing": "the recording holds no ringing plate: the wrong channel or file, a blow before the recording began, "
    "something else that struck plate or table shortly before or after the body, a recording that ends too soon, or a "
    "sampling interval that is stated wrongly"
}
_STEPS = ("readings", "displacement", "ringing", "table", "plate", "comparison")
TITLES = {
    "one plate": Title(
        "All recordings show one plate, of one frequency and damping, that a bouncing body strikes from above.",
        ("repeats: frequency of the plate", "repeats: damping of the plate", "modal mass of the plate", _WAY, _BLOWS),
    ),
    "momentum of the blow": Title(
        "Momentum over amplitude and frequency gives one modal mass for all drops.", (_MOMENTUM_OF,)
    ),
    "repeats": Title("Repeats agree within their scatter.", ("repeats",)),
    **record_checks.OF_LASER,
}


@judgements.judging(*_STEPS, rests_on=("drops.material_from",), titles=TITLES)
def judgement(given: Given, basis: judgements.Basis, settings: PlateVibration, context: Context) -> Scene:
    """Judge one plate vibration; a step without a result is judged by its error."""
    readings, displacement, ringing, table, plate, *_ = map(given.get, _STEPS)
    names = [name for drops in settings.drops for name in drops.laser]
    read, moved, found = (
        {n: one for n, one in zip(names, each or (), strict=False) if one is not None}
        for each in (readings, displacement, ringing)
    )
    body = settings.sphere
    of_traces, checks = record_checks.of_recordings(read, moved, {}, settings, context, _FAILED)
    checks += of_traces
    of_body = not_made("mass of the falling body", "a sphere with its mass")
    of_body = of_body if body is None else fall_checks.body_stated(body.radius.value, body.mass.value)
    checks.append(of_body)
    # what repeats share is taken out: their scatter alone is asked
    rings = {name: Fall(name, ring, 0.0) for name, ring in found.items()}
    for name, ring in found.items():
        checks += _course(name, moved[name], ring)
    for check in fall_checks.repeats_agree([*rings.values()], _OF_ONE_PLATE, _ANOTHER_PLATE):
        cause = check.cause
        if check.level and check.name.endswith("frequency of the plate"):  # by a factor of sampling intervals?
            others = [ring.value("natural_frequency")[0] for name, ring in rings.items() if name != check.file]
            ratio = rings[check.file].value("natural_frequency")[0] / float(np.median(others))
            usual = min(SLIPS["interval"], key=lambda k: abs(log(ratio / k)))
            if abs(log(ratio / usual)) < _INTERVAL:
                way = f"{max(usual, 1 / usual):g} times too {'short' if ratio > 1.0 else 'long'}"
                cause = f"the sampling interval of {check.file} is stated {way}"
                cause += ", or that of the other file is wrong" * (len(others) == 1)
        checks.append(replace(check, cause=cause))
    for drops in settings.drops:
        falls = [rings[name] for name in drops.laser if name in rings]
        checks += fall_checks.repeats_agree(falls, _AMPLITUDE, "this recording is of another height or another body")
    checks += _of_blows(table, plate, settings)
    inputs, shared = {}, {}
    if table is not None:
        own, _ = relative_uncertainty(table, settings)
        shared = {SERIES.format(i + 1): Quantity(1.0, float(u), "1") for i, u in enumerate(own)}
        inputs = {HEIGHT.format(drops_label(drops)): drops.height for drops in settings.drops}
    # of a body that cannot be, no blow tells which height is wrong
    causes = [] if of_body.level else list(_causes(table, plate, settings))
    return Scene(checks, causes, given.each([rows]), inputs, shared, basis)


def _course(file: str, moved: xr.Dataset, ring: xr.Dataset) -> tuple[Check, Check]:
    """Compare the plate's first motion with the direction of a blow, and each blow of the body with the one before."""
    read = np.isfinite(moved["displacement"].values)
    time, y = moved["time"].values[read], moved["displacement"].values[read]
    period, noise = 1.0 / float(ring["natural_frequency"]), float(moved.attrs["noise"])
    onset = float(ring["onset_time"])
    rest, begun = y[time < onset - period / 4], y[(time >= onset) & (time < onset + period / 2)]
    way, u = float(begun.mean() - np.mean(rest)), noise * float(np.sqrt(1 / begun.size + 1 / rest.size))
    text = f"{file}: from {quantity(onset, 's')} on the plate moves {'down' if way < 0.0 else 'up'} first, by "
    cause = (
        f"the sign of {file} is reversed: the plate moves away from the blow (sensor.direction, or head upside down)"
    )
    first = bounded(_WAY, f"{text}{quantity(abs(way), 'm')}", way, u, at_most=0.0, file=file, cause=cause)
    when, size, u = signals.blows(time, y, 1.0 / period, float(ring["damping_ratio"]), noise)
    counted = np.flatnonzero((when > onset - period) & (size > _COUNTED * size.max(initial=0.0)))
    when, size = when[counted], size[counted]
    if when.size < 2:
        return first, not_made(_BLOWS, "two blows")
    k = int(np.argmax(more := np.diff(size)))
    later, before = ((quantity(float(size[i]), "m"), quantity(float(when[i]), "s")) for i in (k + 1, k))
    text = f"{file}: a blow of {later[0]} at {later[1]} follows one of {before[0]} at {before[1]}"
    cause = f"something else struck plate or table at {later[1]}: a body that bounces strikes less hard each time"
    place: dict[str, Any] = {"file": file, "cause": cause, "at_most": fall_checks.SWING * float(size[0])}
    return first, bounded(_BLOWS, text, float(more[k]), u, is_law=False, **place)


def _of_blows(table: xr.Dataset | None, plate: xr.Dataset | None, settings: PlateVibration) -> Iterator[Check]:
    """Compare the plate that was found with those that there are, and every blow with the plate of the others."""
    name = "modal mass of the plate"
    if plate is None or not np.isfinite(mass := float(plate["mass"])):
        yield not_made(name, "a sphere, and a DMA experiment or a material of the library")
    else:
        (low, high), u = map(log, _PLATES), max(float(plate["u_mass"]) / mass, 0.01)
        text = f"the blows give a modal mass of {quantity(mass, 'kg')}"
        cause = "lengths are in another unit than the file says, the gain or scale of the sensor is wrong, or "
        place = {"cause": f"{cause}sphere.mass is in another unit than was typed", "setting": "sphere.mass"}
        yield bounded(name, text, log(mass), u, at_least=low, at_most=high, is_law=False, **place)
    if table is None or plate is None:
        return
    for i, (drops, row) in enumerate(zip(settings.drops, amplitudes(table, plate, settings), strict=True)):
        name = f"{_MOMENTUM_OF}, {drops_label(drops)}"
        if row is None:
            yield not_made(name, "another drop whose material is of a DMA experiment or of the library")
            continue
        seen, expected = row.measured or nan, row.model or nan
        text = f"{drops_label(drops)}: an amplitude of {quantity(seen, 'm')} seen, {quantity(expected, 'm')} "
        text += "expected for the plate that the other drops find"
        u = hypot(row.u_difference or nan, _MOMENTUM * seen)
        yield compared(name, text, seen, u, expected, 0.0, setting=f"drops[{i}].height", otherwise=_STATED)


def _causes(table: xr.Dataset | None, plate: xr.Dataset | None, settings: PlateVibration) -> Iterator[Cause]:
    """Yield a wrong height and unit of each drop; the plate that the other drops find depends on this drop, too."""
    count = len(settings.drops)
    weights = np.zeros((count, count)) if table is None or plate is None else from_others(table, plate)[1]
    momenta = [f"{_MOMENTUM_OF}, {drops_label(drops)}" for drops in settings.drops]
    blows = np.ones(count)
    if table is not None and plate is not None and "modal_mass" in plate:
        blows = np.nan_to_num(table["amplitude"].values * plate["modal_mass"].values, nan=1.0)  # go with the momenta
    for i, drops in enumerate(settings.drops):
        by_amplitude = {momenta[j]: 1.0 if j == i else -float(weights[j, i]) for j in range(count)}
        by_height = {name: -0.5 * slope for name, slope in by_amplitude.items()}
        name = f"the height of {drops.material}"
        yield judgements.stated_wrongly(by_height, name, drops.height, f"drops[{i}].height", u=inf)
        of_unit = f"the unit or the display factor of {', '.join(drops.laser)} is not what it says"
        place: dict[str, Any] = {"setting": f"drops[{i}].laser"} if len(drops.laser) > 1 else {"file": drops.laser[0]}
        usual = SLIPS["length"] + SLIPS["gain"]
        yield Cause(by_amplitude, judgements.wrong_lengths(of_unit), usual, only_usual=True, **place)
        for j, other in enumerate(settings.drops[:i]):  # exchanged, each has the blow of the other
            moved = {name: by_amplitude[name] + float(weights[n, j]) for n, name in enumerate(momenta)}
            moved[momenta[j]] = by_amplitude[momenta[j]] - 1.0
            factor = float(blows[j] / blows[i])
            said = f"the recordings of {drops_label(other)} and {drops_label(drops)} are exchanged"

            def say(_: float, said: str = said) -> str:
                return said

            if abs(log(factor)) > _MOMENTUM:
                yield Cause(moved, say, (factor,), only_usual=True, setting=f"drops[{j}].laser")
