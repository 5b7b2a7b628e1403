"""Checks of a ball drop: free fall, stated height, order of bounces, contact, levels, repeats, and the record."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import repeat
from math import acos, cos, degrees, inf

import numpy as np
import xarray as xr

from labpipe.errors import LabpipeError
from labpipe.judging import SLIPS, Cause, Check, explain, not_made, stated, too_large, with_causes
from labpipe.materials import load
from labpipe.report import quantity
from labpipe.units import Quantity
from labpipe.workflow.context import Context
from pipelines.experiments.ball_drop.comparison import DURATION, RESTITUTION, SCALE, rows
from pipelines.experiments.ball_drop.settings import BallDrop
from pipelines.experiments.shared import fall_checks, judgements, record_checks
from pipelines.experiments.shared.alternatives import of_drop
from pipelines.experiments.shared.comparison_rows import Row
from pipelines.experiments.shared.drop_model import inputs_of
from pipelines.experiments.shared.exact_values import usual_uncertainty
from pipelines.experiments.shared.fall_checks import BY_NAME, HEIGHT, Fall, G, Stiffness
from pipelines.experiments.shared.given import Given
from pipelines.experiments.shared.judgements import Scene, Title, line_of, times_over
from pipelines.experiments.shared.record_checks import Trace

_LEAST_COSINE = 0.7  # of an inclination that anybody would mount a sensor with
_LEVEL = 3.0  # degrees
_LIGHTEST = 5.0  # times the falling mass: a lighter plate would be hit again before the body leaves
_LESS, _SHORTENED = 2.0, 0.1
"""Standard uncertainties by which a plate must lower the first restitution to be named where all bounces differ, and
the part of a contact's duration that it changes at most."""
_FINE = 2.0  # standard uncertainties within which a record is in order where another is not
_SMEARED = (HEIGHT, fall_checks.DURATION)
_OF_ANOTHER = (
    "this repeat is of another height or another body: the file belongs to another experiment, or was named wrongly"
)
_OTHER_WAY = (
    "the sensor counts the other way than stated: sensor.direction in session.toml has the wrong sign "
    "(direction = -1 where the reading falls when the body rises)"
)
_OF_IMPACTS = {
    RESTITUTION: "restitution",
    DURATION: "contact_duration",
    "speed of the first impact": "impact_speed",
    "penetration of the first impact": "penetration",
}
"""Results of a simulation by the beginning of the name of a compared quantity."""
_OTHERWISE = {
    G: "the body did not fly freely (a guide that rubs, a thread), or bench or sensor moved",
    HEIGHT: "height in session.toml is not that of this drop, the body did not fall freely (a guide that rubs, a "
    "thread, a hand), or bench or sensor moved with it",
}
"""Cause of a fall that no factor of time, length or height explains."""
_REPEATS = (
    ("drop_height", "height of the fall", "m"),
    ("restitution", "first restitution", "1"),
    ("fall_acceleration", G, "m/s2"),
)
_FAILED = record_checks.CAUSES | {
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
        (G, "durations of the flights", "direction of the fall"),
    ),
    "stated height": Title("The measured fall equals the stated height.", (HEIGHT,)),
    "order of the bounces": Title(
        "0 < e < 1: every rebound is lower than the one before.", ("coefficients of restitution",)
    ),
    "contact duration": Title("Hertz: t = 2.87 (m²/(R E*² v))^(1/5) for the stated sphere.", (fall_checks.DURATION,)),
    "level at rest": Title("The floor stays in place: the body rests where it first touched.", ("level at rest",)),
    "repeats": Title("Repeats agree within their scatter.", ("repeats",)),
    **record_checks.OF_LASER,
}


