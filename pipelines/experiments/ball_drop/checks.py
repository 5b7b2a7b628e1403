"""Checks of a ball drop: free fall, stated height, order of bounces, contact, levels, repeats, and the record."""

import re
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from itertools import repeat
from math import acos, cos, degrees, sqrt

import numpy as np
import xarray as xr

from labpipe import signals
from labpipe.errors import TWO_CLOCKS, LabpipeError
from labpipe.judging import SLIPS, Cause, Check, explain, in_words, not_made, too_large, with_causes
from labpipe.materials import load
from labpipe.report import quantity
from labpipe.units import Quantity
from labpipe.workflow.context import Context
from pipelines.experiments.ball_drop.comparison import SCALE, rows
from pipelines.experiments.ball_drop.settings import BallDrop
from pipelines.experiments.shared import fall_checks, flight_checks, judgements, record_checks
from pipelines.experiments.shared.alternatives import SOURCES, of_drop
from pipelines.experiments.shared.counter_body import floor_under
from pipelines.experiments.shared.fall_checks import HEIGHT, Fall, G, Repeated
from pipelines.experiments.shared.given import Given
from pipelines.experiments.shared.judgements import Scene, Title, line_of
from pipelines.experiments.shared.model_inputs import inputs_of

_LEAST_COSINE = 0.7  # of an inclination that anybody would mount a sensor with
_SMEARED = "the controller averages or filters the readings over the time of a contact, which smears an impact"
_OF_ANOTHER = (
    "this repeat is of another height or another body: the file belongs to another experiment, or was named wrongly"
)
_OTHER_WAY = (
    "the sensor counts the other way than stated: sensor.direction in session.toml has the wrong sign "
    "(direction = -1 where the reading falls when the body rises)"
)
_REPEATS = (
    Repeated("drop_height", "height of the fall", "m"),
    Repeated("restitution", "first restitution", "1", of_two=0.05),
)
_FAILED = record_checks.CAUSES | {
    TWO_CLOCKS: flight_checks.TWO,
    "model": "a temperature, height or radius of session.toml is outside of what the material is known for",
    "bounces": "the recording holds no drop that is free: the wrong channel or file, a sensor that shakes, a body that "
    "was released before the trigger, or caught, a recording that ends too soon, or an average or filter of the "
    "controller that smears impacts",
}
_STEPS = ("readings", "displacement", "bounces", "repeats", "model", "comparison")
TITLES = {
    **fall_checks.OF_FALL,
    "stated height": Title("The measured fall equals the stated height.", (HEIGHT,)),
    "contact duration": Title("Hertz: t = 2.87 (m²/(R E*² v))^(1/5) for the stated sphere.", (fall_checks.DURATION,)),
    "level at rest": Title("The floor stays in place: the body touches and rests at one level.", ("level at rest",)),
    "repeats": Title("Repeats agree within their scatter.", ("repeats",)),
    **record_checks.OF_LASER,
}


