"""Whether a ball drop can be believed: free fall, stated height, order of bounces, repeats."""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import repeat
from math import acos, cos, expm1, inf, pi

import numpy as np
import xarray as xr

from labpipe.errors import LabpipeError
from labpipe.judging import SLIPS, Cause, Check, explain, not_made, too_large, with_causes
from labpipe.materials import load
from labpipe.report import quantity
from labpipe.units import Quantity
from labpipe.workflow.context import Context
from pipelines.experiments.ball_drop.comparison import DURATION, RESTITUTION, SCALE, rows
from pipelines.experiments.ball_drop.settings import BallDrop
from pipelines.experiments.shared import fall_checks, judgements, trace_checks
from pipelines.experiments.shared.alternatives import of_drop
from pipelines.experiments.shared.comparison_rows import Row
from pipelines.experiments.shared.exact_values import usual_uncertainty
from pipelines.experiments.shared.fall_checks import Fall, Stiffness
from pipelines.experiments.shared.given import Given
from pipelines.experiments.shared.judgements import Scene, Title, line_of, times_over
from pipelines.experiments.shared.plate_under_drop import OF_PLATE
from pipelines.experiments.shared.trace_checks import Trace

_NO_FALL = 2.0  # times g, or the inverse, beyond which a motion is no flight at all
_LEAST_COSINE = 0.7  # of an inclination that anybody would mount a sensor with
_LEVEL = 3.0  # degrees
_LIGHTEST_PLATE = 5.0  # times the mass that falls on it: lighter, it would be hit again before it leaves
_LESS, _SHORTENED = 2.0, 0.1
"""Standard uncertainties by which a plate must lower the first restitution to be told where all bounces differ, and the
part of a contact's duration that it changes at most: t goes with (1 + m/M)^-0.4."""
_FINE = 2.0  # standard uncertainties within which a record is in order where another is not
_SMEARED = ("height of the fall", "duration of the first contact", "levels of the touches")
_BENT_BY_SWINGS = ("durations of the flights", "smoothness of the flights")
_OF_ANOTHER = (
    "this repeat is of another height or another body: the file belongs to another experiment, or was named wrongly"
)
_OF_IMPACTS = {
    RESTITUTION: "restitution",
    DURATION: "contact_duration",
    "speed of the first impact": "impact_speed",
    "penetration of the first impact": "penetration",
}
"""Results of a simulation by the beginning of the name of a compared quantity."""
_HELD_BACK = (
    "what was taken for its flights is no free fall: the body was caught, held or guided, or another body was in view"
)
_OTHERWISE = {
    "free-fall acceleration": "the body did not fly freely (a guide that rubs, a thread), or bench or sensor moved",
    "height of the fall": "height in session.toml is not that of this drop, the body did not fall freely (a guide that "
    "rubs, a thread), or bench or sensor moved with it",
    fall_checks.SPEED: "the body was slowed or pushed while it fell: a guide that rubs, a thread, a hand; or bench or "
    "sensor moved with it",
}
"""What is said of a fall that no factor of time, length or height explains."""
_REPEATS = (
    ("drop_height", "height of the fall", "m"),
    ("restitution", "first restitution", "1"),
    ("fall_acceleration", "free-fall acceleration", "m/s2"),
)
_FAILED = trace_checks.CAUSES | {
    "model": "a temperature, height or radius of session.toml is outside of what the material is known for",
    "bounces": "the recording holds no drop that is free: the wrong channel or file, a sensor that shakes, a body that "
    "was released before the trigger, or caught, a recording that ends too soon, or an average or filter of the "
    "controller that smears impacts",
}


_STEPS = ("readings", "displacement", "bounces", "repeats", "model", "comparison")
_SOURCES = ("material_file", "fitted", "plate")


