"""Checks of a plate vibration: one plate in all recordings, and blows as stated.

Frequency and damping belong to the plate, so all recordings give the same. The amplitude says how
much momentum came, and the pause until the second blow how long the body flew: a height, a
material, a mass or a sampling interval that is stated wrongly moves them differently.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise, repeat
from math import expm1, hypot, log, nan, pi, sqrt

import numpy as np
import xarray as xr

from labpipe.judging import (
    DOUBTFUL,
    SLIPS,
    Cause,
    Check,
    Level,
    bounded,
    compared,
    explain,
    in_words,
    not_made,
    too_large,
)
from labpipe.report import quantity
from labpipe.units import Quantity
from labpipe.workflow.context import Context
from pipelines.experiments.plate_vibration.comparison import SERIES, by_solids, from_others, height_name, rows
from pipelines.experiments.plate_vibration.measured import drops_label
from pipelines.experiments.plate_vibration.model import of_solids, relative_uncertainty
from pipelines.experiments.plate_vibration.settings import PlateVibration
from pipelines.experiments.shared import fall_checks, judgements, record_checks
from pipelines.experiments.shared.fall_checks import Fall, matched, shown
from pipelines.experiments.shared.given import Given
from pipelines.experiments.shared.judgements import Scene, Title, line_of, times_over
from pipelines.experiments.shared.record_checks import Trace

_BLOCK = 16
"""Readings by which the free stretch grows, and that are given back before the second blow."""
_STRUCK = 3.0  # times the scatter before the first blow, by which a second one leaves the free ringing
_BEFORE, _MIDDLE = 2.5e-3, 1.1e-4  # s before a blow where the plate rests, and about its middle
_OTHER_MODES = 0.15  # of the logarithm of a blow's duration, by the plate's other vibrations
_MATERIAL = 0.1
"""Standard uncertainty of the logarithm of a flight's duration for a solid known by its name or its
DMA: it goes with the restitution."""
_MOMENTUM = 0.03
"""The same of the momentum of an impact, which goes with 1 + e."""
_PLATES = (0.3, 3e3)  # kg, modal masses of what spheres are dropped on in a laboratory
_ANOTHER_PLATE = 5e-3  # relative, by which a frequency may change when a plate is touched or warmed
_MOMENTUM_OF = "momentum of the blow"
_STATED = (
    "what falls is stated wrongly: sphere.mass, or a height, or the material of one of the drops; or a file is of "
    "another drop"
)
_ALIKE = (("amplitude", "amplitude at impact", "m"),)
_FAILED = record_checks.CAUSES | {
    "ringing": "the recording holds no ringing plate: the wrong channel or file, a blow before the recording began, "
    "something else that struck plate or table shortly before or after the body, a recording that ends too soon, or a "
    "sampling interval that is stated wrongly"
}


_STEPS = ("readings", "displacement", "ringing", "table", "plate", "model", "comparison")


TITLES = {
    "one plate": Title(
        "All recordings show the free ringing of one plate: one frequency and one damping.",
        ("frequency of the plate", "damping of the plate", "modal mass of the plate"),
    ),
    "direction and order of the blows": Title(
        "A falling body pushes the plate down, and harder from a larger height.",
        ("direction of the blow", "amplitude over height"),
    ),
    "momentum of the blow": Title(
        "Momentum over amplitude and frequency gives one modal mass for all drops.", ("momentum of the blow",)
    ),
    "pause before the second blow": Title(
        "The time until the second blow is the flight after a fall from the stated height.",
        ("pause before the second blow",),
    ),
    "contact duration": Title("Hertz: t = 2.87 (m²/(R E*² v))^(1/5) for the stated sphere.", ("duration of the blow",)),
    "repeats": Title("Repeats agree within their scatter.", ("repeats",)),
    **record_checks.OF_LASER,
}


@judgements.judging(*_STEPS, rests_on=("drops.material_from",), titles=TITLES)
def judgement(given: Given, basis: judgements.Basis, settings: PlateVibration, context: Context) -> Scene:
    """Judge one plate vibration; what gave no result is judged by that."""
    readings, displacement, ringing, table, plate, model, comparison = map(given.get, _STEPS)
    names = [name for drops in settings.drops for name in drops.laser]
    of_traces = _of_traces(names, readings, displacement, settings)
    failed = judgements.failed_steps(context, _FAILED)
    checks = [record_checks.placed(check, settings.calibration) for check in failed]
    statements = list(_statements(settings))
    checks += [*of_traces, *statements]
    found = {n: ring for n, ring in zip(names, ringing or (), strict=False) if ring is not None}
    moved = {n: each for n, each in zip(names, displacement or (), strict=False) if each is not None}
    checks += record_checks.of_record(moved, settings.calibration)
    checks += [_downwards(name, moved[name], ring) for name, ring in found.items() if name in moved]
    checks += _one_plate(found)
    for drops in settings.drops:
        # what repeats share is taken out: their scatter alone is asked
        falls = [Fall(name, found[name], 0.0) for name in drops.laser if name in found]
        checks += fall_checks.repeats_agree(falls, _ALIKE, "this recording is of another height or another body")
    checks += _of_plate(plate, settings)
    flights = list(_flights(found, model, moved, settings))
    checks += _with_interval(flights, names, readings, settings)
    checks += _blows(comparison, model, settings)
    checks += _momenta(table, plate, settings)
    checks.append(_grows_with_height(table, settings))
    inputs, shared = {}, {}
    if table is not None:
        own = relative_uncertainty(table, settings)
        shared = {f"{SERIES} {i + 1}": Quantity(1.0, float(u), "1") for i, u in enumerate(own.amplitude)}
        inputs = {height_name(settings, i): drops.height for i, drops in enumerate(settings.drops)}
        inputs |= {} if plate is None else {name: given for name, (given, _) in of_solids(plate).items()}
    # of a body that cannot be, no blow tells which height is wrong
    is_body = not any(c.setting == "sphere.mass" and c.level for c in statements)
    causes = list(_causes(table, plate, settings)) if is_body else []
    if not explain(checks, causes):
        checks = [
            replace(c, cause=_STATED) if c.name.startswith(_MOMENTUM_OF) and c.level and not c.cause else c
            for c in checks
        ]
    return Scene(checks, causes, given.each([rows]), inputs, shared, basis)


def _of_traces(
    names: Sequence[str],
    readings: Sequence[xr.Dataset | None] | None,
    displacement: Sequence[xr.Dataset | None] | None,
    settings: PlateVibration,
) -> list[Check]:
    pairs = [(n, read) for n, read in zip(names, readings or (), strict=False) if read is not None]
    traces = [t for name, read in pairs if (t := Trace.of(name, read, settings.sensor.output)) is not None]
    moved = dict(zip(names, displacement or repeat(None), strict=False))
    gravity = settings.model.gravity.value
    found = [c for trace in traces for c in record_checks.of_readings(trace, gravity, moved[trace.name])]
    return [*found, record_checks.shared_rows(traces)]


def _statements(settings: PlateVibration) -> Iterator[Check]:
    """Hold stated values against what a sphere weighs, and uncertainties against what they belong to."""
    given = [(f"drops[{i}].height", drops.height) for i, drops in enumerate(settings.drops)]
    body = settings.sphere
    if body is not None:
        given += [("sphere.radius", body.radius), ("sphere.mass", body.mass)]
    yield from judgements.uncertainties_stated(given)
    if body is None:
        yield not_made("mass of the falling body", "a sphere with its mass")
    else:
        yield fall_checks.body_stated(body.radius.value, body.mass.value)


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


def _one_plate(found: dict[str, xr.Dataset]) -> list[Check]:
    """Hold frequency and damping of every recording against those of all."""
    checks = []
    for variable, title, unit in (("natural_frequency", "frequency", "Hz"), ("damping_ratio", "damping", "1")):
        name = f"{title} of the plate"
        if len(found) < 2:
            checks.append(not_made(name, "two recordings"))
            continue
        values = np.array([float(ring[variable]) for ring in found.values()])
        u = np.array([float(ring[f"u_{variable}"]) for ring in found.values()])
        centre, u_centre = float(np.median(values)), float(np.median(u)) / sqrt(len(values))
        worst = int(np.argmax(np.abs(values - centre) / u))
        if len(found) == 2:  # nobody knows which is off: the one that tells less is held against the other
            worst = int(np.argmax(u))
            centre, u_centre = float(values[1 - worst]), float(u[1 - worst])
        file, others = list(found)[worst], "the other" if len(found) == 2 else "all others"
        seen, own = float(values[worst]), float(u[worst])
        message = f"{file}: {shown(seen, own, unit)}, {others} {matched(centre, own, unit)}"
        # the damping of a real plate depends on how it lies and how far it swings
        allowance = _ANOTHER_PLATE * centre if variable == "natural_frequency" else 0.2 * centre
        check = compared(
            name,
            message,
            float(values[worst]),
            float(u[worst]),
            centre,
            u_centre,
            allowance=allowance,
            factor=False,
            file=file,
        )
        cause = "something else struck plate or table, the plate was changed, or the file is of another plate"
        if variable == "natural_frequency":
            factor = centre / float(values[worst])
            cause = f"the sampling interval of {file} is {in_words(factor)} times what it says, or {cause}"
        checks.append(replace(check, cause=cause) if check.level else check)
    return checks


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


def _name_of_flight(settings: PlateVibration, i: int) -> str:
    return f"pause before the second blow, {drops_label(settings.drops[i])}"


def _name_of_momentum(settings: PlateVibration, i: int) -> str:
    return f"{_MOMENTUM_OF}, {drops_label(settings.drops[i])}"


def _flights(
    found: dict[str, xr.Dataset], model: xr.Dataset | None, moved: dict[str, xr.Dataset], settings: PlateVibration
) -> Iterator[Check]:
    """Hold the pause before the second blow against the flight of the stated body from the stated height."""
    for i, drops in enumerate(settings.drops):
        name = _name_of_flight(settings, i)
        known = [_pause(found[f], moved.get(f), settings.blow.pause.value) for f in drops.laser if f in found]
        pauses = [pause for pause in known if pause is not None]
        if not pauses:
            yield not_made(name, "a second blow in the record")
            continue
        seen = float(np.mean([p for p, _ in pauses]))
        u = float(np.mean([u for _, u in pauses])) / sqrt(len(pauses))
        longest = 2 * sqrt(2 * drops.height.value / settings.model.gravity.value)
        expected = nan if model is None else float(model["second_touch"][i])
        where = f"drops[{i}].height"
        if model is not None and not np.isfinite(expected) and np.isfinite(model["displacement"].values[i]).any():
            yield _too_soon(name, seen, u, float(model["time"][-1]), drops_label(drops), where)
            continue
        if not np.isfinite(expected):
            text = f"{drops_label(drops)}: {shown(seen, u, 's')}, at most {quantity(longest, 's')} is possible"
            yield bounded(name, text, seen, u, at_least=0.0, at_most=longest, setting=where)
            continue
        text = f"{drops_label(drops)}: {shown(seen, u, 's')} seen, about {quantity(expected, 's')} expected"
        check = compared(name, text, seen, hypot(u, _MATERIAL * seen), expected, 0.0, setting=where)
        if seen - longest > 5 * u:
            check = replace(check, level="impossible", message=f"{text}; {quantity(longest, 's')} is possible at most")
        yield check


def _too_soon(name: str, seen: float, u: float, simulated: float, label: str, where: str) -> Check:
    """Hold a pause against one that is longer than was simulated."""
    text = f"{label}: {shown(seen, u, 's')} seen, more than {quantity(simulated, 's')} expected"
    least = simulated * (1.0 - _MATERIAL)
    check = bounded(name, text, seen, hypot(u, _MATERIAL * seen), at_least=least, is_law=False, setting=where)
    cause = f"the height of {label} is stated too large, or the sampling interval too short"
    return replace(check, cause=cause)


def _pause(ring: xr.Dataset, moved: xr.Dataset | None, shortest: float) -> tuple[float, float] | None:
    """Return the time from the blow to the second one [s], and its standard uncertainty."""
    if moved is None:
        return None
    interval = float(moved.attrs["sampling_interval"])
    end = float(ring["free_to"])
    if end + 3 * _BLOCK * interval > float(moved["time"][-1]):
        return None  # the ringing is free until the end
    if end < float(ring["onset_time"]) + shortest + _BLOCK * interval:
        return None  # nothing is known behind the stretch that was taken for free
    if not _is_struck(ring, moved):
        return None  # the free stretch ended by chance, at a block of larger noise
    # one block is given back, and the second blow is noticed within the next: one block, give or take one
    return end + _BLOCK * interval - float(ring["blow_time"]), _BLOCK * interval / sqrt(3.0)


def _left(ring: xr.Dataset, moved: xr.Dataset) -> np.ndarray:
    """Return by how much the plate leaves the ringing that was fitted [m]."""
    time, height = moved["time"].values, moved["displacement"].values
    damping, natural = float(ring["damping_ratio"]), 2 * pi * float(ring["natural_frequency"])
    since = time - float(ring["blow_time"])
    wave = np.exp(-damping * natural * since) * np.sin(sqrt(1 - damping**2) * natural * since + float(ring["phase"]))
    left = height - float(ring["amplitude"]) * wave
    return np.asarray(left - np.nanmean(left[(time >= float(ring["free_from"])) & (time <= float(ring["free_to"]))]))


def _is_struck(ring: xr.Dataset, moved: xr.Dataset) -> bool:
    """Tell whether the plate, behind the free stretch, leaves its ringing by much more than it scattered before."""
    left, time, height = _left(ring, moved), moved["time"].values, moved["displacement"].values
    behind = left[time > float(ring["free_to"])][_BLOCK : 5 * _BLOCK]
    behind = behind[np.isfinite(behind)]
    return bool(behind.size) and bool(
        np.mean(behind**2) > _STRUCK**2 * np.nanvar(height[time < float(ring["onset_time"])])
    )


def _blows(comparison: xr.Dataset | None, model: xr.Dataset | None, settings: PlateVibration) -> list[Check]:
    """Hold the plate's motion while it is struck against a blow of the stated sphere.

    In the middle of a blow of duration t the plate has moved by about 0.1 t times the speed that it
    is left with: simulation and record are scaled to one speed, so that their displacements there
    are as the durations of their contacts.
    """
    name = "duration of the blow"
    body = settings.sphere
    if comparison is None or model is None or body is None:
        return [not_made(name, "a sphere, and a DMA experiment or a material of the library")]
    time = comparison["time"].values
    gaps, own, known = [], [], []
    for i, (seen, theirs) in enumerate(zip(comparison["measured"].values, comparison["model"].values, strict=True)):
        duration = float(model["contact_duration"][i])
        middle = np.abs(time) <= _MIDDLE
        before = (time < -0.75 * duration) & (time > -_BEFORE)
        if not (np.isfinite(theirs[middle]).all() and np.isfinite(seen[middle]).all() and before.sum() > 4):
            continue
        quiet = seen[before] - theirs[before]
        moved, expected = (float(x[middle].mean()) for x in (seen - np.nanmean(quiet), theirs))
        if moved * expected > 0.0:
            gaps.append(log(moved / expected))
            own.append(float(np.nanstd(quiet)) / abs(moved) / sqrt(middle.sum()))
            known.append(settings.drops[i].material_from is not None)
    if not gaps:
        return [not_made(name, "readings before and within a blow")]
    weights = np.array(own) ** -2.0
    gap, random = float(weights @ gaps / weights.sum()), float(weights.sum() ** -0.5)
    # what else a plate can swing in moves it more, never less, while it is struck
    others = _OTHER_MODES if gap > 0.0 else 0.0
    u = hypot(random, hypot(others, fall_checks.MEASURED if any(known) else fall_checks.BY_NAME))
    longer = f"{in_words(np.exp(gap), 2)} times as long as"
    if abs(gap) < _OTHER_MODES:
        longer = f"{in_words(100 * abs(expm1(gap)), 2)} % {'longer' if gap > 0.0 else 'shorter'} than"
    text = f"the blows last {longer} those of the stated sphere on a plate of this mass"
    level: Level | None = "doubtful" if abs(gap) > DOUBTFUL * u else None
    cause, setting = fall_checks.of_body(gap, u, body.radius.value, body.mass.value) if level else ("", "")
    check = Check(name, text, level, gap / u, gap, u, cause=cause, setting=setting or "sphere.mass")
    return [check]


def _momenta(table: xr.Dataset | None, plate: xr.Dataset | None, settings: PlateVibration) -> Iterator[Check]:
    """Hold the blow of every drop against the plate that the others find."""
    if table is None or plate is None:
        return
    predicted, weights = from_others(table, plate)
    total = relative_uncertainty(table, settings).total
    solids = by_solids(plate, weights)
    for i, drops in enumerate(settings.drops):
        name = _name_of_momentum(settings, i)
        if not np.isfinite(predicted[i]):
            yield not_made(name, "another drop whose material is of a DMA experiment or of the library")
            continue
        seen = float(table["amplitude"][i])
        solid = [float(slope[i]) * given.u for given, slope in solids.values()]
        u = hypot(float(total[i]), float(np.linalg.norm(weights[i] * total)), *solid, _MOMENTUM)
        text = (
            f"{drops_label(drops)}: an amplitude of {quantity(seen, 'm')} seen, {quantity(float(predicted[i]), 'm')} "
            "expected for the plate that the other drops find"
        )
        yield compared(name, text, seen, u * seen, float(predicted[i]), 0.0, setting=f"drops[{i}].height")


def _grows_with_height(table: xr.Dataset | None, settings: PlateVibration) -> Check:
    """Hold amplitudes of one material against the order of its heights."""
    name = "amplitude over height"
    worst: tuple[float, float, float, str] | None = None
    for material in {drops.material for drops in settings.drops} if table is not None else ():
        same = [i for i, drops in enumerate(settings.drops) if drops.material == material]
        same.sort(key=lambda i: settings.drops[i].height.value)
        for low, high in pairwise(same):
            if table is None or settings.drops[low].height.value == settings.drops[high].height.value:
                continue
            rise = float(table["amplitude"][high] - table["amplitude"][low])
            u = hypot(float(table["u_amplitude"][high]), float(table["u_amplitude"][low]))
            where = f"{drops_label(settings.drops[high])} after {drops_label(settings.drops[low])}"
            if worst is None or rise / u < worst[0]:
                worst = (rise / u, rise, u, where)
    if worst is None:
        return not_made(name, "one material from several heights")
    _, rise, u, where = worst
    text = f"{where}: the amplitude changes by {shown(rise, u, 'm')}"
    check = bounded(name, text, rise, u, at_least=0.0, setting="drops")
    return replace(check, cause="recordings of two heights were exchanged")


def _with_interval(
    flights: list[Check], names: Sequence[str], readings: Sequence[xr.Dataset | None] | None, settings: PlateVibration
) -> list[Check]:
    """Name the sampling interval where all flights last too long, or too short, by one factor."""
    ratios = [check.log_ratio for check in flights if np.isfinite(check.log_ratio)]
    first = next((d for d in readings or () if d is not None), None)
    if first is None or len(ratios) < 2 or np.ptp(ratios) > 4 * _MATERIAL or abs(np.mean(ratios)) < 3 * _MATERIAL:
        return flights
    interval = float(first.attrs["sampling_interval"])
    factor = min(SLIPS["interval"], key=lambda k: abs(log(k) - float(np.mean(ratios))))
    line = line_of(str(first.attrs.get("header", "")), "cycle", "period", "周期")
    is_given = settings.keyence.cycle is not None
    place = "" if line is None or is_given else f"line {line} of {names[0]}"
    cause = times_over("the sampling interval", interval, "s", place)(factor)
    setting = "keyence.cycle" if is_given else ""
    file, line = ("", None) if is_given else (names[0], line)
    return [
        replace(check, cause=cause, file=file, line=line, setting=setting) if check.level else check
        for check in flights
    ]


def _causes(table: xr.Dataset | None, plate: xr.Dataset | None, settings: PlateVibration) -> Iterator[Cause]:
    count = len(settings.drops)
    weights = np.zeros((count, count)) if table is None or plate is None else from_others(table, plate)[1]
    for i in range(count):
        # the plate that the others find stands on this drop too
        effects = {_name_of_momentum(settings, j): 0.5 * float(weights[j, i]) for j in range(count) if j != i}
        effects |= {_name_of_momentum(settings, i): -0.5, _name_of_flight(settings, i): -0.5}
        say = partial(_of_height, i, settings)
        yield Cause(effects, say, SLIPS["decimal"], setting=f"drops[{i}].height")
        # a file or two in another unit
        files = settings.drops[i].laser
        effects = {_name_of_momentum(settings, j): -float(weights[j, i]) for j in range(count) if j != i}
        effects |= {_name_of_momentum(settings, i): 1.0}
        yield Cause(
            effects,
            partial(_of_unit, i, settings),
            SLIPS["length"],
            only_usual=True,
            file=files[0] if len(files) == 1 else "",
            setting="" if len(files) == 1 else f"drops[{i}].laser",
        )


def _of_unit(i: int, settings: PlateVibration, factor: float) -> str:
    files = ", ".join(settings.drops[i].laser)
    return f"lengths come out {too_large(factor)}: the unit or the display factor of {files} is not what it says"


def _of_height(i: int, settings: PlateVibration, factor: float) -> str:
    drops = settings.drops[i]
    right, given = quantity(drops.height.value / factor, "m"), quantity(drops.height.value, "m")
    return (
        f"the height of {drops.material} is probably {right}, not {given} (height of drops no. {i + 1} in session.toml)"
    )