@judgements.judging(*_STEPS, *SOURCES, rests_on=("sphere.material_from", "plate_from"), titles=TITLES)
def judgement(given: Given, basis: judgements.Basis, settings: BallDrop, context: Context) -> Scene:
    """Judge one ball drop; a step without a result is judged by its error."""
    readings, displacement, bounces, repeats, model, _ = map(given.get, _STEPS)
    sphere = settings.sphere
    read, moved, bounced = (
        dict(zip(settings.laser, found or repeat(None), strict=False)) for found in (readings, displacement, bounces)
    )
    of_traces, checks = record_checks.of_recordings(read, moved, bounced, settings, context, _FAILED)
    checks += [*of_traces, fall_checks.body_stated(sphere.radius.value, sphere.mass.value)]
    lacking = [(name, one) for name, one in read.items() if one is not None and bounced[name] is None]
    checks += [check for name, one in lacking for check in _other(name, one, settings)]
    records = [
        (Fall(name, found, float(one.attrs["u_systematic_relative"])), one)
        for name, one in moved.items()
        if one is not None and (found := bounced[name]) is not None and found.sizes["impact"]
    ]
    checks += [] if records else [not_made(G, "a record of bounces")]
    is_damaged = any(check.level == "impossible" for check in of_traces)
    causes = [] if is_damaged else list(_causes(settings, read, records))
    first_contact, u_modulus = _first_contact(settings, model), judgements.u_modulus(sphere)
    gravity, of_falls = settings.model.gravity, list[list[Check]]()
    floor = floor_under(settings.plate, given.get("plate"), sphere.mass)
    for fall, one in records:
        found = [
            fall_checks.acceleration(fall, gravity),
            fall_checks.height(fall, settings.height),
            fall_checks.restitution(fall),
            fall_checks.contact_duration(fall, first_contact, gravity, u_modulus),
            fall_checks.levels(fall, floor),
            fall_checks.direction(fall, _OTHER_WAY, setting="sensor.direction"),
            *(course := flight_checks.of_flights(fall, one)),
        ]
        lost = [c for c in of_traces if c.level and c.file == fall.name and c.name == record_checks.SINGLE_ROWS]
        wrong = {c.name for c in [*found, *lost] if c.level}
        is_long = any(c.name == fall_checks.DURATION and c.level and c.log_ratio > 0.0 for c in found)
        is_long &= not is_damaged
        # lost rows explain their effects, but no contact that lasts longer; nor does g agree on another clock
        cause = _SMEARED if is_long and G not in wrong and len(wrong) > 1 else lost[0].cause if lost else ""
        if course[0].cause.startswith(flight_checks.VIBRATES):  # which looks like a drift before the release
            cause, drift = course[0].cause, record_checks.BEGINNING
            checks = [replace(c, level=None) if (c.name, c.file) == (drift, fall.name) else c for c in checks]
        found = judgements.because(found, cause, *wrong, file=fall.name)
        of_falls.append(found)
    checks += _of_their_files(of_falls, records, read, settings)
    checks += _repeats([fall for fall, _ in records])
    if any(c.name == HEIGHT and c.is_made and not c.level for c in checks):  # the other repeats fall as far as stated
        checks = [
            replace(c, otherwise=_OF_ANOTHER, file=c.recording, setting="") if c.name == HEIGHT and c.level else c
            for c in checks
        ]
    compared, inputs = given.each([rows]), inputs_of(model)
    if inputs:
        inputs[SCALE] = Quantity(1.0, 0.0 if repeats is None else float(repeats.attrs["u_systematic_relative"]), "1")
    in_common = {name: Quantity(0.0, 1.0, "1") for row in compared for name in row.slopes if name not in inputs}
    return Scene(
        checks,
        causes,
        compared,
        inputs,
        in_common,
        basis,
        measured_by=judgements.measured_by(sphere),
        alternatives=partial(of_drop, given=given, settings=settings),
    )


def _other(file: str, readings: xr.Dataset, settings: BallDrop) -> Iterator[Check]:
    """Look for the drop that a recording does not hold among the other outputs of its file."""
    own = settings.sensor.output
    for output in (str(name) for name in readings if re.fullmatch(r"out\d+", str(name)) and name != own):
        if (trace := record_checks.Trace.of(file, readings, output)) is None:
            continue
        series = xr.DataArray(trace.reading, {"time": trace.time}, ("time",))
        with suppress(LabpipeError), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            fall = Fall(file, signals.bounces(series), 1.0 - _LEAST_COSINE)  # along any line of sight
            if fall_checks.acceleration(fall, settings.model.gravity).level is None:
                height, g = fall.value("drop_height")[0], fall.value("fall_acceleration")[0]
                text = f"{file}: no drop in {own}, but {output} holds one from {quantity(height, 'm')} with "
                text += f"{quantity(g, 'm/s2')} along the line of sight"
                cause = f"{own} of this file is another signal: the drop is in {output}; export that output alone, or "
                cause += f'give sensor.output = "{output}" where all recordings have it'
                yield Check("readings", text, "impossible", cause=cause, file=file, recording=file)


def _repeats(falls: Sequence[Fall]) -> list[Check]:
    """Compare the repeats; where they fall alike and bounce differently, no height is wrong."""
    of_height, of_bounce = fall_checks.repeats_agree(falls, _REPEATS, _OF_ANOTHER)
    if of_height.level or not of_bounce.level:
        return [of_height, of_bounce]
    later = [float(fall.values("restitution")[1]) for fall in falls if fall.values("restitution").size > 1]
    first = np.ptp([fall.value("restitution")[0] for fall in falls])
    cause = "it falls as far as the others, but is another body, or at another temperature: the file is of another drop"
    if later and np.ptp(later) < 0.5 * first:
        cause = "impact 1 alone, since the bodies fall alike and bounce alike at impact 2: the body was touched or hit "
        cause += "something at its side, or rows were lost there"
    either = "either of the two files may be the one: " * (len(falls) == 2)
    return [of_height, replace(of_bounce, cause=either + cause)]


