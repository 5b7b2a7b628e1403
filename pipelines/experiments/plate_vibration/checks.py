"""Checks of a plate vibration: one plate in all recordings, and blows as stated.

Frequency and damping belong to the plate, so all recordings give the same. The amplitude says how
much momentum came, and the pause until the second blow how long the body flew: a height, a
material, a mass or a sampling interval that is stated wrongly moves them differently.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from math import hypot, inf, log, nan, pi, sqrt

import numpy as np
import xarray as xr

from labpipe.judging import SLIPS, Cause, Check, bounded, compared, explain, not_made, too_large
from labpipe.report import quantity
from labpipe.units import Quantity
from labpipe.workflow.context import Context
from pipelines.experiments.plate_vibration.comparison import SERIES, amplitudes, from_others, height_name, rows
from pipelines.experiments.plate_vibration.measured import SHORTEST_FLIGHT, drops_label
from pipelines.experiments.plate_vibration.model import of_solids, relative_uncertainty
from pipelines.experiments.plate_vibration.settings import PlateVibration
from pipelines.experiments.shared import fall_checks, judgements, record_checks
from pipelines.experiments.shared.fall_checks import Fall, Repeated, shown
from pipelines.experiments.shared.given import Given
from pipelines.experiments.shared.judgements import Scene, Title

_BLOCK = 16
"""Readings by which the free stretch grows, and that are given back before the second blow."""
_MATERIAL = 0.1
"""Standard uncertainty of the logarithm of a flight's duration for a solid known by its name or its
DMA: it goes with the restitution."""
_MOMENTUM = 0.03
"""The same of the momentum of an impact, which goes with 1 + e."""
_PLATES = (0.3, 3e3)  # kg, modal masses of what spheres are dropped on in a laboratory
_MOMENTUM_OF, _PAUSE_OF = "momentum of the blow", "pause before the second blow"
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


_STEPS = ("readings", "displacement", "ringing", "table", "plate", "model", "comparison")


TITLES = {
    "one plate": Title(
        "All recordings show the free ringing of one plate: one frequency and one damping.",
        ("repeats: frequency of the plate", "repeats: damping of the plate", "modal mass of the plate"),
    ),
    "direction of the blow": Title("A falling body pushes the plate down.", ("direction of the blow",)),
    "momentum of the blow": Title(
        "Momentum over amplitude and frequency gives one modal mass for all drops.", (_MOMENTUM_OF,)
    ),
    "pause before the second blow": Title(
        "The time until the second blow is the flight after a fall from the stated height.", (_PAUSE_OF,)
    ),
    "repeats": Title("Repeats agree within their scatter.", ("repeats",)),
    **record_checks.OF_LASER,
}


@judgements.judging(*_STEPS, rests_on=("drops.material_from",), titles=TITLES)
def judgement(given: Given, basis: judgements.Basis, settings: PlateVibration, context: Context) -> Scene:
    """Judge one plate vibration; a step without a result is judged by its error."""
    readings, displacement, ringing, table, plate, model, _ = map(given.get, _STEPS)
    names = [name for drops in settings.drops for name in drops.laser]
    found = {n: ring for n, ring in zip(names, ringing or (), strict=False) if ring is not None}
    moved = {n: each for n, each in zip(names, displacement or (), strict=False) if each is not None}
    read = {n: each for n, each in zip(names, readings or (), strict=False) if each is not None}
    body = settings.sphere
    of_traces, checks = record_checks.of_recordings(read, moved, {}, settings, context, _FAILED)
    checks += of_traces
    asked = [(f"drops[{i}].height", drops.height) for i, drops in enumerate(settings.drops)]
    asked += [] if body is None else [("sphere.radius", body.radius), ("sphere.mass", body.mass)]
    statements = list(judgements.uncertainties_stated(asked))
    if body is None:
        statements.append(not_made("mass of the falling body", "a sphere with its mass"))
    else:
        statements.append(fall_checks.body_stated(body.radius.value, body.mass.value))
    checks += statements
    checks += [_downwards(name, moved[name], ring) for name, ring in found.items() if name in moved]
    rings = [Fall(name, ring, 0.0) for name, ring in found.items()]
    checks += fall_checks.repeats_agree(rings, _OF_ONE_PLATE, _ANOTHER_PLATE)
    for drops in settings.drops:
        # what repeats share is taken out: their scatter alone is asked
        falls = [Fall(name, found[name], 0.0) for name in drops.laser if name in found]
        checks += fall_checks.repeats_agree(falls, _AMPLITUDE, "this recording is of another height or another body")
    checks += _of_plate(plate, settings)
    checks += _flights(found, model, moved, settings)
    checks += _momenta(table, plate, settings)
    inputs, shared = {}, {}
    if table is not None:
        own, _ = relative_uncertainty(table, settings)
        shared = {f"{SERIES} {i + 1}": Quantity(1.0, float(u), "1") for i, u in enumerate(own)}
        inputs = {height_name(settings, i): drops.height for i, drops in enumerate(settings.drops)}
        inputs |= {} if plate is None else {name: given for name, (given, _) in of_solids(plate).items()}
    # of a body that cannot be, no blow tells which height is wrong
    is_body = not any(c.setting == "sphere.mass" and c.level for c in statements)
    causes = list(_causes(table, plate, list(read.items()), settings)) if is_body else []
    if not explain(checks, causes):
        checks = [
            replace(c, cause=_STATED) if c.name.startswith(_MOMENTUM_OF) and c.level and not c.cause else c
            for c in checks
        ]
    return Scene(checks, causes, given.each([rows]), inputs, shared, basis)


def _downwards(name: str, moved: xr.Dataset, ring: xr.Dataset) -> Check:
    """Hold the first motion against the direction of a blow from above."""
    title = "direction of the blow"
    onset, period = float(ring["onset_time"]), 1.0 / float(ring["natural_frequency"])
    time, x = moved["time"].values, moved["displacement"].values
    # the onset is late by no more than a block, and the first swing lasts half a period
    inside = (time >= onset) & (time <= onset + 0.25 * period) & np.isfinite(x)
    quiet = x[(time < onset - 1e-3) & np.isfinite(x)]
    if inside.sum() < 4 or quiet.size < 4:
        return not_made(title, "readings before and after the blow")
    swing = float(x[inside].mean() - quiet.mean())
    u = float(moved.attrs["noise"]) * sqrt(1 / inside.sum() + 1 / quiet.size)
    text = f"{name}: the plate moves by {quantity(swing, 'm')} first"
    check = bounded(title, text, swing, u, at_most=0.0, setting="sensor.direction")
    cause = "the sensor counts the other way than stated: sensor.direction in session.toml has the wrong sign"
    return replace(check, cause=cause)


def _of_plate(plate: xr.Dataset | None, settings: PlateVibration) -> Iterator[Check]:
    """Hold the plate that was found against those that there are."""
    name = "modal mass of the plate"
    mass = nan if plate is None else float(plate["mass"])
    if not np.isfinite(mass):
        yield not_made(name, "a sphere, and a DMA experiment or a material of the library")
        return
    low, high = _PLATES
    relative = float(plate["u_mass"]) / mass if plate is not None else nan
    text = f"the blows give a modal mass of {quantity(mass, 'kg')}"
    check = bounded(name, text, log(mass), max(relative, 0.01), at_least=log(low), at_most=log(high), is_law=False)
    body = settings.sphere
    if body is not None and mass < body.mass.value:
        check = replace(check, level="impossible", message=f"{text}, less than what falls on it")
    cause = (
        "lengths are in another unit than the file says, the gain or scale of the sensor is wrong, or sphere.mass is "
        "in another unit than was typed"
    )
    yield replace(check, cause=cause, setting="sphere.mass") if check.level else check


def _flights(
    found: dict[str, xr.Dataset], model: xr.Dataset | None, moved: dict[str, xr.Dataset], settings: PlateVibration
) -> Iterator[Check]:
    """Hold the pause before the second blow against the flight of the stated body from the stated height."""
    for i, drops in enumerate(settings.drops):
        name = f"{_PAUSE_OF}, {drops_label(drops)}"
        known = [_pause(found[f], moved.get(f)) for f in drops.laser if f in found]
        pauses = [pause for pause in known if pause is not None]
        if not pauses:
            yield not_made(name, "a second blow in the record")
            continue
        seen = float(np.mean([p for p, _ in pauses]))
        u = float(np.mean([u for _, u in pauses])) / sqrt(len(pauses))
        longest = 2 * sqrt(2 * drops.height.value / settings.model.gravity.value)
        expected = nan if model is None else float(model["second_touch"][i])
        where, text = f"drops[{i}].height", f"{drops_label(drops)}: {shown(seen, u, 's')} seen"
        if not np.isfinite(expected):
            text += f", at most {quantity(longest, 's')} is possible"
            yield bounded(name, text, seen, u, at_least=0.0, at_most=longest, setting=where)
            continue
        text += f", about {quantity(expected, 's')} expected"
        check = compared(name, text, seen, hypot(u, _MATERIAL * seen), expected, 0.0, setting=where)
        if seen - longest > 5 * u:
            check = replace(check, level="impossible", message=f"{text}; {quantity(longest, 's')} is possible at most")
        yield check


def _pause(ring: xr.Dataset, moved: xr.Dataset | None) -> tuple[float, float] | None:
    """Return the time from the blow to the second one [s], and its standard uncertainty.

    None where the ringing is free until the record ends, or ends by chance at a block of larger noise: behind it the
    plate must leave its ringing by more than three times the scatter before the blow.
    """
    if moved is None:
        return None
    block, end, onset = _BLOCK * float(moved.attrs["sampling_interval"]), float(ring["free_to"]), ring["onset_time"]
    if end + 3 * block > float(moved["time"][-1]) or end < float(onset) + SHORTEST_FLIGHT + block:
        return None
    time, height = moved["time"].values, moved["displacement"].values
    damping, natural = float(ring["damping_ratio"]), 2 * pi * float(ring["natural_frequency"])
    since = time - float(ring["blow_time"])
    wave = np.exp(-damping * natural * since) * np.sin(sqrt(1 - damping**2) * natural * since + float(ring["phase"]))
    left = height - float(ring["amplitude"]) * wave
    left = left - np.nanmean(left[(time >= float(ring["free_from"])) & (time <= end)])
    behind = left[time > end][_BLOCK : 5 * _BLOCK]
    behind = behind[np.isfinite(behind)]
    if not behind.size or np.mean(behind**2) <= 9.0 * np.nanvar(height[time < float(onset)]):
        return None
    # one block is given back, and the second blow is noticed within the next: one block, give or take one
    return end + block - float(ring["blow_time"]), block / sqrt(3.0)


def _momenta(table: xr.Dataset | None, plate: xr.Dataset | None, settings: PlateVibration) -> Iterator[Check]:
    """Hold the blow of every drop against the plate that the others find."""
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
        yield compared(name, text, seen, u, expected, 0.0, setting=f"drops[{i}].height")


def _causes(
    table: xr.Dataset | None,
    plate: xr.Dataset | None,
    readings: Sequence[tuple[str, xr.Dataset]],
    settings: PlateVibration,
) -> Iterator[Cause]:
    """Yield a wrong sampling interval, and a wrong height and unit of each drop.

    The plate that the other drops find depends on this drop, too.
    """
    count = len(settings.drops)
    weights = np.zeros((count, count)) if table is None or plate is None else from_others(table, plate)[1]
    momenta, pauses = ([f"{of}, {drops_label(drops)}" for drops in settings.drops] for of in (_MOMENTUM_OF, _PAUSE_OF))
    for file, read in readings[: count > 1]:
        yield judgements.wrong_interval(dict.fromkeys(pauses, 1.0), file, read, settings.keyence.cycle is not None)
    for i, drops in enumerate(settings.drops):
        by_amplitude = {momenta[j]: 1.0 if j == i else -float(weights[j, i]) for j in range(count)}
        by_height = {name: -0.5 * slope for name, slope in by_amplitude.items()} | {pauses[i]: -0.5}
        name = f"the height of {drops.material}"
        yield judgements.stated_wrongly(by_height, name, drops.height, f"drops[{i}].height", u=inf)
        yield Cause(
            by_amplitude,
            partial(_of_unit, ", ".join(drops.laser)),
            SLIPS["length"],
            only_usual=True,
            file=drops.laser[0] if len(drops.laser) == 1 else "",
            setting="" if len(drops.laser) == 1 else f"drops[{i}].laser",
        )


def _of_unit(files: str, factor: float) -> str:
    return f"lengths come out {too_large(factor)}: the unit or the display factor of {files} is not what it says"
