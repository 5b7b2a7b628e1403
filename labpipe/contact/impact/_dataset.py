"""The result of drops as a Dataset: time series, one row per bounce, ledger, work done."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from math import nan, pi

import numpy as np
import xarray as xr

from labpipe.arrays import Floats
from labpipe.contact._thesis_scheme import ThesisRun
from labpipe.contact.impact._plate import PlateState
from labpipe.contact.impact._setting import Setting
from labpipe.contact.impact._train import COLUMNS, Train
from labpipe.variables import variable

_SERIES = {
    "displacement": ("m", "displacement of the sphere, upwards, 0 at first touch"),
    "velocity": ("m/s", "velocity of the sphere, upwards"),
    "approach": ("m", "approach of sphere and substrate, inwards"),
    "reduced_gap": ("m", "gap between the deformed sphere and the substrate at the axis"),
    "force": ("N", "contact force"),
    "contact_radius": ("m", "contact radius"),
    "kinetic_energy": ("J", "kinetic energy of the sphere"),
    "potential_energy": ("J", "potential energy of the sphere, 0 at first touch"),
    "stored_energy": ("J", "energy held elastically by the material"),
    "dissipated_energy": ("J", "energy dissipated so far"),
    "numerical_energy": ("J", "numerical energy error so far"),
    "plate_displacement": ("m", "displacement of the plate, downwards"),
    "plate_energy": ("J", "kinetic and elastic energy of the plate"),
}
_ROWS = {
    "impact_time": ("s", "time of touch"),
    "lift_off_time": ("s", "time of lift-off"),
    "contact_duration": ("s", "duration of the contact"),
    "impact_speed": ("m/s", "speed at touch"),
    "rebound_speed": ("m/s", "speed at lift-off"),
    "restitution": ("1", "coefficient of restitution"),
    "peak_force": ("N", "largest contact force"),
    "peak_contact_radius": ("m", "largest contact radius"),
    "peak_pressure": ("Pa", "largest contact pressure, of Hertz's distribution"),
    "peak_approach": ("m", "largest approach"),
    "penetration": ("m", "largest depth of the sphere below its level at touch"),
    "energy_dissipated": ("J", "energy dissipated during the contact"),
    "energy_stored": ("J", "elastic energy remaining in the dent at lift-off"),
}
_SCALARS = {
    "sphere_radius": ("m", "radius of the sphere"),
    "mass": ("kg", "mass that falls"),
    "drop_height": ("m", "fall from rest to first touch"),
    "gravity": ("m/s2", "acceleration of gravity"),
    "final_contact_time": ("s", "touch after which it never lifts off"),
    "rest_time": ("s", "time from which it only creeps"),
    "rigid_restitution": ("1", "restitution of the first impact on a rigid substrate"),
}


def dataset(
    train: Train, setting: Setting, times: Floats | None, rigid_restitution: float | None, seconds: float
) -> xr.Dataset:
    """Assemble the Dataset that :func:`labpipe.contact.drop` returns.

    ``train``: the drop, run; ``setting``: as asked for; ``times`` (time,): where to report, from the release;
    ``rigid_restitution``: of the first impact on a rigid substrate, when there is a plate; ``seconds``: so far.
    """
    assert train.course is not None  # noqa: S101 - it was asked for
    values = train.course.records()
    # Energies over time; the numerical one closes the sum. What the difference of two sums loses in the last digit
    # of the dissipated energy, which only grows, is put right.
    kinetic = 0.5 * setting.mass * values["velocity"] ** 2
    potential = -setting.mass * setting.gravity * values["position"]
    dissipated = np.maximum.accumulate(values["spring_work"] - values["stored"] + values["plate_loss"])
    on_plate = {}
    if setting.plate is not None:
        energy = setting.plate.energy(PlateState(values["plate_displacement"], values["plate_velocity"]))
        on_plate = {"plate_displacement": values["plate_displacement"], "plate_energy": energy}
    known = kinetic + potential + values["stored"] + dissipated + on_plate.get("plate_energy", 0.0)
    series = {
        "displacement": -values["position"],
        "velocity": -values["velocity"],
        "approach": values["approach"],
        "reduced_gap": values["surface"] - values["approach"],
        "force": values["force"],
        "contact_radius": values["contact_radius"],
        "kinetic_energy": kinetic,
        "potential_energy": potential,
        "stored_energy": values["stored"],
        "dissipated_energy": dissipated,
        "numerical_energy": setting.mass * setting.gravity * setting.height - known,
    } | on_plate
    n_folded, n_frozen = train.tables.left_out
    work = asdict(train.counts) | {
        "springs": 0 if train.stepper is None else train.stepper.bed.size,
        "terms": train.tables.creep.n_terms,
        "terms_folded": n_folded,
        "terms_frozen": n_frozen,
        "seconds": round(seconds, 4),
    }
    scalars = {
        "final_contact_time": train.final_touch + setting.fall_time,
        "rest_time": train.rest_start + setting.fall_time,
    }
    if rigid_restitution is not None:
        scalars["rigid_restitution"] = rigid_restitution
    time = values["time"] + setting.fall_time if times is None else times
    result = _assemble(time, series, train.rows, scalars, setting, work)
    result.attrs["energy_error"] = train.error
    return result


def thesis_dataset(run: ThesisRun, setting: Setting, times: Floats | None, seconds: float) -> xr.Dataset:
    """Assemble the same Dataset, without a ledger, from the thesis's scheme."""
    time = run.time + setting.fall_time
    inside = time <= setting.duration * (1.0 + 1e-12)
    series = {
        "displacement": -run.position,
        "velocity": -run.velocity,
        "approach": run.position,
        "reduced_gap": run.reduced_gap,
        "force": run.force,
        "contact_radius": run.contact_radius,
    }
    fall = np.linspace(0.0, setting.fall_time, 26)[: -1 if setting.height > 0.0 else 0]
    height, zero = setting.height - 0.5 * setting.gravity * fall**2, np.zeros_like(fall)
    before = {"displacement": height, "velocity": -setting.gravity * fall, "approach": -height, "reduced_gap": height}
    series = {name: np.concatenate([before.get(name, zero), values[inside]]) for name, values in series.items()}
    time = np.concatenate([fall, time[inside]])
    if times is not None:
        series = {name: np.interp(times, time, values) for name, values in series.items()}
        time = times
    # A contact is a run of steps with force, as far as steps of equal length resolve it.
    loaded = np.concatenate([[0], (run.force > 0.0).astype(int), [0]])
    rows = []
    for start, stop in zip(np.flatnonzero(np.diff(loaded) == 1), np.flatnonzero(np.diff(loaded) == -1), strict=True):
        if stop < run.time.size:
            touch = max(int(start) - 1, 0)
            steps_in = slice(touch, int(stop) + 1)
            began, ended, incoming, outgoing = run.time[touch], run.time[stop], run.velocity[touch], -run.velocity[stop]
            times_and_speeds = began + setting.fall_time, ended + setting.fall_time, ended - began, incoming, outgoing
            ratio, deepest = outgoing / incoming if incoming > 0.0 else nan, run.position[steps_in].max()
            peaks = (
                run.force[steps_in].max(),
                run.contact_radius[steps_in].max(),
                deepest,
                deepest - run.position[touch],
            )
            rows.append((*times_and_speeds, ratio, *peaks, nan, nan))
    solves, steps = run.work["active_set_solves"], run.time.size - 1
    work = {"solver_steps": steps, "kernel_products": solves + steps, "seconds": round(seconds, 4)} | run.work
    return _assemble(time, series, rows, {}, setting, work)


