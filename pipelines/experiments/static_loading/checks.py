"""Whether a static loading can be believed: steps against loads, creep, sphere, and readings."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from math import hypot, log, nan, sqrt

import numpy as np
import xarray as xr

from labpipe.judging import (
    SLIPS,
    Cause,
    Check,
    Level,
    bounded,
    compared,
    explain,
    in_words,
    not_made,
    stated,
    too_large,
)
from labpipe.report import quantity
from labpipe.units import Quantity
from labpipe.workflow.context import Context
from pipelines.experiments.shared import judgements, record_checks
from pipelines.experiments.shared.fall_checks import shown
from pipelines.experiments.shared.given import Given
from pipelines.experiments.shared.judgements import Scene, Title, line_of
from pipelines.experiments.shared.material_inputs import material_inputs
from pipelines.experiments.shared.record_checks import Trace
from pipelines.experiments.static_loading.comparison import DRIFT, LOADS, MODULUS, SCALE, TOUCH, rows
from pipelines.experiments.static_loading.load_steps import SIDE, settled, steps_anywhere, touch_apart, valid
from pipelines.experiments.static_loading.lost_readings import common_shift, uneven
from pipelines.experiments.static_loading.measured import spans
from pipelines.experiments.static_loading.settings import StaticLoading
from pipelines.experiments.static_loading.suspects import likeliest

MATERIAL, RADIUS_GIVEN = "approach against the material", "contact radius that is given"
_SMALL_STEP = 0.3  # of the smallest step of a load, below which one more may be a knock
_FIT = 0.25  # of the noise: a misfit that a creep law of few terms may leave
_PLAUSIBLE = (1e6, 5e10)  # Pa, contact moduli of whatever is loaded
_OTHER_GRADE, _NO_GRADE = 3.0, 30.0  # factors between moduli of one polymer that are much, that are too much
_DIAMETER = 0.02  # by which a factor of 2 in the radius may be missed, of the logarithm of an approach
_SAME = 0.1  # by which the times of the loads may scatter about one factor
_LENGTHS = (1e3, 1e-3, 10.0, 0.1, 25.4, 1 / 25.4)
"""Fewer than other kinds look for: a mass in another unit looks like a length that is 100 times too large."""
_FAILED = {
    "steps": "the record does not hold the loads that session.toml states",
    "approach": "the record does not hold the loads that session.toml states",
}


_STEPS = ("readings", "displacement", "steps", "approach", "model", "comparison")


TITLES = {
    "steps and times of the loads": Title(
        "The readings step when a load is put on, and only then.", ("steps of the record", "times of the loads")
    ),
    "one creep law for all loads": Title(
        "One creep compliance and one first touch describe all loads (Lee and Radok).", ("record against its loads",)
    ),
    "creep": Title("Under a constant load a contact creeps ever more slowly.", ("direction of creep", "rate of creep")),
    "stiffness": Title(
        "Approach = (3 F J*/4)^(2/3) R^(-1/3) for the stated sphere, loads and material.",
        ("stiffness of the sphere", MATERIAL, RADIUS_GIVEN, "size of the contact"),
    ),
    **record_checks.OF_LASER,
}


@judgements.judging(*_STEPS, rests_on=("sphere.material_from",), titles=TITLES)
def judgement(given: Given, basis: judgements.Basis, settings: StaticLoading, context: Context) -> Scene:
    """Judge one static loading; what gave no result is judged by that."""
    readings, displacement = given.get("readings"), given.get("displacement")
    checks = [_explained(c, readings, displacement, settings) for c in judgements.failed_steps(context, _FAILED)]
    checks += given.ask(_of_readings)
    masses = [(f"loads[{i}].mass", load.mass) for i, load in enumerate(settings.loads)]
    checks += judgements.uncertainties_stated([("sphere.radius", settings.sphere.radius), *masses])
    checks += record_checks.of_record({settings.laser: displacement}, settings.calibration)
    if displacement is None or given.get("steps") is None:
        checks.append(not_made("steps of the record", "steps that were found"))
    else:
        checks += given.each((_unstated, _misfit, _forwards, _slows_down, _compliance, _times))
    checks += given.each((_smaller_than_the_sphere, _of_material, _given_radius))
    causes = _causes(settings)
    if not any(MATERIAL in found.checks for found in explain(checks, causes)):
        checks = [_another_material(check) if check.name == MATERIAL else check for check in checks]
    inputs, known_by = given.ask(_inputs), judgements.measured_by(settings.sphere)
    return Scene(checks, causes, given.each([rows]), inputs, basis=basis, measured_by=known_by)


def _inputs(
    settings: StaticLoading,
    displacement: xr.Dataset | None = None,
    steps: xr.Dataset | None = None,
    model: xr.Dataset | None = None,
) -> dict[str, Quantity]:
    """Return what all rows share, with its uncertainty."""
    relative = 0.0 if displacement is None else float(displacement.attrs["u_systematic_relative"])
    return {
        "radius": settings.sphere.radius,
        SCALE: Quantity(1.0, relative, "1"),
        TOUCH: Quantity(0.0, 0.0 if steps is None else touch_apart(steps)[0], "m"),
        DRIFT: Quantity(0.0, settings.steps.drift.value, "m"),
        MODULUS: Quantity(1.0, 0.0, "1"),
        LOADS: Quantity(1.0, 0.0, "1"),
    } | material_inputs(model)


def _explained(
    failed: Check, readings: xr.Dataset | None, displacement: xr.Dataset | None, settings: StaticLoading
) -> Check:
    """Give a step that failed its place, and the cause that the record itself shows."""
    failed = record_checks.placed(failed, settings.calibration, settings.laser)
    if not failed.is_made or failed.line is not None:
        return failed
    if failed.name == "step displacement":
        return _too_short(failed, readings, settings) or failed
    if failed.name == "step steps" and displacement is not None:
        return _of_steps(failed, readings, displacement, settings)
    return failed


def _of_steps(failed: Check, readings: xr.Dataset | None, displacement: xr.Dataset, settings: StaticLoading) -> Check:
    """Say why the steps of a record are not those of the loads."""
    at, sizes = steps_anywhere(displacement)
    _, up = steps_anywhere(displacement, -1)
    wanted = len(settings.loads) - 1
    if up.size >= wanted and (up.size > sizes.size or up.sum() > sizes.sum()):
        cause = (
            "the body rises where loads are added: sensor.direction in session.toml has the wrong sign, or the record "
            "was reversed in time"
        )
        return replace(failed, cause=cause, setting="sensor.direction")
    if at.size == wanted and (factor := _one_factor(at, settings)) is not None:
        return _of_times(failed, factor, readings, settings)
    if at.size != wanted:
        cause = (
            f"the record shows {at.size} steps{_listed(at)}, session.toml states {wanted} loads after the first: one "
            "is left out or too many"
        )
        return replace(failed, cause=cause, setting="loads")
    return replace(failed, cause=_other_times(at, settings), setting="loads")


def _other_times(at: np.ndarray, settings: StaticLoading) -> str:
    """Say why as many steps as there are loads do not come when session.toml says."""
    said = f"the record steps{_listed(at)}, not when session.toml says"
    given = np.array([nan if load.time is None else load.time.value for load in settings.loads])
    begin = np.append(0.0, at)
    if (shift := common_shift(begin, given)) is not None:
        return f"{said}: {shift.sentence}"
    more = uneven(begin, given) if np.isfinite(given).all() else ""
    return f"{said}: {more}" if more else said


def _too_short(failed: Check, readings: xr.Dataset | None, settings: StaticLoading) -> Check | None:
    """Blame the interval of a record that would be over before its second load was put on."""
    begins = [load.time.value for load in settings.loads[1:] if load.time is not None]
    lasts = nan if readings is None else float(readings["time"][-1])
    if readings is None or not begins or not lasts < begins[0]:
        return None
    interval, header = float(readings.attrs["sampling_interval"]), str(readings.attrs.get("header", ""))
    cause = (
        f"the record lasts {quantity(lasts, 's')}, the last load comes after {quantity(begins[-1], 's')}: the "
        f"sampling interval is probably not {quantity(interval, 's')} but more than "
        f"{quantity(interval * begins[-1] / lasts, 's')}"
    )
    if settings.keyence.cycle is not None:
        return replace(failed, cause=cause, file="", setting="keyence.cycle")
    line = line_of(header, "cycle", "period", "周期")
    return replace(failed, cause=cause, file=settings.laser, line=line, setting="")


def _listed(at: np.ndarray) -> str:
    return f" at {', '.join(f'{t:.0f}' for t in at)} s" if at.size else ""


def _one_factor(at: np.ndarray, settings: StaticLoading) -> float | None:
    """Return the factor between found and stated times; None where there is not one for all."""
    stated_times = [np.nan if load.time is None else load.time.value for load in settings.loads[1:]]
    ratios = at / np.array(stated_times)
    ratios = ratios[np.isfinite(ratios)]
    if not ratios.size or np.ptp(np.log(ratios)) > _SAME:
        return None
    return float(np.median(ratios))


def _of_times(failed: Check, factor: float, readings: xr.Dataset | None, settings: StaticLoading) -> Check:
    if min(abs(log(factor / k)) for k in (60.0, 1 / 60, 3600.0, 1 / 3600)) < _SAME:
        cause = f"the times of the loads are {in_words(factor)} times too short: "
        cause += "seconds and minutes were probably exchanged"
        return replace(failed, cause=cause, setting="loads")
    interval = nan if readings is None else float(readings.attrs["sampling_interval"])
    header = "" if readings is None else str(readings.attrs.get("header", ""))
    cause = (
        f"all steps come at {in_words(factor)} times the stated times: the sampling interval is probably "
        f"{quantity(interval / factor, 's')}, not {quantity(interval, 's')}"
    )
    if settings.keyence.cycle is not None:
        return replace(failed, cause=cause, file="", setting="keyence.cycle")
    return replace(failed, cause=cause, file=settings.laser, line=line_of(header, "cycle", "period", "周期"))


def _of_readings(settings: StaticLoading, readings: xr.Dataset | None = None) -> list[Check]:
    """Look at the readings by themselves."""
    trace = None if readings is None else Trace.of(settings.laser, readings, settings.sensor.output)
    if trace is None or np.isfinite(trace.reading).sum() < SIDE * len(settings.loads):
        return [not_made("readings", "readings of a length")]
    return [record_checks.unread(trace), record_checks.repeated_rows(trace), record_checks.resolution(trace)]


def _unstated(displacement: xr.Dataset, steps: xr.Dataset, settings: StaticLoading) -> Check:
    """Look for steps of the record where no load is stated."""
    name = "steps of the record"
    time, _ = valid(displacement)
    near = 2 * SIDE * float(np.median(np.diff(time)))
    at, sizes = steps_anywhere(displacement)
    others = np.array([np.abs(steps["begin"].values - t).min() > near for t in at], bool)
    least = float(np.nanmin(steps["jump"].values))
    if not others.any():
        text = f"{settings.laser}: {steps.sizes['load'] - 1} steps, one for each load that was added"
        return stated(name, text, None, file=settings.laser)
    worst = int(np.argmax(np.where(others, sizes, -np.inf)))
    text = (
        f"{settings.laser}: the readings step by {quantity(float(sizes[worst]), 'm')} at {at[worst]:.0f} s, where no "
        f"load is stated; the smallest step of a load is {quantity(least, 'm')}"
    )
    is_load = sizes[worst] > _SMALL_STEP * least
    cause = (
        f"a load that was put on at {at[worst]:.0f} s is missing in session.toml, and the masses belong to other "
        "steps; or the stand was knocked"
        if is_load
        else "the stand or the sensor was knocked"
    )
    return stated(name, text, "impossible" if is_load else "doubtful", cause=cause, setting="loads")


def _misfit(displacement: xr.Dataset, steps: xr.Dataset, settings: StaticLoading) -> Check:
    """Hold the record against its loads: one creep law and one zero for all of them."""
    name = "record against its loads"
    noise, scatter = float(steps["noise"]), float(steps["scatter"])
    time, _ = valid(displacement)
    count = int(settled(time, steps, settings).sum())
    # what stated uncertainties of loads and zero may leave of each approach
    depth = np.interp(steps["end"].values, *valid(displacement)) - float(steps["touch"])
    by_loads = 2 / 3 * float(np.max(depth * steps["u_force"].values / steps["force"].values))
    allowance = hypot(_FIT * noise, by_loads, settings.steps.drift.value)
    message = (
        f"{settings.laser}: the best creep fit for these loads leaves {quantity(scatter, 'm')}, the noise of a reading "
        f"is {quantity(noise, 'm')}"
    )
    # both are estimates from the same readings; that of the noise has half of their freedom
    u = noise * sqrt(1.5 / count)
    check = compared(name, message, scatter, u, noise, 0.0, allowance=allowance, factor=False, file=settings.laser)
    if check.level is None or scatter < noise:
        return replace(check, level=None)
    suspect = likeliest(displacement, steps, settings)
    cause = "a load, a time or the zero is wrong, or something other than the contact moved"
    if suspect is None:
        return replace(check, cause=cause)
    file = "" if suspect.setting else settings.laser
    return replace(check, cause=suspect.sentence, file=file, setting=suspect.setting)


def _forwards(steps: xr.Dataset, settings: StaticLoading, approach: xr.Dataset | None = None) -> Check:
    """Hold the creep under each load against its direction."""
    name = "direction of creep"
    if approach is None:
        return not_made(name, "an approach under every load")
    creep, u = approach["creep"].values, approach["u_creep"].values
    worst = int(np.argmin(creep / u))
    number = f"load {worst + 1} ({settings.loads[worst].mass.value:g} kg)"
    message = (
        f"{settings.laser}: under {number} the approach changes by {shown(float(creep[worst]), float(u[worst]), 'm')}"
    )
    check = bounded(name, message, float(creep[worst]), float(u[worst]), at_least=0.0, file=settings.laser)
    begin, end = spans(steps)[worst]
    cause = (
        f"the stand or the sensor warmed or settled between {begin:.0f} and {end:.0f} s, a load was taken off, or the "
        "record was reversed"
    )
    return replace(check, cause=cause)


def _slows_down(displacement: xr.Dataset, steps: xr.Dataset, settings: StaticLoading) -> Check:
    """Hold the rate of creep in the last third of each load against that in the middle third."""
    name = "rate of creep"
    time, moved = valid(displacement)
    noise = float(steps["noise"])
    wander = settings.steps.drift.value / float(time[-1])
    found = []
    for i, (begin, end) in enumerate(spans(steps)):
        thirds = np.linspace(begin + settings.steps.settle.value, end, 4)
        slopes = [_slope(time, moved, noise, a, b) for a, b in pairwise(thirds[1:])]
        if all(np.isfinite(u) for _, u in slopes):
            (middle, u_middle), (last, u_last) = slopes
            found.append((last - middle, hypot(u_middle, u_last, wander), last, i))
    if not found:
        return not_made(name, "loads that are held for 24 readings")
    rise, u, last, worst = max(found, key=lambda each: each[0] / each[1])
    begin, end = spans(steps)[worst]
    message = (
        f"{settings.laser}: under load {worst + 1} ({settings.loads[worst].mass.value:g} kg) the approach grows by "
        f"{quantity(last, 'm/s')} in the last third of the hold, {quantity(last - rise, 'm/s')} in the middle"
    )
    check = bounded(name, message, rise, u, at_most=0.0, is_law=False, file=settings.laser)
    cause = f"a drift, such as a change of temperature, while the load was held ({begin:.0f} to {end:.0f} s)"
    return replace(check, cause=cause)


def _slope(time: np.ndarray, moved: np.ndarray, noise: float, begin: float, end: float) -> tuple[float, float]:
    inside = (time > begin) & (time < end - SIDE * float(np.median(np.diff(time))))
    t, x = time[inside], moved[inside]
    if t.size < 2 * SIDE:
        return nan, nan
    t = t - t.mean()
    spread = float(np.sum(t**2))
    return float(np.sum(t * x)) / spread, noise / sqrt(spread)


def _compliance(steps: xr.Dataset, settings: StaticLoading) -> Check:
    """Hold the compliance that the record gives against what any solid has."""
    name = "stiffness of the sphere"
    modulus = 1 / float(steps["compliance"][0])
    message = f"{settings.laser}: the record and its loads give a contact modulus of {quantity(modulus, 'Pa')}"
    low, high = _PLAUSIBLE
    check = bounded(
        name, message, log(modulus), 0.05, at_least=log(low), at_most=log(high), is_law=False, setting="loads"
    )
    cause = "the masses are probably in another unit, or the unit of the readings is wrong"
    return replace(check, cause=cause)


def _times(steps: xr.Dataset, settings: StaticLoading) -> Check:
    """Hold the steps' times against those that are stated."""
    name = "times of the loads"
    given, begin = steps["given_time"].values, steps["begin"].values
    known = np.isfinite(given)
    known[0] = False  # on from the beginning
    if not known.any():
        return not_made(name, "times of the loads in session.toml")
    late = np.where(known, np.abs(begin - given), 0.0)
    worst = int(np.argmax(late))
    text = f"load {worst + 1} came at {begin[worst]:.0f} s, stated are {given[worst]:.0f} s"
    if (shift := common_shift(begin, given)) is not None:
        text = f"load {shift.first} came at {begin[shift.first - 1]:.0f} s, stated are {given[shift.first - 1]:.0f} s"
        text += "; all later ones are as far off"
        setting = f"loads[{shift.first - 1}]"
        return stated(name, text, "doubtful", cause=shift.sentence, setting=setting)
    level: Level | None = "note" if late[worst] > 0.5 * settings.steps.search.value else None
    return stated(name, text, level, setting=f"loads[{worst}]")


