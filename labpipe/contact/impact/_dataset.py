"""The result of drops as a Dataset: time series, one row per bounce, ledger, work done."""

import json
from collections.abc import Mapping, Sequence
from math import nan, pi

import numpy as np
import xarray as xr

from labpipe.arrays import Floats
from labpipe.contact.impact._setting import Setting
from labpipe.contact.impact._train import COLUMNS, ROWS, Train
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
    """Assemble the Dataset that :func:`labpipe.contact.drop` returns; ``times`` (time,) count from the release."""
    values = train.records()
    # Energies over time; the numerical one closes the sum. What the difference of two sums loses in the last digit
    # of the dissipated energy, which only grows, is put right.
    kinetic = 0.5 * setting.mass * values["velocity"] ** 2
    potential = -setting.mass * setting.gravity * values["position"]
    dissipated = np.maximum.accumulate(values["spring_work"] - values["stored"] + values["plate_loss"])
    on_plate = {}
    if setting.plate is not None:
        energy = setting.plate.energy(values["plate_displacement"], values["plate_velocity"])
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
    work = train.counts | {
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


def thesis_dataset(
    run: Floats, work: Mapping[str, int], setting: Setting, times: Floats | None, seconds: float
) -> xr.Dataset:
    """Assemble the same Dataset, without a ledger, from the thesis's scheme."""
    since, position, velocity, force, radius, _ = run
    fall = np.linspace(0.0, setting.fall_time, 26)[: -1 if setting.height > 0.0 else 0]
    sunk, zero = 0.5 * setting.gravity * fall**2 - setting.height, np.zeros_like(fall)
    before = np.stack([fall - setting.fall_time, sunk, setting.gravity * fall, zero, zero, -sunk])
    whole = np.concatenate([before, run], axis=1)
    whole = whole[:, whole[0] + setting.fall_time <= setting.duration * (1.0 + 1e-12)]
    names = ("displacement", "velocity", "force", "contact_radius", "reduced_gap")
    time, signs = whole[0] + setting.fall_time, (-1.0, -1.0, 1.0, 1.0, 1.0)
    series = {name: sign * values for name, sign, values in zip(names, signs, whole[1:], strict=True)}
    series["approach"] = -series["displacement"]
    if times is not None:
        series = {name: np.interp(times, time, values) for name, values in series.items()}
        time = times
    # A contact is a run of steps with force, as far as steps of equal length resolve it.
    loaded = np.concatenate([[0], (force > 0.0).astype(int), [0]])
    rows = []
    for start, stop in zip(np.flatnonzero(np.diff(loaded) == 1), np.flatnonzero(np.diff(loaded) == -1), strict=True):
        if stop < since.size:
            touch = max(int(start) - 1, 0)
            inside = slice(touch, int(stop) + 1)
            began, ended, incoming, outgoing = since[touch], since[stop], velocity[touch], -velocity[stop]
            moments = began + setting.fall_time, ended + setting.fall_time, ended - began
            ratio, deepest = outgoing / incoming if incoming > 0.0 else nan, position[inside].max()
            peaks = force[inside].max(), radius[inside].max(), deepest, deepest - position[touch]
            rows.append((*moments, incoming, outgoing, ratio, *peaks, nan, nan))
    steps = since.size - 1
    counts = {"solver_steps": steps, "kernel_products": work["active_set_solves"] + steps, "seconds": round(seconds, 4)}
    return _assemble(time, series, rows, {}, setting, {**counts, **work})


def batch_dataset(trains: Sequence[Train], most: int) -> xr.Dataset:
    """Assemble the Dataset that :func:`labpipe.contact.impacts` returns."""
    rows = np.full((len(trains), most, len(COLUMNS)), np.nan)
    for row, train in zip(rows, trains, strict=True):
        row[: len(train.rows)] = np.reshape(train.rows, (-1, len(COLUMNS)))
    made: dict[str, object] = {
        name: variable(("drop", "impact"), rows[..., i], *ROWS[name])
        for i, name in enumerate(COLUMNS)
        if not name.startswith("energy")
    }
    happened = [len(train.rows) for train in trains]
    made["impacts"] = variable("drop", np.array(happened), "1", "impacts that happened, at most those asked for")
    final = [train.final_touch + train.setting.fall_time for train in trains]
    made["final_contact_time"] = variable("drop", np.array(final), *_SCALARS["final_contact_time"])
    steps = [train.counts["solver_steps"] for train in trains]
    made["solver_steps"] = variable("drop", np.array(steps), "1", "steps of the solver")
    rejected = sum(train.counts["rejected_steps"] for train in trains)
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
    variables = {name: variable("time", values, *_SERIES[name]) for name, values in series.items()}
    variables |= {name: variable("impact", values, *ROWS[name]) for name, values in table.items()}
    variables |= {name: variable((), value, *_SCALARS[name]) for name, value in given.items()}
    attrs = {"solver": setting.solver, "profile": setting.profile, "rtol": setting.rtol, "work": json.dumps(work)}
    return xr.Dataset(variables, coords={"time": variable("time", time, "s", "time since the release")}, attrs=attrs)