TITLES = {
    "free fall": Title(
        "Every flight is a parabola with the acceleration of gravity.",
        (
            "free-fall acceleration", fall_checks.SPEED, "durations of the flights", "smoothness of the flights",
            "direction of the fall",
        ),
    ),
    "stated height": Title(
        "The measured fall equals the stated height.", ("height of the fall", "level of the release")
    ),
    "order of the bounces": Title(
        "0 < e < 1: every rebound is lower than the one before.",
        ("coefficients of restitution", "heights of the rebounds"),
    ),
    "contact duration": Title(
        "Hertz: t = 2.87 (m²/(R E*² v))^(1/5) for the stated sphere.",
        ("duration of the first contact", "size of the contact"),
    ),
    "touch and rest levels": Title(
        "The floor stays in place: every contact begins at one level.",
        ("levels of the touches", "level at rest", "repeats: levels of the touches"),
    ),
    "repeats": Title("Repeats agree within their scatter.", ("repeats",)),
    **judgements.OF_LASER,
}  # fmt: skip


@judgements.judging(
    *_STEPS, *_SOURCES, rests_on=("sphere.material_from", "plate_from"), titles=TITLES, plate_from=OF_PLATE
)
def judgement(given: Given, basis: judgements.Basis, settings: BallDrop, context: Context) -> Scene:
    """Judge one ball drop; what gave no result is judged by that."""
    readings, displacement, bounces, repeats, model, _ = map(given.get, _STEPS)
    gravity = settings.model.gravity.value
    traces = [
        trace
        for name, read in zip(settings.laser, readings or (), strict=False)
        if read is not None and (trace := Trace.of(name, read, settings.sensor.output)) is not None
    ]
    measured = zip(displacement or repeat(None), bounces or repeat(None), strict=False)
    by_name = dict(zip(settings.laser, measured, strict=False))
    of_traces = [c for trace in traces for c in trace_checks.checks_of(trace, gravity, *by_name[trace.name])]
    of_traces.append(trace_checks.shared_rows(traces))
    sphere = settings.sphere
    stated = [("height", settings.height), ("sphere.radius", sphere.radius), ("sphere.mass", sphere.mass)]
    failed = judgements.failed_steps(context, _FAILED)
    checks = [trace_checks.placed(check, settings.calibration) for check in failed]
    checks += [*of_traces, *judgements.uncertainties_stated(stated), fall_checks.gravity_stated(settings.model.gravity)]
    checks.append(fall_checks.body_stated(sphere.radius.value, sphere.mass.value))
    moved = dict(zip(settings.laser, displacement or (), strict=False))
    checks += trace_checks.of_record(moved, settings.calibration)
    records = list(_records(displacement, bounces, settings))
    headers = [d for d in readings or () if d is not None]
    is_damaged = any(check.level == "impossible" for check in of_traces)
    causes = [] if is_damaged else list(_causes(settings, headers, settings.laser, records))
    stiffness = _stiffness(settings, model)
    of_records = {fall.name: _of_record(fall, moved, stiffness, settings) for fall, moved in records}
    by_file = {trace.name: trace for trace in traces}
    for swing in (c for c in of_traces if c.name == trace_checks.SWING and c.level and c.file in of_records):
        added = trace_checks.speed_of_swing(by_file[swing.file], *by_name[swing.file])
        of_records[swing.file] = [
            _by_swing(check, swing, added, by_name[swing.file][1]) for check in of_records[swing.file]
        ]
    for lost in (c for c in of_traces if c.name == trace_checks.SINGLE_ROWS and c.level and c.file in of_records):
        names = {check.name for check in of_records[lost.file]}
        of_records[lost.file] = judgements.because(of_records[lost.file], lost.cause, *names, file=lost.file)
    for average in (c for c in of_traces if c.name == trace_checks.SMOOTHED and c.level and c.file in of_records):
        of_records[average.file] = judgements.because(
            of_records[average.file], average.cause, *_SMEARED, file=average.file
        )
    everything = [check for some in of_records.values() for check in some]
    if causes and (not explain(everything, causes) or _is_of_some(of_records)):
        headed = dict(zip(settings.laser, readings or (), strict=False))
        everything = [c for one in records for c in _alone(of_records[one[0].name], one, headed, settings)]
    # a time or a length that is wrong makes the contact of the right body too long
    for found in explain(everything, causes)[:1]:
        cause = found.cause
        place = {"file": cause.file, "line": cause.line, "setting": cause.setting}
        named = [name for name in found.checks if name == "duration of the first contact"]
        everything = judgements.because(everything, found.sentence, *named, **place)
    checks += everything
    checks += fall_checks.repeats_alike([fall for fall, _ in records], _REPEATS, _OF_ANOTHER)
    checks.append(fall_checks.levels_alike([fall for fall, _ in records]))
    told = {name for found in explain(checks, causes) for name in found.checks}
    checks = [
        replace(c, cause=_OTHERWISE.get(c.name, "")) if c.level and not c.cause and c.name not in told else c
        for c in checks
    ]
    if not records:
        checks.append(not_made("free-fall acceleration", "g", "a record of bounces"))
    compared = given.each([rows])
    inputs = _inputs(model, repeats)
    in_common = {name: Quantity(0.0, 1.0, "1") for row in compared for name in row.slopes if name not in inputs}
    unstated = _unstated_plate(compared, settings)
    return Scene(
        checks,
        causes,
        compared,
        inputs,
        in_common,
        basis,
        unstated,
        measured_by=judgements.measured_by(settings.sphere),
        alternatives=partial(
            of_drop, settings=settings, column=_simulated, **{name: given.get(name) for name in _SOURCES}
        ),
    )