def _of_material(settings: StaticLoading, approach: xr.Dataset | None = None, model: xr.Dataset | None = None) -> Check:
    """Hold the approach against Hertz and creep of the named material: (F J)^(2/3) R^(-1/3)."""
    if approach is None or model is None:
        return not_made(MATERIAL, "a material and a measured approach")
    seen, u_seen = float(approach["level_approach"][-1]), float(approach["u_level_approach"][-1])
    expected, u_expected = float(model["approach"][-1]), float(model["u_approach"][-1])
    if not (seen > 0.0 and expected > 0.0):
        return not_made(MATERIAL, "an approach above 0")
    gap, u = log(seen / expected), hypot(u_seen / seen, u_expected / expected)
    message = (
        f"{settings.laser}: {shown(seen, u_seen, 'm')} under the last load, about {quantity(expected, 'm')} expected "
        "for the stated sphere and material"
    )
    level: Level | None = None
    if abs(gap) > 2 / 3 * log(_NO_GRADE):
        level = "impossible"
    elif abs(gap) > 2 / 3 * log(_OTHER_GRADE):
        level = "doubtful"
    cause = ""
    radius = settings.sphere.radius.value
    if level is None and abs(gap) > 4 * u and abs(abs(gap) - log(2.0) / 3) < hypot(_DIAMETER, 2 * u):
        # a factor of two in the radius is what people get wrong
        right, what = (radius / 2, "diameter") if gap > 0 else (2 * radius, "half of the radius")
        level = "doubtful"
        other = f"{in_words(np.exp(1.5 * abs(gap)), 2)} times {'softer' if gap > 0 else 'stiffer'}"
        cause = (
            f"sphere.radius is probably {quantity(right, 'm')}, not {quantity(radius, 'm')} (the {what} was typed); "
            f"or the material is {other} than the one that is named"
        )
    return Check(MATERIAL, message, level, gap / u, gap, u, cause=cause, setting="sphere.radius" if cause else "")