def batch_dataset(trains: Sequence[Train], most: int) -> xr.Dataset:
    """Assemble the Dataset that :func:`labpipe.contact.impacts` returns."""
    rows = np.full((len(trains), most, len(COLUMNS)), np.nan)
    for row, train in zip(rows, trains, strict=True):
        row[: len(train.rows)] = np.reshape(train.rows, (-1, len(COLUMNS)))
    made: dict[str, object] = {
        name: variable(("drop", "impact"), rows[..., i], *_ROWS[name])
        for i, name in enumerate(COLUMNS)
        if not name.startswith("energy")
    }
    happened = [len(train.rows) for train in trains]
    made["impacts"] = variable("drop", np.array(happened), "1", "impacts that happened, at most those asked for")
    final = [train.final_touch + train.setting.fall_time for train in trains]
    made["final_contact_time"] = variable("drop", np.array(final), *_SCALARS["final_contact_time"])
    steps = [int(train.counts.solver_steps) for train in trains]
    made["solver_steps"] = variable("drop", np.array(steps), "1", "steps of the solver")
    rejected = sum(int(train.counts.rejected_steps) for train in trains)
    counts = {"solver_steps": sum(steps), "rejected_steps": rejected, "impacts": sum(happened)}
    return xr.Dataset(made, attrs={"work": json.dumps(counts)})


def _assemble(
    time: Floats,
    series: Mapping[str, Floats],
    rows: Sequence[tuple[float, ...]],
    scalars: Mapping[str, float],
    setting: Setting,
    work: Mapping[str, int | float],
) -> xr.Dataset:
    table = dict(zip(COLUMNS, np.array(rows, dtype=float).reshape(len(rows), len(COLUMNS)).T, strict=True))
    with np.errstate(invalid="ignore"):
        table["peak_pressure"] = 1.5 * table["peak_force"] / (pi * table["peak_contact_radius"] ** 2)
    given = {"sphere_radius": setting.radius, "mass": setting.mass}
    given |= {"drop_height": setting.height, "gravity": setting.gravity, **scalars}
    groups: tuple[tuple[dict[str, tuple[str, str]], tuple[str, ...], Mapping[str, Floats | float]], ...] = (
        (_SERIES, ("time",), series),
        (_ROWS, ("impact",), table),
        (_SCALARS, (), given),
    )
    variables = {
        name: variable(dims, value, *names[name]) for names, dims, values in groups for name, value in values.items()
    }
    attrs = {"solver": setting.solver, "profile": setting.profile, "rtol": setting.rtol, "work": json.dumps(work)}
    return xr.Dataset(variables, coords={"time": variable("time", time, "s", "time since the release")}, attrs=attrs)
