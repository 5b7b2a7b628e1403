"""Ball drop: from laser exports to bounces, the mean of the repeats, and the model beside it.

Conventions: heights count upwards; a repeat's time 0 is its first contact, its displacement 0 the
level of that contact.
"""

import json
from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

import calibration
from calibration import laser
from labpipe import contact, signals
from labpipe.materials import Prony
from labpipe.uncertainty import Source, table
from labpipe.units import Quantity
from pipelines.experiments.ball_drop.settings import BallDrop
from pipelines.experiments.shared.laser_readings import read_laser
from pipelines.experiments.shared.material_choice import resolve, variations
from pipelines.experiments.shared.plate_under_drop import plate_inputs, resolve_plate

Array = NDArray[np.float64]

_CURVE_STEP = 5e-5  # s, spacing of the model's curve; contacts of 1 ms get twenty points
_COARSE = 1e-3  # tolerance of the simulations by which sensitivities are found
_OF_PLATE = "plate "
_LEAST_CHANGE = 1e-3  # relative change of an input by which a sensitivity is found
_UNCERTAIN = ("restitution", "impact_time", "peak_force", "peak_contact_radius")
_SPEEDS = ("incoming_speed", "outgoing_speed")
_PER_IMPACT = ("restitution", "touch_time", "incoming_speed", "outgoing_speed", "contact_duration")


def readings(path: Path, *, settings: BallDrop) -> xr.Dataset:
    """Read one laser export; what it leaves unsaid comes from the settings."""
    return read_laser(path, settings.keyence)


def displacement(readings: xr.Dataset, record: Path, *, settings: BallDrop) -> xr.Dataset:
    """Correct the inclination: upward displacement of the holder, with uncertainty."""
    known = calibration.load_record(record)
    if settings.sensor.serial is not None:
        readings = readings.assign_attrs(serial=settings.sensor.serial)
    options: dict[str, Any] = {
        "output": settings.sensor.output,
        "direction": settings.sensor.direction,
        "measured": settings.measured_on,
    }
    moved = laser.displacement(readings, known, **options)
    if not settings.analysis.inclination_from_height:
        return moved
    found = _inclination(moved, settings)
    again = laser.displacement(readings, known, inclination=found, **options)
    recorded = {"value": float(moved["inclination"]), "u": float(moved["u_inclination"])}
    return again.assign_attrs(inclination_of_record=json.dumps(recorded))


def _inclination(moved: xr.Dataset, settings: BallDrop) -> Quantity:
    """Fit the inclination from the fall of known height, along the line of sight."""
    gain = float(moved["gain"])
    along = moved["displacement_raw"] * gain
    fall = signals.bounces(along, contact=settings.analysis.contact)
    travel = Quantity(float(fall["drop_height"]), float(fall["u_drop_height"]), "m")
    return laser.inclination_from_drop(travel, settings.height)


def bounces(displacement: xr.Dataset, *, settings: BallDrop) -> xr.Dataset:
    """Find release, contacts and rest; speeds carry the inclination's uncertainty too."""
    found = signals.bounces(displacement, contact=settings.analysis.contact)
    relative = float(displacement.attrs["u_systematic_relative"])
    for name in (*_SPEEDS, "drop_height"):
        own, scale = found[f"u_{name}"], relative * found[name].values
        found[f"u_{name}"] = own.copy(data=np.hypot(own.values, scale))
    return found


def velocity(displacement: xr.Dataset, bounces: xr.Dataset, *, settings: BallDrop) -> xr.Dataset:
    """Differentiate, with knots free to break where contacts begin and end."""
    chosen = settings.analysis
    options: dict[str, Any] = {"method": chosen.velocity}
    if chosen.window is not None:
        interval = float(np.median(np.diff(displacement["time"])))
        options["window"] = max(1, round(chosen.window.value / interval))
    if chosen.velocity == "spline":
        edges = np.concatenate([bounces["touch_time"].values, bounces["liftoff_time"].values])
        options["breaks"] = np.sort(edges[np.isfinite(edges)])
        release = float(bounces["release_time"])
        options["releases"] = [release] if np.isfinite(release) else []
    found = signals.velocity(displacement["displacement"], **options)
    return xr.Dataset(
        {"velocity": found.drop_vars("u_velocity"), "u_velocity": found["u_velocity"].variable},
        attrs=found.attrs,
    )


