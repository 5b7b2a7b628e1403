"""What the uncertainties of the inputs do to a simulated drop: to its impacts, and to its path between them."""

import json
from collections.abc import Iterator, Mapping

import numpy as np
import xarray as xr

from labpipe.arrays import Floats
from labpipe.uncertainty import Source, budget_rows
from labpipe.units import Quantity
from labpipe.variables import variable
from pipelines.experiments.ball_drop.measured import padded

UNCERTAIN = (
    "restitution",
    "impact_time",
    "peak_force",
    "peak_contact_radius",
    "contact_duration",
    "penetration",
    "impact_speed",
)
"""Results of each impact whose sensitivities are found."""
FOLLOWED = 20
"""Impacts whose sensitivities are found, and that are laid against the model one by one.

Three are compared; PEEK bounces a hundred times, and each impact costs a contact for every input.
"""
_OF_CONTACT = ("impact_time", "contact_duration", "penetration")

Slopes = Mapping[str, tuple[Quantity, Mapping[str, Floats]]]
"""By input, its value and the change of each result (impact,) per SI unit of it."""


def with_uncertainty(made: xr.Dataset, slopes: Slopes) -> xr.Dataset:
    """Add what the uncertainties of the inputs do to the first impacts, and to the path until the last of them."""
    count = made.sizes["impact"]
    for name in UNCERTAIN:
        parts = [np.nan_to_num(by[name]) * given.u for given, by in slopes.values()]
        made[f"u_{name}"] = variable(
            "impact",
            padded(np.sqrt(np.sum(np.square(parts), axis=0)), count),
            made[name].attrs["units"],
            f"standard uncertainty from {', '.join(slopes)}: {name}",
        )
    made["u_displacement"] = variable(
        "time", _of_path(made, slopes), "m", "standard uncertainty from the inputs, from first contact on: displacement"
    )
    made = made.assign_coords(slope_input=np.array(list(slopes), dtype=str))
    given = [quantity for quantity, _ in slopes.values()]
    made.attrs["input_units"] = json.dumps([quantity.si for quantity in given])
    for name, values, text in (
        ("input_value", [q.value for q in given], "value of an input of the model, SI"),
        ("input_u", [q.u for q in given], "standard uncertainty of an input of the model, SI"),
    ):
        made[name] = variable("slope_input", values, "1", text)
    for name in UNCERTAIN:
        made[f"slope_{name}"] = variable(
            ("slope_input", "impact"),
            np.array([padded(by[name], count) for _, by in slopes.values()]),
            made[name].attrs["units"],
            f"change per SI unit of input: {name}",
        )
    sources = [
        Source.of(key, given, float(np.nan_to_num(by["restitution"][0])))
        for key, (given, by) in slopes.items()
        if count and given.u > 0.0
    ]
    made.attrs["budget"] = json.dumps(budget_rows(sources))
    return made


def stored_slopes(made: xr.Dataset) -> Slopes:
    """Return the sensitivities that :func:`with_uncertainty` kept beside a simulated drop."""
    units = json.loads(made.attrs["input_units"])
    given = zip(made["input_value"].values, made["input_u"].values, units, strict=True)
    return {
        str(name): (
            Quantity(float(value), float(u), unit),
            {of: made[f"slope_{of}"].values[i][:FOLLOWED] for of in UNCERTAIN},
        )
        for i, (name, (value, u, unit)) in enumerate(zip(made["slope_input"].values, given, strict=True))
    }


def _of_path(made: xr.Dataset, slopes: Slopes) -> Floats:
    """Return the standard uncertainty of the displacement (time,), times counted from the first contact.

    NaN behind the last impact whose sensitivities were found.
    """
    squares = np.full(made["time"].shape, 0.0 if made.sizes["impact"] else np.nan)
    for moved in path_by_input(made, slopes):
        squares += np.square(moved)
    return np.sqrt(squares)


def path_by_input(made: xr.Dataset, slopes: Slopes) -> Iterator[Floats]:
    """Yield what one standard uncertainty of each uncertain input does to the displacement (time,) [m]."""
    time, path = made["time"].values, made["displacement"].values
    touches, durations, depths = (made[name].values for name in _OF_CONTACT)
    for given, by in slopes.values():
        if given.u > 0.0 and touches.size:
            slope, longer, deeper = (by[name] for name in _OF_CONTACT)
            whole = np.isfinite(durations[: slope.size] + depths[: slope.size] + longer + deeper)
            count = int(np.cumprod(whole).sum())  # a contact that the end of the record cuts has neither
            pairs = (touches, durations), (slope, longer)
            nodes, later = (np.stack((a[:count], a[:count] + b[:count]), axis=1).ravel() for a, b in pairs)
            deeper = deeper[:count] / depths[:count]
            fall = np.where(time < touches[0], by["impact_speed"][0] * (touches[0] - time), 0.0)
            up, down = (_moved(time, path, nodes, u * later, u * deeper) + u * fall for u in (given.u, -given.u))
            yield 0.5 * (up - down)


def _moved(time: Floats, path: Floats, nodes: Floats, later: Floats, deeper: Floats) -> Floats:
    """Return the path (time,) whose touches and lift-offs (2 impact,) come later; contacts are deeper by a share.

    What lies between is stretched: a contact in time, and a flight, as it is free, by the square in height too.
    """
    moved = nodes + later
    # a shift as long as a flight says nothing of the path any more
    if not moved.size or not np.all(np.diff(moved) > 0.0):
        return np.full(time.shape, np.nan)
    last = np.searchsorted(moved, time, side="right") - 1
    found = np.interp(np.where(last < 0, time, np.interp(time, moved, nodes, right=np.nan)), time, path)
    higher = np.square(np.diff(moved) / np.diff(nodes))
    higher[::2] = 1.0 + deeper
    return np.where(last < 0, found, found * np.append(higher, 1.0)[last])