@judgements.judging(*_STEPS, *_SOURCES, rests_on=("sphere.material_from", "plate_from"), titles=TITLES)
def judgement(given: Given, basis: judgements.Basis, settings: BallDrop, context: Context) -> Scene:
    """Judge one ball drop; a step without a result is judged by its error."""
    readings, displacement, bounces, repeats, model, _ = map(given.get, _STEPS)
    sphere, gravity = settings.sphere, settings.model.gravity
    read, moved, bounced = (
        dict(zip(settings.laser, found or repeat(None), strict=False)) for found in (readings, displacement, bounces)
    )
    traces = [
        trace
        for name, one in read.items()
        if one is not None and (trace := Trace.of(name, one, settings.sensor.output)) is not None
    ]
    of_traces = [
        check
        for trace in traces
        for check in record_checks.of_readings(trace, gravity.value, moved[trace.name], bounced[trace.name])
    ]
    of_traces.append(record_checks.shared_rows(traces))
    checks = [record_checks.placed(c, settings.calibration) for c in judgements.failed_steps(context, _FAILED)]
    values = [("height", settings.height), ("sphere.radius", sphere.radius), ("sphere.mass", sphere.mass)]
    checks += [*of_traces, *judgements.uncertainties_stated(values)]
    checks.append(fall_checks.body_stated(sphere.radius.value, sphere.mass.value))
    checks += record_checks.of_record(moved, settings.calibration)
    records = [
        (Fall(name, found, float(one.attrs["u_systematic_relative"])), one)
        for name, one in moved.items()
        if one is not None and (found := bounced[name]) is not None and found.sizes["impact"]
    ]
    if not records:
        checks.append(not_made(G, "a record of bounces"))
    is_damaged = any(check.level == "impossible" for check in of_traces)
    causes = [] if is_damaged else list(_causes(settings, read, records))
    stiffness = _stiffness(settings, model)
    of_falls = [_of_fall(fall, one, stiffness, settings, of_traces) for fall, one in records]
    checks += _explained(of_falls, records, read, causes, settings)
    checks += fall_checks.repeats_agree([fall for fall, _ in records], _REPEATS, _OF_ANOTHER)
    named = {name for found in explain(checks, causes) for name in found.checks}
    checks = [
        replace(c, cause=_OTHERWISE.get(c.name, "")) if c.level and not c.cause and c.name not in named else c
        for c in checks
    ]
    compared = given.each([rows])
    inputs = inputs_of(model)
    if inputs:
        relative = 0.0 if repeats is None else float(repeats.attrs["u_systematic_relative"])
        inputs[SCALE] = Quantity(1.0, relative, "1")
    in_common = {name: Quantity(0.0, 1.0, "1") for row in compared for name in row.slopes if name not in inputs}
    sources = {name: given.get(name) for name in _SOURCES}
    return Scene(
        checks,
        causes,
        compared,
        inputs,
        in_common,
        basis,
        _unstated_plate(compared, settings),
        measured_by=judgements.measured_by(sphere),
        alternatives=partial(of_drop, settings=settings, column=_simulated, **sources),
    )


def _of_fall(
    fall: Fall, moved: xr.Dataset, stiffness: Stiffness | None, settings: BallDrop, of_traces: Sequence[Check]
) -> list[Check]:
    """Evaluate all redundancies of one recording; lost rows, or an averaging controller, explain their effects."""
    gravity, radius, mass = settings.model.gravity, settings.sphere.radius.value, settings.sphere.mass.value
    modulus = 1e9 if stiffness is None else stiffness.modulus
    sag = float((0.75 * mass * gravity.value / (modulus * np.sqrt(radius))) ** (2 / 3))  # Hertz, under the weight
    end, count = quantity(float(moved["time"][-1]), "s"), fall.bounces.sizes["impact"]
    ended = stated(
        "end of the record",
        f"{fall.name}: the record ends at {end}, after {count} impact{'s' * (count > 1)}",
        None if count > 1 else "note",
        cause="the recording ends too soon, in the first flight",
        file=fall.name,
    )
    checks = [
        fall_checks.acceleration(fall, gravity),
        fall_checks.height(fall, settings.height),
        fall_checks.restitution(fall),
        fall_checks.flight_durations(fall, gravity),
        fall_checks.contact_duration(fall, radius, mass, stiffness, gravity),
        fall_checks.rest_level(fall, sag),
        fall_checks.direction(fall, _OTHER_WAY, setting="sensor.direction"),
        ended,
    ]
    blamed = {record_checks.SINGLE_ROWS: {c.name for c in checks}, record_checks.SMOOTHED: _SMEARED}
    for wrong in of_traces:
        if wrong.level and wrong.file == fall.name and wrong.name in blamed:
            checks = judgements.because(checks, wrong.cause, *blamed[wrong.name], file=fall.name)
    return checks


def _explained(
    of_falls: Sequence[list[Check]],
    records: Sequence[tuple[Fall, xr.Dataset]],
    readings: Mapping[str, xr.Dataset | None],
    causes: Sequence[Cause],
    settings: BallDrop,
) -> list[Check]:
    """Explain the recordings together, or one by one where a mistake is of some of them alone."""
    everything = [check for found in of_falls for check in found]
    wrong = [any(c.level for c in found) for found in of_falls]
    named = {
        c.name for f, w in zip(of_falls, wrong, strict=True) if w for c in f if c.level and np.isfinite(c.log_ratio)
    }
    others = [c for f, w in zip(of_falls, wrong, strict=True) if not w for c in f if c.name in named]
    is_of_some = bool(named and others) and all(abs(c.margin) < _FINE for c in others)
    if causes and (is_of_some or not explain(everything, causes)):
        everything = []
        for found, record in zip(of_falls, records, strict=True):
            name = record[0].name
            alone = [_of_one(c, name, settings) for c in _causes(settings, {name: readings.get(name)}, [record])]
            everything += with_causes(found, explain(found, alone))
    # a time or a length that is wrong makes the contact of the right body too long
    for best in explain(everything, causes)[:1]:
        place = {"file": best.cause.file, "line": best.cause.line, "setting": best.cause.setting}
        moved = [name for name in best.checks if name == fall_checks.DURATION]
        everything = judgements.because(everything, best.sentence, *moved, **place)
    return everything


