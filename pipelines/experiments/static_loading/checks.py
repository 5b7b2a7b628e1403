"""Checks of a static loading: steps and times of the loads, one creep law, stiffness, and the record itself."""

from collections.abc import Sequence
from dataclasses import replace
from math import hypot, log, sqrt

import numpy as np
import xarray as xr
from scipy.linalg import orth

from labpipe.judging import DOUBTFUL, SLIPS, Cause, Check, bounded, compared, in_words, not_made, too_large
from labpipe.report import quantity, value_with_uncertainty as shown
from labpipe.workflow.context import Context
from pipelines.experiments.shared import judgements, record_checks
from pipelines.experiments.shared.given import Given
from pipelines.experiments.shared.judgements import Scene, Title
from pipelines.experiments.shared.model_inputs import inputs_of
from pipelines.experiments.shared.record_checks import Trace
from pipelines.experiments.static_loading.comparison import rows
from pipelines.experiments.static_loading.measured import SIDE, clear_steps, creep_design, creep_fit, settled, valid
from pipelines.experiments.static_loading.settings import StaticLoading

MATERIAL = "approach against the material"
_SMALL_STEP = 0.3  # of the smallest step of a load, below which one more may be a knock
_FIT = 0.25  # of the noise: a misfit that a creep law of few terms may leave
_DIAMETER = 0.02  # by which a factor of 2 in the radius may be missed, of the logarithm of an approach
_LEFT = 0.3  # of the misfit, which a mistake may leave
_FAILED = dict.fromkeys(("steps", "approach"), "the record does not hold the loads that session.toml states")
_STEPS = ("readings", "displacement", "steps", "approach", "model", "comparison")
TITLES = {
    "steps of the loads": Title("The readings step when a load is put on, and only then.", ("steps of the record",)),
    "one creep law for all loads": Title(
        "One creep compliance and one first touch describe all loads (Lee and Radok).", ("record against its loads",)
    ),
    "stiffness": Title("Approach = (3 F J*/4)^(2/3) R^(-1/3) for the stated sphere, loads and material.", (MATERIAL,)),
    **record_checks.OF_LASER,
}


@judgements.judging(*_STEPS, rests_on=("sphere.material_from",), titles=TITLES)
def judgement(given: Given, basis: judgements.Basis, settings: StaticLoading, context: Context) -> Scene:
    """Judge one static loading; a step without a result is judged by its error."""
    readings, displacement = given.get("readings"), given.get("displacement")
    checks, times = list[Check](), [np.nan if load.time is None else load.time.value for load in settings.loads[1:]]
    for check in judgements.failed_steps(context, _FAILED):
        at = np.empty(0) if displacement is None else clear_steps(displacement)[0]
        off = np.flatnonzero(np.abs(at - times) > settings.steps.search.value) if at.size == len(times) else at
        if check.name == "step steps" and off.size == 1:  # as many as stated were found, at the times of all but one
            i = int(off[0])
            right, said = (quantity(each, "s", 4) for each in (at[i], times[i]))
            cause = f"the time of load {i + 2} is probably {right}, not {said}: all others fit the record"
            checks.append(replace(check, cause=cause, file="", setting=f"loads[{i + 1}].time"))
        else:
            checks.append(record_checks.placed(check, settings.calibration, settings.laser))
    trace = None if readings is None else Trace.of(settings.laser, readings, settings.sensor.output)
    if trace is None or np.isfinite(trace.reading).sum() < SIDE * len(settings.loads):
        checks.append(not_made("readings", "readings of a length"))
    else:
        checks += [of(trace) for of in (record_checks.unread, record_checks.repeated_rows, record_checks.resolution)]
    checks += record_checks.of_record({settings.laser: displacement}, settings.calibration)
    checks += given.each((_unstated, _misfit, _of_material))
    known_by, inputs = judgements.measured_by(settings.sphere), inputs_of(given.get("comparison"))
    return Scene(checks, _causes(settings), given.each([rows]), inputs, basis=basis, measured_by=known_by)


