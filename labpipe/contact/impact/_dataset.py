"""The result of a drop as a Dataset: time series, one row per bounce, ledger, work done."""

import json
from collections.abc import Sequence
from math import nan, pi

import numpy as np
import xarray as xr

from labpipe.arrays import Floats
from labpipe.contact.impact._motion import counted
from labpipe.contact.impact._setting import Setting
from labpipe.contact.impact._thesis_scheme import ThesisRun
from labpipe.contact.impact._train import COLUMNS, Train
from labpipe.contact.impact._trajectory import Columns, columns
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
ROWS = {
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
SCALARS = {
    "sphere_radius": ("m", "radius of the sphere"),
    "mass": ("kg", "mass that falls"),
    "drop_height": ("m", "fall from rest to first touch"),
    "gravity": ("m/s2", "acceleration of gravity"),
    "final_contact_time": ("s", "touch after which it never lifts off"),
    "rest_time": ("s", "time from which it only creeps"),
    "rigid_restitution": ("1", "restitution of the first impact on a rigid substrate"),
}


def dataset(train: Train, times: Floats | None, rigid_restitution: float | None, seconds: float) -> xr.Dataset:
    """Assemble the Dataset that :func:`labpipe.contact.drop` returns.

    ``train``: the drop, run; ``times`` (time,): where to report, from the release; ``rigid_restitution``: of the first
    impact on a rigid substrate, when there is a plate; ``seconds``: wall time so far.
    """
    setting = train.setting
    values = columns(train.segments, setting, None if times is None else times - setting.fall_time)
    series = {
        "displacement": -values.position,
        "velocity": -values.velocity,
        "approach": values.approach,
        "reduced_gap": values.surface - values.approach,
        "force": values.force,
        "contact_radius": values.contact_radius,
        **_ledger(values, setting),
    }
    if setting.plate is not None:
        series["plate_displacement"] = values.plate_displacement
        series["plate_energy"] = values.plate_energy
    condensed = train.tables.condensed
    work = counted(train.counts) | {
        "springs": 0 if train.stepper is None else int(train.stepper.springs.position.size),
        "terms": condensed.creep.n_terms,
        "terms_folded": condensed.n_folded,
        "terms_frozen": condensed.n_frozen,
        "seconds": round(seconds, 4),
    }
    scalars = {
        "final_contact_time": train.final_touch + setting.fall_time,
        "rest_time": train.rest_start + setting.fall_time,
    }
    if rigid_restitution is not None:
        scalars["rigid_restitution"] = rigid_restitution
    time = values.time + setting.fall_time if times is None else times
    result = _assemble(time, series, _table(train.rows), scalars, setting, work)
    result.attrs["energy_error"] = train.error
    return result


def _table(rows: Sequence[tuple[float, ...]]) -> dict[str, Floats]:
    """Columns over the impacts from their rows."""
    table = np.array(rows, dtype=float).reshape(len(rows), len(COLUMNS))
    return dict(zip(COLUMNS, table.T, strict=True))


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
    series = {name: values[inside] for name, values in series.items()}
    time = time[inside]
    if setting.height > 0.0:
        fall = np.linspace(0.0, setting.fall_time, 26)[:-1]
        height = setting.height - 0.5 * setting.gravity * fall**2
        zero = np.zeros_like(fall)
        before = {"displacement": height, "velocity": -setting.gravity * fall}
        before |= {"approach": -height, "reduced_gap": height}
        series = {name: np.concatenate([before.get(name, zero), values]) for name, values in series.items()}
        time = np.concatenate([fall, time])
    if times is not None:
        series = {name: np.interp(times, time, values) for name, values in series.items()}
        time = times
    work = {
        "solver_steps": run.time.size - 1,
        "active_set_solves": run.active_set_solves,
        "kernel_products": run.active_set_solves + run.time.size - 1,
        "history_products": run.history_products,
        "seconds": round(seconds, 4),
    }
    return _assemble(time, series, _thesis_rows(run, setting), {}, setting, work)


def _assemble(
    time: Floats,
    series: dict[str, Floats],
    rows: dict[str, Floats],
    scalars: dict[str, float],
    setting: Setting,
    work: dict[str, int | float],
) -> xr.Dataset:
    given = {
        "sphere_radius": setting.radius,
        "mass": setting.mass,
        "drop_height": setting.height,
        "gravity": setting.gravity,
    }
    with np.errstate(invalid="ignore"):
        rows["peak_pressure"] = 1.5 * rows["peak_force"] / (pi * rows["peak_contact_radius"] ** 2)
    variables: dict[str, object] = {}
    for names, dims, values in (
        (_SERIES, ("time",), series),
        (ROWS, ("impact",), rows),
        (SCALARS, (), given | scalars),
    ):
        for name, value in values.items():
            units, long_name = names[name]
            variables[name] = variable(dims, value, units, long_name)
    attrs = {"solver": setting.solver, "profile": setting.profile, "rtol": setting.rtol, "work": json.dumps(work)}
    clock = variable("time", time, "s", "time since the release")
    return xr.Dataset(variables, coords={"time": clock}, attrs=attrs)


def _ledger(values: Columns, setting: Setting) -> dict[str, Floats]:
    """Energies over time; ``numerical`` closes the sum."""
    kinetic = 0.5 * setting.mass * values.velocity**2
    potential = -setting.mass * setting.gravity * values.position
    # It only grows; what the difference of two sums loses in the last digit is put right.
    dissipated = np.maximum.accumulate(values.spring_work - values.stored + values.plate_loss)
    total = setting.mass * setting.gravity * setting.height
    known = kinetic + potential + values.stored + dissipated + values.plate_energy
    return {
        "kinetic_energy": kinetic,
        "potential_energy": potential,
        "stored_energy": values.stored,
        "dissipated_energy": dissipated,
        "numerical_energy": total - known,
    }


def _thesis_rows(run: ThesisRun, setting: Setting) -> dict[str, Floats]:
    """Rows as far as steps of equal length resolve them: a contact is a run of steps with force."""
    loaded = np.concatenate([[0], (run.force > 0.0).astype(int), [0]])
    starts = np.flatnonzero(np.diff(loaded) == 1).tolist()
    stops = np.flatnonzero(np.diff(loaded) == -1).tolist()
    rows = []
    for start, stop in zip(starts, stops, strict=True):
        if stop >= run.time.size:
            continue
        touch = max(start - 1, 0)
        inside = slice(touch, stop + 1)
        incoming, outgoing = run.velocity[touch], -run.velocity[stop]
        rows.append(
            (
                run.time[touch] + setting.fall_time,
                run.time[stop] + setting.fall_time,
                run.time[stop] - run.time[touch],
                incoming,
                outgoing,
                outgoing / incoming if incoming > 0.0 else nan,
                run.force[inside].max(),
                run.contact_radius[inside].max(),
                run.position[inside].max(),
                run.position[inside].max() - run.position[touch],
                nan,
                nan,
            )
        )
    return _table(rows)