def _of_their_files(
    of_falls: Sequence[list[Check]],
    records: Sequence[tuple[Fall, xr.Dataset]],
    readings: Mapping[str, xr.Dataset | None],
    settings: BallDrop,
) -> list[Check]:
    """Explain what is wrong in some recordings alone by interval, unit or gain of their files."""
    flagged = [any(c.level for c in found) for found in of_falls]
    if not any(flagged) or all(flagged):
        return [check for found in of_falls for check in found]
    everything: list[Check] = []
    for found, (fall, moved) in zip(of_falls, records, strict=True):
        causes = list(_causes(settings, {fall.name: readings.get(fall.name)}, [(fall, moved)]))
        scaled = judgements.wrong_lengths(f"the gain or display factor of {fall.name} is not that of the other repeats")
        causes.append(Cause({G: 1.0, HEIGHT: 1.0}, scaled, file=fall.name))
        everything += with_causes(found, explain(found, [c for c in causes if c.file == fall.name]))
    return everything


def _first_contact(settings: BallDrop, model: xr.Dataset | None) -> tuple[float, float] | None:
    """Return duration and speed of the first impact by the model, or by Hertz for a solid that is known by its name.

    t = 2.868 (m^2 / (R E*^2 v))^(1/5), Johnson, Contact Mechanics (1985), eq. (11.24), with E* in an impact of 1 ms.
    """
    if model is not None and model.sizes["impact"]:
        return float(model["contact_duration"][0]), float(model["impact_speed"][0])
    sphere = settings.sphere
    if sphere.material is None:
        return None
    try:
        solid = load(sphere.material)
    except LabpipeError:
        return None
    modulus = float(np.asarray(solid.relaxation(1e-3))) / (1 - float(solid.nu) ** 2)
    v = sqrt(2.0 * settings.model.gravity.value * settings.height.value)
    return 2.868 * (sphere.mass.value**2 / (sphere.radius.value * modulus**2 * v)) ** 0.2, v


def _causes(
    settings: BallDrop, readings: Mapping[str, xr.Dataset | None], records: Sequence[tuple[Fall, xr.Dataset]]
) -> Iterator[Cause]:
    record, lasts, sphere = settings.calibration, fall_checks.DURATION, settings.sphere
    of_lengths = partial(Cause, {G: 1.0, HEIGHT: 1.0})

    file, first = next(((name, found) for name, found in readings.items() if found is not None), ("", None))
    if first is not None:
        yield judgements.wrong_interval({G: -2.0, lasts: 1.0}, file, first, settings.keyence.cycle is not None)
        line, usual = line_of(str(first.attrs.get("header", "")), "unit", "単位"), SLIPS["length"] + SLIPS["gain"]
        say = judgements.wrong_lengths(
            f"the unit, the decimal point or the display factor of {file} is not what it says"
            f"{f' (line {line})' * bool(line)}"
        )
        yield of_lengths(say, usual, only_usual=True, file=file, line=line)
    if records:
        fall, moved = records[0]
        angle = float(moved["inclination"])
        cosine = cos(angle) * float(fall.values("fall_acceleration")) / settings.model.gravity.value

        def inclined(k: float) -> str:
            right = degrees(acos(min(cos(angle) * k, 1.0)))
            # none is left within the uncertainty of the scale
            twice = ": it was corrected twice, by the controller too" * (cos(angle) * k > 1.0 - 2.0 * fall.relative)
            text = f"the inclination of {degrees(angle):.3g}° in {record} makes lengths {too_large(k)}"
            return f"{text}; {right:.3g}° would be right{twice}"

        if _LEAST_COSINE < cosine < 1.01:
            yield of_lengths(inclined, file=record, setting="values.inclination")
        else:
            say = judgements.wrong_lengths(f"the scale of {record} or the gain of the sensor is not what it says")
            yield of_lengths(say, file=record, setting="values.scale")
    yield judgements.stated_wrongly({HEIGHT: -1.0}, "the drop height", settings.height, "height")
    # Hertz: t ~ m^0.4 R^-0.2 E^-0.4
    mass = judgements.stated_wrongly({lasts: -0.4}, "the moving mass", sphere.mass, "sphere.mass", "mass")
    radius = judgements.stated_wrongly({lasts: 0.2}, "the radius", sphere.radius, "sphere.radius", "size")
    # of a radius by which the sphere would weigh more than all that falls
    light = (k for k in radius.usual if not fall_checks.body_stated(sphere.radius.value / k, sphere.mass.value).level)
    yield from (replace(typed, only_usual=True) for typed in (mass, replace(radius, usual=tuple(light))) if typed.usual)

    def of_material(k: float) -> str:
        text = f"the sphere is about {in_words(1 / k, 2)} times as stiff as stated: of another material or temperature"
        return text + f"; or {_SMEARED}" * (k > 1.0)

    yield Cause({lasts: 0.4}, of_material, setting="sphere")