def _unstated(displacement: xr.Dataset, steps: xr.Dataset, settings: StaticLoading) -> Check:
    """Look for steps of the record where no load is stated."""
    name, (time, _) = "steps of the record", valid(displacement)
    near = 2 * SIDE * float(np.median(np.diff(time)))
    at, sizes = clear_steps(displacement)
    is_other = np.array([np.abs(steps["begin"].values - t).min() > near for t in at], bool)
    if not is_other.any():
        text = f"{settings.laser}: {steps.sizes['load']} loads, {steps.sizes['load'] - 1} steps between them"
        return Check(name, text, None, file=settings.laser)
    worst, least = int(np.argmax(np.where(is_other, sizes, -np.inf))), float(np.nanmin(steps["jump"].values))
    text = (
        f"{settings.laser}: the readings step by {quantity(float(sizes[worst]), 'm')} at {at[worst]:.0f} s, where no "
        f"load is stated; the smallest step of a load is {quantity(least, 'm')}"
    )
    is_small = sizes[worst] < _SMALL_STEP * least
    missing = f"a load that was put on at {at[worst]:.0f} s is missing in session.toml, and the masses belong to other "
    cause = "the stand or the sensor was knocked" if is_small else f"{missing}steps; or the stand or sensor was knocked"
    return Check(name, text, "doubtful" if is_small else "impossible", cause=cause, setting="loads")


def _misfit(displacement: xr.Dataset, steps: xr.Dataset, settings: StaticLoading) -> Check:
    """Compare the residual of one creep law and one zero for all loads with the noise, and say what explains it."""
    noise, scatter = float(steps["noise"]), float(steps["scatter"])
    time, moved = valid(displacement)
    used = np.flatnonzero(settled(time, steps, settings))
    # left of each approach by stated uncertainties of loads and zero
    depth = np.interp(steps["end"].values, time, moved) - float(steps["touch"])
    by_loads = 2 / 3 * float(np.max(depth * steps["u_force"].values / steps["force"].values))
    allowance = hypot(_FIT * noise, by_loads, settings.steps.drift.value)
    text = f"{settings.laser}: the best creep fit for these loads leaves {quantity(scatter, 'm')}, the noise of a "
    text += f"reading is {quantity(noise, 'm')}"
    # both are estimates from the same readings; that of the noise has half of their freedom
    u, name = noise * sqrt(1.5 / used.size), "record against its loads"
    check = compared(name, text, scatter, u, noise, 0.0, allowance=allowance, factor=False, file=settings.laser)
    if check.level is None or scatter < noise:
        return replace(check, level=None)
    # the load, or the drift under one load, that explains most of the misfit
    elapsed, force, radius = time[used], steps["force"].values, settings.sphere.radius.value
    depth = np.maximum(moved[used] - float(steps["touch"]), 1e-9)
    design, _ = creep_design(elapsed, steps, radius)
    weights, _ = creep_fit(moved[used], design, float(steps["touch"]))
    steep = 1.5 * np.sqrt(depth)
    # of each load alone: the design is linear in the forces
    alone = [creep_design(elapsed, steps.assign(force=("load", one)), radius)[0] for one in np.diag(force)]
    spans = zip(steps["begin"].values, steps["end"].values, strict=True)
    shares = [np.clip((elapsed - begin) / (end - begin), 0.0, 1.0) for begin, end in spans]
    slopes = -np.column_stack([*(each @ weights / steep for each in alone), *shares])
    # first touch and creep are free
    free = np.column_stack([np.ones(used.size), design / steep[:, None]])
    free = orth(free / np.abs(free).max(axis=0), rcond=1e-2)
    left, slopes = (x - free @ (free.T @ x) for x in ((depth**1.5 - design @ weights) / steep, slopes))
    size = np.sum(slopes**2, axis=0)
    errors = np.divide(slopes.T @ left, size, out=np.zeros_like(size), where=size > 0.0)
    explained = errors**2 * size / np.sum(left**2)
    best = int(np.argmax(explained))
    i = best % force.size
    load = settings.loads[i].mass.value
    said, setting = "a load, a time or the zero is wrong, or something other than the contact moved", ""
    if explained[best] >= 1.0 - _LEFT and best == i:
        said = f"load {i + 1} is probably about {load * (1.0 - errors[best]):.2g} kg, not {load:g} kg: all others fit "
        said, setting = f"{said}the record then (loads in session.toml)", f"loads[{i}].mass"
    elif explained[best] >= 1.0 - _LEFT:
        said = f"the readings probably drifted by {quantity(-float(errors[best]), 'm')} while load {i + 1} ({load:g} "
        said += "kg) was held: the temperature changed, or the stand settled"
    return replace(check, cause=said, file="" if setting else settings.laser, setting=setting)