def _simulated(row: Row) -> tuple[str, int] | None:
    """Return which result of a simulation a row compares, and of which impact."""
    for title, name in _OF_IMPACTS.items():
        if row.quantity.startswith(title):
            number = row.quantity.removeprefix(title)
            return name, int(number) - 1 if number else 0
    return None


def _unstated_plate(compared: Sequence[Row], settings: BallDrop) -> str:
    """Say which plate would explain a first bounce that returns too little, where none is stated.

    A plate of modal mass M takes e - (1 + e) m/(m + M) in place of e, as long as it hardly moves
    while it is struck.
    """
    by_name = {row.quantity: row for row in compared}
    first, lasts = by_name.get(f"{RESTITUTION}1"), by_name.get(f"{DURATION}1")
    if first is None or lasts is None or settings.plate is not None or settings.plate_from is not None:
        return ""
    less, model = -(first.difference or 0.0), first.model or 0.0
    is_of_material = abs(lasts.difference or 0.0) > _SHORTENED * (lasts.model or 0.0)
    if is_of_material or less <= _LESS * (first.u_difference or inf):
        return ""
    mass = settings.sphere.mass.value * ((1.0 + model) / less - 1.0)
    if not mass > _LIGHTEST_PLATE * settings.sphere.mass.value:
        return ""
    return (
        f"the session states no plate under the drop (plate or plate_from): one that swings with about "
        f"{quantity(mass, 'kg', 2)} would take that much of the first bounce"
    )


def _alone(
    checks: Sequence[Check],
    record: tuple[Fall, xr.Dataset],
    readings: Mapping[str, xr.Dataset | None],
    settings: BallDrop,
) -> list[Check]:
    """Explain one record that is wrong in another way than its repeats."""
    name = record[0].name
    header = readings.get(name)
    causes = [
        _of_one(cause, name, settings)
        for cause in _causes(settings, [] if header is None else [header], [name], [record])
    ]
    ranked = explain(checks, causes)
    if (
        not ranked
        and not 1 / _NO_FALL < float(record[0].values("fall_acceleration")) / settings.model.gravity.value < _NO_FALL
    ):
        return [replace(c, cause=_HELD_BACK, file=name, line=None, setting="") if c.level else c for c in checks]
    return with_causes(checks, ranked)


