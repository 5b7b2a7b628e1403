"""Whether a ball drop can be believed: free fall, stated height, order of bounces, repeats."""

import json
from collections.abc import Iterator, Sequence
from math import pi

import numpy as np
import xarray as xr

from labpipe.errors import LabpipeError
from labpipe.judging import Cause, Check, not_made
from labpipe.materials import load
from labpipe.units import Quantity
from labpipe.workflow.context import Context
from pipelines.experiments.ball_drop.comparison import SCALE, rows
from pipelines.experiments.ball_drop.settings import BallDrop
from pipelines.experiments.shared import fall_checks, judgements
from pipelines.experiments.shared.fall_checks import Fall
from pipelines.experiments.shared.judgements import Scene, line_of, times_over

_UNITS = (1e3, 1e-3, 1e6, 1e-6, 10.0, 0.1, 100.0, 0.01, 25.4, 1 / 25.4, 0.0254, 1 / 0.0254)
_GAINS = (2.0, 0.5)
_INTERVALS = (2.0, 0.5, 4.0, 0.25, 5.0, 0.2, 2.5, 0.4, 10.0, 0.1, 1e3, 1e-3)
_REPEATS = (
    ("drop_height", "height of the fall", "m"),
    ("restitution", "first restitution", "1"),
    ("fall_acceleration", "free-fall acceleration", "m/s2"),
)
_FAILED = {
    "readings": "the file is not what the session says, or was not copied whole",
    "displacement": "the calibration record does not belong to this recording",
    "bounces": "the recording holds no drop: the wrong channel or file, a body that was released "
    "before the trigger, or a recording that ends too soon",
}


def judgement(
    readings: list[xr.Dataset | None] | None,
    displacement: list[xr.Dataset | None] | None,
    bounces: list[xr.Dataset | None] | None,
    repeats: xr.Dataset | None,
    model: xr.Dataset | None,
    comparison: xr.Dataset | None,
    *,
    settings: BallDrop,
    context: Context,
) -> xr.Dataset:
    """Judge one ball drop; what gave no result is judged by that."""
    records = list(_records(readings, displacement, bounces, settings))
    checks: list[Check] = judgements.failed_steps(context, _FAILED)
    for fall, moved in records:
        checks += _of_record(fall, moved, settings)
    checks += fall_checks.repeats_alike([fall for fall, _ in records], _REPEATS)
    if not records:
        checks.append(not_made("free-fall acceleration", "g", "a record of bounces"))
    compared = []
    if repeats is not None and model is not None and comparison is not None:
        compared = list(rows(comparison, repeats, model, settings=settings))
    headers = [d for d in readings or () if d is not None]
    causes = list(_causes(settings, headers, [moved for _, moved in records]))
    return judgements.judgement(Scene(checks, causes, compared, _inputs(model, repeats)))


def _records(
    readings: Sequence[xr.Dataset | None] | None,
    displacement: Sequence[xr.Dataset | None] | None,
    bounces: Sequence[xr.Dataset | None] | None,
    settings: BallDrop,
) -> Iterator[tuple[Fall, xr.Dataset]]:
    del readings
    triples = zip(settings.laser, displacement or (), bounces or (), strict=False)
    for name, moved, found in triples:
        if moved is not None and found is not None and found.sizes["impact"]:
            relative = float(moved.attrs["u_systematic_relative"])
            yield Fall(name, found, relative), moved


def _of_record(fall: Fall, moved: xr.Dataset, settings: BallDrop) -> list[Check]:
    gravity = settings.model.gravity
    raw, time = moved["displacement_raw"].values, moved["time"].values
    still = time < float(fall.bounces["release_time"])
    sphere = settings.sphere
    return [
        fall_checks.acceleration(fall, gravity),
        fall_checks.height(fall, settings.height),
        fall_checks.speed(fall, gravity),
        fall_checks.restitution(fall),
        fall_checks.apexes(fall),
        fall_checks.flights_alike(fall, gravity),
        fall_checks.contact_duration(fall, sphere.radius.value, sphere.mass.value, _contact_modulus(settings)),
        fall_checks.rest_level(fall, _sag(settings)),
        fall_checks.held_readings(fall.name, time, raw, float(moved.attrs["resolution"])),
        fall_checks.hum(fall.name, time[still], raw[still], float(moved.attrs["noise"])),
    ]


def _contact_modulus(settings: BallDrop) -> float | None:
    """Return the modulus of the named material at a millisecond, over 1 - nu^2."""
    if settings.sphere.material is None:
        return None
    try:
        solid = load(settings.sphere.material)
    except LabpipeError:
        return None
    return float(np.asarray(solid.relaxation(1e-3))) / (1 - float(solid.nu) ** 2)


def _sag(settings: BallDrop) -> float:
    """Return the static approach of Hertz under the moving mass."""
    sphere, modulus = settings.sphere, _contact_modulus(settings) or 1e9
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


def _causes(settings: BallDrop, readings: Sequence[xr.Dataset], moved: Sequence[xr.Dataset]) -> Iterator[Cause]:
    g, fall, v = "free-fall acceleration", "height of the fall", "speed of the first impact"
    duration = "duration of the first contact"
    if readings:
        first = readings[0]
        header, file = str(first.attrs.get("header", "")), settings.laser[0]
        interval = float(first.attrs["sampling_interval"])
        line = line_of(header, "cycle", "period", "周期")
        given = settings.keyence.cycle is not None
        yield Cause(
            {g: -2.0, v: -1.0, duration: 1.0},
            times_over(
                "the sampling interval", interval, "s", "" if line is None or given else f"line {line} of {file}"
            ),
            _INTERVALS,
            file="" if given else file,
            line=None if given else line,
            setting="keyence.cycle" if given else "",
        )
        unit_line = line_of(header, "unit", "単位")
        yield Cause(
            {g: 1.0, fall: 1.0, v: 0.5},
            lambda k: (
                f"lengths come out {k:.4g} times too large: the unit or display factor of "
                f"{file} is not what it says" + (f" (line {unit_line})" if unit_line else "")
            ),
            (*_UNITS, *_GAINS),
            file=file,
            line=unit_line,
        )
    if moved:
        angle = float(moved[0]["inclination"])
        yield Cause(
            {g: 1.0, fall: 1.0, v: 0.5},
            lambda k: (
                f"the inclination of {angle * 180 / pi:.3g}° in {settings.calibration} makes "
                f"lengths {k:.4g} times too large: it is wrong, is its complement, or was corrected "
                "twice"
            ),
            tuple(fall_checks.usual_angles(angle)),
            file=settings.calibration,
            setting="values.inclination",
        )
    yield Cause(
        {fall: -1.0},
        times_over("the drop height", settings.height.value, "m", "height in session.toml"),
        (10.0, 0.1, 2.0, 0.5),
        setting="height",
    )
    yield Cause(
        {duration: -0.4},
        times_over("the moving mass", settings.sphere.mass.value, "kg", "sphere.mass in session.toml"),
        (1e3, 1e-3, 100.0, 0.01, 10.0, 0.1),
        only_usual=True,
        setting="sphere.mass",
    )
