"""The result of a drop as a Dataset: time series, one row per bounce, ledger, work done."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from math import nan, sqrt

import numpy as np
import xarray as xr

from labpipe.arrays import Floats
from labpipe.contact.impact._line_springs import Profile
from labpipe.contact.impact._motion import Body, Counts, Snapshot, Springs, counted
from labpipe.contact.impact._plate import Plate
from labpipe.contact.impact._thesis_scheme import ThesisRun
from labpipe.contact.impact._trajectory import Columns, Contact, Segment, columns, peak, record_columns
from labpipe.contact.memory import Condensed
from labpipe.variables import described, variable

# Maps reach so far beyond the largest contact radius, with so many points.
_MAP_REACH, _MAP_POINTS = 1.25, 201

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


@dataclass(frozen=True, slots=True)
class Setting:
    """What was asked for; see :func:`labpipe.contact.drop`."""

    radius: float
    mass: float
    height: float
    duration: float
    solver: str
    profile: Profile
    rtol: float
    gravity: float
    plate: Plate | None

    @property
    def speed(self) -> float:
        """Speed in m/s at first touch."""
        return sqrt(2.0 * self.gravity * self.height)

    @property
    def fall_time(self) -> float:
        """Time in s from the release to first touch."""
        return sqrt(2.0 * self.height / self.gravity)


@dataclass(frozen=True, slots=True)
class DropRun:
    """A finished simulation; times count from first touch."""

    segments: list[Segment]
    body: Body
    counts: Counts
    condensed: Condensed
    springs: Springs
    snapshots: tuple[Snapshot, ...]
    final_touch: float
    rest_start: float


def dataset(
    run: DropRun, setting: Setting, times: Floats | None, rigid_restitution: float | None, seconds: float
) -> xr.Dataset:
    """Assemble the Dataset that :func:`labpipe.contact.drop` returns.

    ``run``: The simulation. ``setting``: What was asked for. ``times`` (time,): Where to report, from the release.
    ``rigid_restitution``: Of the first impact on a rigid substrate, when there is a plate. ``seconds``: Wall time so
    far.
    """
    natural = columns(run.segments, run.body, None)
    error = _identity_error(run, setting, _energy_scale(natural, setting))
    wanted = None if times is None else times - setting.fall_time
    values = natural if wanted is None else columns(run.segments, run.body, wanted)
    series = _series(values, _ledger(values, setting), has_plate=setting.plate is not None)
    time = values.time + setting.fall_time if times is None else times
    work = counted(run.counts) | {
        "springs": int(run.springs.position.size),
        "terms": run.condensed.creep.n_terms,
        "terms_folded": run.condensed.n_folded,
        "terms_frozen": run.condensed.n_frozen,
        "seconds": round(seconds, 4),
    }
    scalars = {
        "final_contact_time": run.final_touch + setting.fall_time,
        "rest_time": run.rest_start + setting.fall_time,
    }
    if rigid_restitution is not None:
        scalars["rigid_restitution"] = rigid_restitution
    result = _assemble(time, series, impact_rows(run, setting), scalars, setting, work)
    result.attrs["energy_identity_error"] = error
    if run.snapshots:
        result = result.assign(_maps(run, setting))
    return result


def _maps(run: DropRun, setting: Setting) -> dict[str, xr.DataArray]:
    """Pressure and surface at the instants that were asked for."""
    contacts = [segment.records for segment in run.segments if isinstance(segment, Contact)]
    largest = max((float(found["contact_radius"].max()) for found in contacts), default=0.0)
    reach = min(_MAP_REACH * largest, float(run.springs.position[-1]))
    radius = np.linspace(0.0, reach or float(run.springs.position[-1]), _MAP_POINTS)
    pressure = [run.springs.pressure(s.load, s.contact_radius, radius) for s in run.snapshots]
    surface = [run.springs.surface(s.displacement, radius) for s in run.snapshots]
    time = np.array([s.time for s in run.snapshots]) + setting.fall_time
    coords = {
        "map_time": variable("map_time", time, "s", "time since the release"),
        "r": variable("r", radius, "m", "distance from the axis"),
    }
    return {
        name: xr.DataArray(np.array(values), dims=("map_time", "r"), coords=coords, attrs=described(units, long_name))
        for name, values, units, long_name in (
            ("pressure", pressure, "Pa", "contact pressure"),
            ("surface", surface, "m", "displacement of the surface, into the sphere"),
        )
    }


def energy_error(run: DropRun, setting: Setting) -> float:
    """Largest numerical energy error of the discretisation, relative to the energy of the drop."""
    values = columns(run.segments, run.body, None)
    return float(np.abs(_ledger(values, setting)["numerical_energy"]).max()) / _energy_scale(values, setting)


def _energy_scale(values: Columns, setting: Setting) -> float:
    """Energy in J of the fall, or of the sinking in where that is more."""
    deepest = float(np.max(np.abs(values.position)))
    return setting.mass * setting.gravity * max(setting.height, deepest)


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


def _identity_error(run: DropRun, setting: Setting, scale: float) -> float:
    """Deviation of the numerical energy error from the trapezoid of the force less the work.

    The largest deviation relative to the energy of the drop, of the contacts that were stepped with
    average acceleration, which leaves rounding. Others have no such identity.
    """
    worst = 0.0
    for contact in run.segments:
        if not isinstance(contact, Contact) or contact.is_resting or contact.curves is not None:
            continue
        values = record_columns(contact.records, run.body.plate)
        kinetic = 0.5 * setting.mass * values.velocity**2
        potential = -setting.mass * setting.gravity * values.position
        ledger = kinetic + potential + values.plate_energy + values.plate_loss
        step = 0.5 * (values.force[1:] + values.force[:-1]) * np.diff(values.approach)
        deviation = ledger - ledger[0] + np.concatenate([[0.0], np.cumsum(step)])
        worst = max(worst, float(np.abs(deviation).max()))
    return worst / scale


def _series(values: Columns, ledger: dict[str, Floats], *, has_plate: bool) -> dict[str, Floats]:
    series = {
        "displacement": -values.position,
        "velocity": -values.velocity,
        "approach": values.approach,
        "reduced_gap": values.surface - values.approach,
        "force": values.force,
        "contact_radius": values.contact_radius,
        **ledger,
    }
    if has_plate:
        series["plate_displacement"] = values.plate_displacement
        series["plate_energy"] = values.plate_energy
    return series


def impact_rows(run: DropRun, setting: Setting) -> dict[str, Floats]:
    """One row per contact that ended in a flight, also where it went on by another solver."""
    rows, parts = [], list[Contact]()
    for segment in run.segments:
        if isinstance(segment, Contact):
            parts.append(segment)
            continue
        if parts:
            rows.append(_impact_row(parts, run, setting))
        parts = []
    table = np.array(rows, dtype=float).reshape(len(rows), len(ROWS))
    return dict(zip(ROWS, table.T, strict=True))


def _impact_row(parts: Sequence[Contact], run: DropRun, setting: Setting) -> tuple[float, ...]:
    all_steps = [record_columns(part.records, run.body.plate) for part in parts]
    first, last = all_steps[0], all_steps[-1]
    peaks = []
    for part, steps in zip(parts, all_steps, strict=True):
        if curves := part.curves:
            found = [curves.peak_force, curves.largest, curves.peak_approach, curves.penetration]
        else:
            looked_at = steps.force, steps.contact_radius, steps.approach, steps.position - steps.position[0]
            found = [peak(steps.time, values) for values in looked_at]
        found[3] += float(steps.position[0] - first.position[0])
        peaks.append(found)
    incoming, outgoing = float(first.velocity[0]), -float(last.velocity[-1])
    return (
        first.time[0] + setting.fall_time,
        last.time[-1] + setting.fall_time,
        last.time[-1] - first.time[0],
        incoming,
        outgoing,
        outgoing / incoming if incoming > 0.0 else nan,
        *np.max(peaks, axis=0),
        last.spring_work[-1] - last.stored[-1] - (first.spring_work[0] - first.stored[0]),
        last.stored[-1],
    )


def _thesis_rows(run: ThesisRun, setting: Setting) -> dict[str, Floats]:
    """Rows as far as steps of equal length can tell: a contact is a run of steps with force."""
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
    table = np.array(rows, dtype=float).reshape(len(rows), len(ROWS))
    return dict(zip(ROWS, table.T, strict=True))