def _of_one(cause: Cause, name: str, settings: BallDrop) -> Cause:
    """Return a cause as it can be of one record: what is stated once for all of them is not wrong for it alone."""
    if cause.setting == "height":
        return replace(cause, say=lambda _: _OF_ANOTHER, file=name, setting="")
    if cause.file == settings.calibration and len(settings.laser) > 1:
        return replace(
            cause,
            say=lambda k: (
                f"lengths of {name} come out {too_large(k)}: its gain or display factor, or the angle of the sensor, "
                "was another one than for the other repeats"
            ),
            file=name,
            setting="",
        )
    return cause


def _is_of_some(of_records: Mapping[str, Sequence[Check]]) -> bool:
    """Tell whether what is wrong with some records is clearly in order with all others."""
    wrong = {name for name, checks in of_records.items() if any(c.level for c in checks)}
    told = {c.name for name in wrong for c in of_records[name] if c.level and np.isfinite(c.log_ratio)}
    others = [c for name, checks in of_records.items() if name not in wrong for c in checks if c.name in told]
    return bool(told and others) and all(abs(c.margin) < _FINE for c in others)


def _records(
    displacement: Sequence[xr.Dataset | None] | None, bounces: Sequence[xr.Dataset | None] | None, settings: BallDrop
) -> Iterator[tuple[Fall, xr.Dataset]]:
    triples = zip(settings.laser, displacement or (), bounces or (), strict=False)
    for name, moved, found in triples:
        if moved is not None and found is not None and found.sizes["impact"]:
            relative = float(moved.attrs["u_systematic_relative"])
            yield Fall(name, found, relative), moved


def _of_record(fall: Fall, moved: xr.Dataset, stiffness: Stiffness | None, settings: BallDrop) -> list[Check]:
    gravity = settings.model.gravity
    radius, mass = settings.sphere.radius.value, settings.sphere.mass.value
    speed, depth = (float(fall.bounces[of][0]) for of in ("incoming_speed", "penetration"))
    return [
        fall_checks.acceleration(fall, gravity),
        fall_checks.height(fall, settings.height),
        fall_checks.release(fall, moved),
        fall_checks.speed(fall, gravity),
        fall_checks.smooth_flights(fall),
        fall_checks.restitution(fall),
        fall_checks.apexes(fall),
        fall_checks.flights_alike(fall, gravity),
        fall_checks.touch_levels(fall),
        fall_checks.contact_duration(fall, radius, mass, stiffness, gravity),
        fall_checks.strain(fall.name, depth, radius, mass, speed),
        fall_checks.rest_level(fall, _sag(settings, stiffness)),
        fall_checks.direction(fall),
        fall_checks.ends_early(fall, float(moved["time"][-1])),
    ]


def _by_swing(check: Check, swing: Check, added: float, bounces: xr.Dataset | None) -> Check:
    """Blame a vibration that was seen before the release, and lasts, for what it adds to speeds and flights."""
    is_bent = check.name in _BENT_BY_SWINGS
    if check.name == fall_checks.SPEED and bounces is not None:
        is_bent = abs(expm1(check.log_ratio)) * float(bounces["incoming_speed"][0]) < 2 * added  # of touch and height
    return replace(check, level="doubtful", cause=swing.cause) if check.level and is_bent else check


def _stiffness(settings: BallDrop, model: xr.Dataset | None) -> Stiffness | None:
    """Return how stiff the contact is: as simulated, else that of the named material at a millisecond."""
    sphere = settings.sphere
    if model is not None and model.sizes["impact"]:
        is_measured = bool(judgements.measured_by(sphere))
        return Stiffness.of_model(model, sphere.radius.value, sphere.mass.value, is_measured=is_measured)
    if sphere.material is None:
        return None
    try:
        solid = load(sphere.material)
    except LabpipeError:
        return None
    return Stiffness.by_name(float(np.asarray(solid.relaxation(1e-3))) / (1 - float(solid.nu) ** 2))


def _sag(settings: BallDrop, stiffness: Stiffness | None) -> float:
    """Return the static approach of Hertz under the moving mass."""
    sphere, modulus = settings.sphere, 1e9 if stiffness is None else stiffness.modulus
    force = sphere.mass.value * settings.model.gravity.value
    return float((0.75 * force / (modulus * np.sqrt(sphere.radius.value))) ** (2 / 3))