def _of_one(cause: Cause, name: str, settings: BallDrop) -> Cause:
    """Return a cause as it can be of one recording: a value that is stated once for all of them is not wrong for it."""
    if cause.setting == "height":
        return replace(cause, say=lambda _: _OF_ANOTHER, file=name, setting="")
    if cause.file != settings.calibration or len(settings.laser) == 1:
        return cause
    why = "its gain or display factor, or the angle of the sensor, was another one than for the other repeats"
    return replace(cause, say=lambda k: f"lengths of {name} come out {too_large(k)}: {why}", file=name, setting="")


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
    while it is struck, and changes the contact's duration by t ~ (1 + m/M)^-0.4.
    """
    by_name = {row.quantity: row for row in compared}
    first, lasts = by_name.get(f"{RESTITUTION}1"), by_name.get(f"{DURATION}1")
    if first is None or lasts is None or settings.plate is not None or settings.plate_from is not None:
        return ""
    less, own = -(first.difference or 0.0), settings.sphere.mass.value
    is_of_material = abs(lasts.difference or 0.0) > _SHORTENED * (lasts.model or 0.0)
    if is_of_material or less <= _LESS * (first.u_difference or inf):
        return ""
    mass = own * ((1.0 + (first.model or 0.0)) / less - 1.0)
    text = "the session states no plate under the drop (plate or plate_from): one that swings with about "
    return f"{text}{quantity(mass, 'kg', 2)} would take that much of the first bounce" if mass > _LIGHTEST * own else ""


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
    return Stiffness(float(np.asarray(solid.relaxation(1e-3))) / (1 - float(solid.nu) ** 2), BY_NAME)


def _causes(
    settings: BallDrop, readings: Mapping[str, xr.Dataset | None], records: Sequence[tuple[Fall, xr.Dataset]]
) -> Iterator[Cause]:
    record, of_lengths = settings.calibration, {G: 1.0, HEIGHT: 1.0}
    file, first = next(((name, found) for name, found in readings.items() if found is not None), ("", None))
    if first is not None:
        header, interval = str(first.attrs.get("header", "")), float(first.attrs["sampling_interval"])
        line, unit_line = line_of(header, "cycle", "period", "周期"), line_of(header, "unit", "単位")
        given = settings.keyence.cycle is not None
        where = "" if line is None or given else f"line {line} of {file}"
        yield Cause(
            {G: -2.0, fall_checks.DURATION: 1.0},
            times_over("the sampling interval", interval, "s", where),
            SLIPS["interval"],
            file="" if given else file,
            line=None if given else line,
            setting="keyence.cycle" if given else "",
        )
        of_unit = f"the unit, the decimal point or the display factor of {file} is not what it says"
        of_unit += f" (line {unit_line})" if unit_line else ""
        yield Cause(
            of_lengths,
            lambda k: f"lengths come out {too_large(k)}: {of_unit}",
            SLIPS["length"] + SLIPS["gain"],
            only_usual=True,
            file=file,
            line=unit_line,
        )
    if records:
        fall, moved = records[0]
        angle = float(moved["inclination"])
        cosine = cos(angle) * float(fall.values("fall_acceleration")) / settings.model.gravity.value
        of_scale = f"the scale of {record} or the gain of the sensor is not what it says"

        def inclined(k: float) -> str:
            right = degrees(acos(min(cos(angle) * k, 1.0)))
            twice = ": it was corrected twice, by the controller too" if right < _LEVEL else ""
            text = f"the inclination of {degrees(angle):.3g}° in {record} makes lengths {too_large(k)}"
            return f"{text}; {right:.3g}° would be right{twice}"

        if _LEAST_COSINE < cosine < 1.01:
            yield Cause(of_lengths, inclined, file=record, setting="values.inclination")
        else:
            yield Cause(
                of_lengths,
                lambda k: f"lengths come out {too_large(k)}: {of_scale}",
                file=record,
                setting="values.scale",
            )
    yield Cause(
        {HEIGHT: -1.0},
        times_over("the drop height", settings.height.value, "m", "height in session.toml"),
        SLIPS["decimal"],
        u=(settings.height.u or usual_uncertainty(settings.height)) / settings.height.value,
        setting="height",
    )