def _of_material(settings: StaticLoading, approach: xr.Dataset, model: xr.Dataset) -> Check:
    """Hold the approach against Hertz and creep of the named material: (F J)^(2/3) R^(-1/3)."""
    seen, u_seen = float(approach["level_approach"][-1]), float(approach["u_level_approach"][-1])
    expected, u_expected = float(model["approach"][-1]), float(model["u_approach"][-1])
    if not (seen > 0.0 and expected > 0.0):
        return not_made(MATERIAL, "an approach above 0")
    gap, own = log(seen / expected), hypot(u_seen / seen, u_expected / expected)
    message = f"{settings.laser}: {shown(seen, u_seen, 'm')} under the last load, about {quantity(expected, 'm')} "
    message += "expected for the stated sphere and material"
    u = hypot(own, 2 / 3 * judgements.u_modulus(settings.sphere))
    level = bounded(MATERIAL, message, abs(gap), u, at_most=0.0).level
    # a diameter for a radius is within the moduli of one polymer
    if abs(gap) > DOUBTFUL * own and abs(abs(gap) - log(2.0) / 3) < hypot(_DIAMETER, 2 * own):
        level = level or "doubtful"
    return Check(MATERIAL, message, level, gap / u, gap, own)


def _causes(settings: StaticLoading) -> Sequence[Cause]:
    radius, masses = settings.sphere.radius.value, "they are probably in another unit, or forces were typed as masses"
    length = f"the unit, the display factor or the gain of {settings.laser} is not what it says"

    def of_radius(k: float) -> str:
        typed = " (the diameter was typed)" * (abs(log(0.5 * k)) < 0.1)
        other = f"the material is {in_words(max(k, 1 / k) ** 0.5, 2)} times {'softer' if k > 1.0 else 'stiffer'}"
        right = f"sphere.radius is probably {quantity(radius / k, 'm')}, not {quantity(radius, 'm')}{typed}"
        return f"{right}; or {other} than the one that is named"

    def of_material(k: float) -> str:
        said = f"the sphere is probably of another material than is named, about {in_words(k**-1.5, 2)} times as stiff"
        return f"{said}; or sphere.radius or the loads are stated wrongly"

    def of_masses(k: float) -> str:
        return f"the masses come out {too_large(k)}: {masses} (loads in session.toml)"

    # a mass in another unit looks like a length that is 100 times too large
    lengths = tuple(k for k in SLIPS["size"] if k not in (100.0, 0.01))
    return (
        Cause({MATERIAL: -2 / 3}, of_masses, SLIPS["mass"], only_usual=True, setting="loads"),
        Cause({MATERIAL: 1 / 3}, of_radius, lengths, only_usual=True, setting="sphere.radius"),
        Cause({MATERIAL: 1.0}, judgements.wrong_lengths(length), lengths, only_usual=True, file=settings.laser),
        Cause({MATERIAL: 1.0}, of_material, setting="sphere"),
    )