def _inputs(model: xr.Dataset | None, repeats: xr.Dataset | None) -> dict[str, Quantity]:
    """Return values and uncertainties of what the model's rows depend on."""
    if model is None or "slope_input" not in model.coords:
        return {}
    relative = 0.0 if repeats is None else float(repeats.attrs["u_systematic_relative"])
    units = json.loads(model.attrs["input_units"])
    return {
        str(name): Quantity(float(value), float(u), unit)
        for name, value, u, unit in zip(
            model["slope_input"].values, model["input_value"].values, model["input_u"].values, units, strict=True
        )
    } | {SCALE: Quantity(1.0, relative, "1")}


def _causes(
    settings: BallDrop, readings: Sequence[xr.Dataset], names: Sequence[str], records: Sequence[tuple[Fall, xr.Dataset]]
) -> Iterator[Cause]:
    g, fall, v = "free-fall acceleration", "height of the fall", fall_checks.SPEED
    duration = "duration of the first contact"
    if readings:
        first = readings[0]
        header, file = str(first.attrs.get("header", "")), names[0]
        interval = float(first.attrs["sampling_interval"])
        line = line_of(header, "cycle", "period", "周期")
        given = settings.keyence.cycle is not None
        yield Cause(
            {g: -2.0, v: -1.0, duration: 1.0},
            times_over(
                "the sampling interval", interval, "s", "" if line is None or given else f"line {line} of {file}"
            ),
            SLIPS["interval"],
            file="" if given else file,
            line=None if given else line,
            setting="keyence.cycle" if given else "",
        )
        unit_line = line_of(header, "unit", "単位")
        yield Cause(
            {g: 1.0, fall: 1.0, v: 0.5},
            lambda k: (
                f"lengths come out {too_large(k)}: the unit, the decimal point or the display factor of "
                f"{file} is not what it says" + (f" (line {unit_line})" if unit_line else "")
            ),
            SLIPS["length"] + SLIPS["gain"],
            only_usual=True,
            file=file,
            line=unit_line,
        )
    if records:
        first_fall, moved = records[0]
        angle = float(moved["inclination"])
        cosine = cos(angle) * float(first_fall.values("fall_acceleration")) / settings.model.gravity.value
        if _LEAST_COSINE < cosine < 1.01:
            yield Cause(
                {g: 1.0, fall: 1.0, v: 0.5},
                lambda k: _inclined(angle, k, settings.calibration),
                file=settings.calibration,
                setting="values.inclination",
            )
        else:
            yield Cause(
                {g: 1.0, fall: 1.0, v: 0.5},
                lambda k: (
                    f"lengths come out {too_large(k)}: the scale of {settings.calibration} or the gain "
                    "of the sensor is not what it says"
                ),
                file=settings.calibration,
                setting="values.scale",
            )
    if fall_checks.gravity_stated(settings.model.gravity).level:
        yield Cause(
            {g: -1.0, v: -0.5},
            times_over("gravity", settings.model.gravity.value, "m/s2", "model.gravity in session.toml"),
            (settings.model.gravity.value / 9.81,),
            setting="model.gravity",
        )
    yield Cause(
        {fall: -1.0},
        times_over("the drop height", settings.height.value, "m", "height in session.toml"),
        SLIPS["decimal"],
        u=(settings.height.u or usual_uncertainty(settings.height)) / settings.height.value,
        setting="height",
    )


def _inclined(angle: float, factor: float, record: str) -> str:
    """Say which inclination would explain lengths that are a factor too large."""
    cosine = min(cos(angle) * factor, 1.0)
    right = acos(cosine) * 180 / pi
    more = ": it was corrected twice, by the controller too" if right < _LEVEL else ""
    return (
        f"the inclination of {angle * 180 / pi:.3g}° in {record} makes lengths {too_large(factor)}; "
        f"{right:.3g}° would be right{more}"
    )