def repeats(
    displacement: list[xr.Dataset],
    velocity: list[xr.Dataset],
    bounces: list[xr.Dataset],
    *,
    settings: BallDrop,
) -> xr.Dataset:
    """Align the repeats at first contact: mean, band, outliers, and the table of bounces."""
    del settings
    starts = np.array([float(b["first_contact_time"]) for b in bounces])
    levels = [float(b["contact_level"]) for b in bounces]
    shifted = [
        (d["displacement"] - level).assign_attrs(d["displacement"].attrs)
        for d, level in zip(displacement, levels, strict=True)
    ]
    made = signals.combine_repeats(shifted, starts)
    speeds = signals.combine_repeats([v["velocity"] for v in velocity], starts)
    made = made.merge(speeds.drop_vars(["is_outlier", "n"]))
    relative = float(displacement[0].attrs["u_systematic_relative"])
    random = made["displacement_sd"].values / np.sqrt(np.maximum(made["n"].values, 1))
    made["u_displacement_mean"] = (
        "time",
        np.hypot(np.nan_to_num(random), relative * made["displacement_mean"].values),
        {"units": "m", "long_name": "standard uncertainty: mean displacement"},
    )
    made = made.merge(_table(bounces, relative))
    made.attrs = {"u_systematic_relative": relative}
    return made


def _table(bounces: list[xr.Dataset], relative: float) -> xr.Dataset:
    """Mean of every bounce over the repeats that show it; touch times since first contact.

    What all repeats share, the unknown shape of the contact's pulse and the sensor's scale, is as
    uncertain of the mean as of one of them; only the rest falls with their number.
    """
    count = max(b.sizes["impact"] for b in bounces)
    table: dict[str, Any] = {}
    for name in _PER_IMPACT:
        shift = [float(b["first_contact_time"]) if name == "touch_time" else 0.0 for b in bounces]
        values = np.array([
            _padded(b[name].values - s, count) for b, s in zip(bounces, shift, strict=True)
        ])  # fmt: skip
        own = np.array([_padded(b[f"u_{name}"].values, count) for b in bounces])
        n = np.isfinite(values).sum(axis=0)
        mean = np.nanmean(values, axis=0)
        shape = np.array([_padded(b[f"shared_u_{name}"].values, count) for b in bounces])
        shared = np.nanmean(shape**2, axis=0)
        if name in _SPEEDS:
            shared = shared + (relative * mean) ** 2
        # scatter between repeats, but never less than what each repeat states of itself
        scatter = np.sqrt(np.nansum((values - mean) ** 2, axis=0) / np.maximum(n - 1, 1))
        stated = np.sqrt(np.maximum(np.nanmean(own**2, axis=0) - shared, 0.0))
        apart = np.where(n > 1, np.maximum(scatter, stated), stated) / np.sqrt(n)
        u = np.hypot(apart, np.sqrt(shared))
        text = bounces[0][name].attrs
        table[name] = ("impact", mean, text)
        table[f"u_{name}"] = (
            "impact", u, {"units": text["units"], "long_name": f"standard uncertainty: {name}"},
        )  # fmt: skip
        table[f"{name}_sd"] = (
            "impact", np.where(n > 1, scatter, np.nan),
            {"units": text["units"], "long_name": f"standard deviation over repeats: {name}"},
        )  # fmt: skip
    table["n_repeats"] = ("impact", n, {"units": "1", "long_name": "repeats that show the bounce"})
    return xr.Dataset(table, coords={"impact": np.arange(1, count + 1)})


def _padded(values: Array, count: int) -> Array:
    return np.concatenate([values, np.full(count - values.size, np.nan)])


def model(
    repeats: xr.Dataset,
    material_file: Path | None,
    fitted: xr.Dataset | None,
    plate: xr.Dataset | None,
    *,
    settings: BallDrop,
    full: bool = False,
) -> xr.Dataset:
    """Simulate the drop as long as the record lasts, with the uncertainty of its inputs.

    ``full`` takes the simulator's shortcuts away; the numbers stay the same within ``rtol``.
    """
    sphere, chosen = settings.sphere, settings.model
    solid = resolve(sphere, material_file, fitted)
    gravity = chosen.gravity.value
    fall = np.sqrt(2 * settings.height.value / gravity)
    duration = float(fall + repeats["time"].max())
    times = np.arange(0.0, duration, _CURVE_STEP)
    body = {"height": settings.height, "radius": sphere.radius, "mass": sphere.mass}
    substrate = resolve_plate(settings.plate, plate)
    floor = plate_inputs(settings.plate, plate)
    inputs = body | {f"{_OF_PLATE}{name}": quantity for name, quantity in floor.items()}
    solids = variations(sphere, material_file, fitted)

    def simulate(other: Prony, rtol: float, times: Array | None, **change: float) -> xr.Dataset:
        values = {name: quantity.value for name, quantity in inputs.items()} | change
        moved = {name: values[f"{_OF_PLATE}{name}"] for name in floor}
        return contact.drop(
            other, values["radius"], values["mass"], values["height"], duration, chosen.solver,
            chosen.profile, rtol, gravity=gravity, times=times,
            plate=None if substrate is None else replace(substrate, **moved),
            fold=not full, shortcuts=contact.Shortcuts.chosen(full=full),
        )  # fmt: skip

    made = simulate(solid, chosen.rtol, times)
    # On a ringing plate a later touch meets it at another moment when the height changes, so the
    # body's sensitivities are those on the plate; a few per cent of a sensitivity do no harm.
    coarse = max(chosen.rtol, _COARSE)
    reference, count = simulate(solid, coarse, None), made.sizes["impact"]
    slopes = {}
    for key, given in inputs.items():
        if given.u > 0.0:
            change = max(given.u, _LEAST_CHANGE * given.value)
            off = simulate(solid, coarse, None, **{key: given.value + change})
            slopes[key] = given, _slopes(off, reference, change, count)
    for key, (given, change, other) in solids.items():
        slopes[key] = given, _slopes(simulate(other, coarse, None), reference, change, count)
    made = _with_uncertainty(made, slopes)
    made.attrs["plate"] = json.dumps(None if substrate is None else asdict(substrate))
    work = json.loads(made.attrs["work"])
    work.pop("seconds", None)  # the clock has no place in a stored result
    made.attrs["work"] = json.dumps(work)
    return made