def _another_material(check: Check) -> Check:
    """Blame the material where nothing that is stated explains an approach by a usual factor."""
    if not check.level or check.cause:
        return check
    stiffer = in_words(np.exp(-1.5 * check.log_ratio), 2)
    cause = (
        f"the sphere is probably of another material than is named, about {stiffer} times as stiff; or "
        "sphere.radius or the loads are stated wrongly"
    )
    return replace(check, cause=cause, setting="sphere")


def _smaller_than_the_sphere(settings: StaticLoading, approach: xr.Dataset | None = None) -> Check:
    name = "size of the contact"
    if approach is None:
        return not_made(name, "an approach under every load")
    a, radius = float(approach["contact_radius"].max()), settings.sphere.radius
    text = f"a contact radius of {quantity(a, 'm')} on a sphere of {quantity(radius.value, 'm')}"
    if a < radius.value:
        return stated(name, text, None)
    cause = "sphere.radius is in another unit than was typed, or the unit of the readings is wrong"
    return stated(name, text, "impossible", cause=cause, setting="sphere.radius")


def _given_radius(settings: StaticLoading, comparison: xr.Dataset | None = None) -> Check:
    """Hold the contact radius from the approach against one that was measured otherwise."""
    known = np.zeros(0, bool) if comparison is None else np.isfinite(comparison["given_difference"].values)
    if comparison is None or not known.any():
        return not_made(RADIUS_GIVEN, "a contact radius under a load that was measured otherwise")
    difference, u = comparison["given_difference"].values, comparison["u_given_difference"].values
    worst = int(np.argmax(np.where(known, np.abs(difference) / u, -1.0)))
    given = float(comparison["given_radius"][worst])
    seen = given + float(difference[worst])
    message = f"load {worst + 1}: {quantity(seen, 'm')} from the approach, {quantity(given, 'm')} given"
    where = f"loads[{worst}].radius"
    return compared(RADIUS_GIVEN, message, seen, float(u[worst]), given, 0.0, setting=where)


def _causes(settings: StaticLoading) -> Sequence[Cause]:
    radius = settings.sphere.radius.value
    return (
        Cause(
            {MATERIAL: -2 / 3},
            lambda k: (
                f"the masses come out {too_large(k)}: they are probably in another unit, or forces were typed "
                "as masses (loads in session.toml)"
            ),
            SLIPS["mass"],
            only_usual=True,
            setting="loads",
        ),
        Cause(
            {MATERIAL: 1 / 3, RADIUS_GIVEN: 0.5},
            lambda k: f"sphere.radius is probably {quantity(radius / k, 'm')}, not {quantity(radius, 'm')}",
            SLIPS["gain"] + _LENGTHS,
            only_usual=True,
            setting="sphere.radius",
        ),
        Cause(
            {MATERIAL: 1.0, RADIUS_GIVEN: 0.5},
            lambda k: (
                f"lengths come out {too_large(k)}: the unit, the display factor or the gain of "
                f"{settings.laser} is not what it says"
            ),
            _LENGTHS,
            only_usual=True,
            file=settings.laser,
        ),
    )