def _slopes(
    other: xr.Dataset, reference: xr.Dataset, change: float, count: int
) -> dict[str, Array]:
    """Return the change (impact,) of each uncertain result per change of one input."""
    shared = min(other.sizes["impact"], reference.sizes["impact"], count)
    found = {}
    for name in _UNCERTAIN:
        values = other[name].values[:shared], reference[name].values[:shared]
        if name == "impact_time":  # what is compared counts from the first contact
            values = values[0] - values[0][0], values[1] - values[1][0]
        found[name] = _padded((values[0] - values[1]) / change, count)
    return found


def _with_uncertainty(
    made: xr.Dataset, slopes: Mapping[str, tuple[Quantity, dict[str, Array]]]
) -> xr.Dataset:
    """Add what the uncertainties of the inputs do to restitution, times, forces and radii."""
    for name in _UNCERTAIN:
        parts = [np.nan_to_num(by[name]) * given.u for given, by in slopes.values()]
        made[f"u_{name}"] = (
            "impact",
            np.sqrt(np.sum(np.square(parts), axis=0)) if parts else np.zeros(made.sizes["impact"]),
            {
                "units": made[name].attrs["units"],
                "long_name": f"standard uncertainty from {', '.join(slopes)}: {name}",
            },
        )
    sources = [
        Source.of(key, given, float(np.nan_to_num(by["restitution"][0])))
        for key, (given, by) in slopes.items()
        if made.sizes["impact"]
    ]
    made.attrs["budget"] = json.dumps(table(sources))
    return made


def comparison(repeats: xr.Dataset, model: xr.Dataset, *, settings: BallDrop) -> xr.Dataset:
    """Lay the model over the mean of the repeats, both from first contact, and measure the gap."""
    del settings
    first = float(model["impact_time"][0])
    since = model["time"].values - first
    window = repeats["time"].where((repeats["time"] >= since[0]) & (repeats["time"] <= since[-1]))
    time = window.dropna("time").values
    measured = repeats["displacement_mean"].sel(time=time)
    simulated = np.interp(time, since, model["displacement"].values)
    curves = signals.compare(measured, measured.copy(data=simulated))
    return curves.merge(_bounces_compared(repeats, model, first))


def _bounces_compared(repeats: xr.Dataset, model: xr.Dataset, first: float) -> xr.Dataset:
    count = min(repeats.sizes["impact"], model.sizes["impact"])
    pairs = {
        "restitution": (repeats["restitution"], model["restitution"], model["u_restitution"], 0.0),
        "touch_time": (repeats["touch_time"], model["impact_time"], model["u_impact_time"], first),
    }
    table: dict[str, Any] = {}
    for name, (ours, theirs, u_theirs, shift) in pairs.items():
        units = ours.attrs["units"]
        a, b = ours.values[:count], theirs.values[:count] - shift
        u = np.hypot(repeats[f"u_{name}"].values[:count], u_theirs.values[:count])
        for key, values, text in (
            (f"{name}_measured", a, "measured"),
            (f"{name}_model", b, "model"),
            (f"{name}_difference", a - b, "measured minus model"),
        ):
            table[key] = ("impact", values, {"units": units, "long_name": f"{name}, {text}"})
        table[f"u_{name}_difference"] = (
            "impact", u, {"units": units, "long_name": f"standard uncertainty: {name} difference"},
        )  # fmt: skip
    return xr.Dataset(table, coords={"impact": np.arange(1, count + 1)})
