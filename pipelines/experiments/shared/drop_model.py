"""A dropped sphere simulated, with the sensitivities of its first impacts to every input.

A drop that the laser sees and one that is filmed through the disc are one model.
"""

import json
from collections.abc import Mapping
from dataclasses import asdict, replace
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from labpipe import contact, materials
from labpipe.arrays import Floats
from labpipe.report import quantity, value_with_uncertainty
from labpipe.uncertainty import Row, Source, budget_rows
from labpipe.units import Quantity
from labpipe.variables import variable
from pipelines.experiments.shared.counter_body import (
    OF_PLATE,
    counter_body_of,
    described_flat,
    modulus_of,
    plate_inputs,
    resolve_plate,
)
from pipelines.experiments.shared.material_choice import IMPACT_TIMES, resolve, variations
from pipelines.experiments.shared.model_inputs import inputs_of, table_of
from pipelines.experiments.shared.proposals import material_word
from pipelines.experiments.shared.settings import Sphere

_UNCERTAIN = (
    "restitution",
    "impact_time",
    "peak_force",
    "peak_contact_radius",
    "contact_duration",
    "penetration",
    "impact_speed",
)
_ONSET = 1.6
"""Peak pressure over yield stress at which yield begins under a Hertzian contact (K. L. Johnson, Contact Mechanics,
1985, section 6.1, doi:10.1017/CBO9781139171731)."""
_MEAN_STRAIN = 0.2  # of a contact over a/R (the same, section 6.2)


def simulated_drop(
    settings: Any,
    material_file: Path | None,
    fitted: xr.Dataset | None,
    plate: xr.Dataset | None,
    duration: float,
    step: float,
    *,
    followed: int,
    of_budget: str,
    full: bool = False,
    coarse: float = 1e-3,
    of_modulus: float = 0.01,
) -> xr.Dataset:
    """Simulate a drop, with the effect of its inputs' uncertainties on the first impacts.

    ``settings`` are those of a ball drop or of a contact area; the curve has a point each ``step`` of ``duration``
    [s] from the release. Sensitivities are found to the tolerance ``coarse``, from relative changes of at least as
    much, ``of_modulus`` of the modulus. ``full`` disables the simulator's shortcuts; the numbers stay the same within
    ``rtol``.

    Returned is the result of :func:`labpipe.contact.drop` with, of the first ``followed`` impacts and NaN beyond,
    ``u_NAME`` (impact,) and ``slope_NAME`` (uncertain, impact) per SI unit; the inputs
    (:mod:`pipelines.experiments.shared.model_inputs`); and as JSON ``plate``, ``linear_range`` and the ``budget``
    of the variable ``of_budget`` at the first impact.
    """
    sphere, chosen, gravity = settings.sphere, settings.model, settings.model.gravity.value
    solid, under = resolve(sphere, material_file, fitted), resolve_plate(settings.plate, plate)
    flat, height = counter_body_of(settings.counter_body), settings.height.value
    made = contact.drop(
        solid,
        sphere.radius.value,
        sphere.mass.value,
        height,
        duration,
        chosen.solver,
        chosen.profile,
        chosen.rtol,
        gravity=gravity,
        times=np.arange(0.0, duration, step),
        plate=under,
        substrate=flat,
        full=full,
    )
    changes = dict[str, tuple[Quantity, float, Any]]()  # of each input: the input, its step, and what it makes of it
    floor = plate_inputs(settings.plate, plate)
    inputs = {"height": settings.height, "radius": sphere.radius, "mass": sphere.mass}
    for name, one in (inputs | {f"{OF_PLATE}{name}": one for name, one in floor.items()}).items():
        by = max(one.u, coarse * one.value)  # one without an uncertainty may be stated wrongly as well
        part = name.removeprefix(OF_PLATE)
        changes[name] = one, by, replace(under, **{part: one.value + by}) if under and part != name else one.value + by
    solids = variations(sphere, material_file, fitted, IMPACT_TIMES)
    # compliances add up and go as 1/E: on a rigid flat a result differs by its slope times E
    flats = {name: (one, one.value, None) for name, one in modulus_of(settings.counter_body).items()}
    stiffer = Quantity(1.0, 0.0, "1"), of_modulus, solid.scaled(1.0 + of_modulus)
    changes |= solids | flats | {"modulus": stiffer}

    def moved(best: Any, *names: str) -> list[Any]:
        return [best, *(other if name in names else best for name, (_, _, other) in changes.items())]

    count, found = min(made.sizes["impact"], followed), dict.fromkeys(_UNCERTAIN, np.zeros((1 + len(changes), 0)))
    if count:
        train = contact.impacts(
            moved(solid, *solids, "modulus"),
            moved(sphere.radius.value, "radius"),
            moved(sphere.mass.value, "mass"),
            moved(height, "height"),
            duration,
            count,
            chosen.profile,
            max(chosen.rtol, coarse),
            gravity=gravity,
            plate=moved(under, *(f"{OF_PLATE}{name}" for name in floor)),
            substrate=moved(flat, *flats),
        )
        found = {name: train[name].values for name in _UNCERTAIN}
        found["impact_time"] = found["impact_time"] - found["impact_time"][:, :1]  # compared from first contact
    made, budget = _with_slopes(made, changes, found, of_budget)
    work = json.loads(made.attrs["work"])
    work.pop("seconds", None)  # the clock has no place in a stored result
    known = {
        "linear_range": linear_range(made, sphere, height, material_file, fitted),
        "plate": None if under is None else asdict(under),
        "work": work,
        "budget": budget,
    }
    return made.assign_attrs({name: json.dumps(value) for name, value in known.items()})


def _with_slopes(
    made: xr.Dataset, changes: Mapping[str, tuple[Quantity, float, Any]], found: Mapping[str, Floats], of_budget: str
) -> tuple[xr.Dataset, list[Row]]:
    """Add sensitivities, and the effect of the inputs' uncertainties on the first impacts; return a budget too."""
    given, n = {name: one for name, (one, _, _) in changes.items()}, made.sizes["impact"]
    u, by = (np.array(of)[:, None] for of in zip(*((one.u, step) for one, step, _ in changes.values()), strict=True))
    made, sources = made.merge(table_of(given)), []
    for name, values in found.items():
        slope, units = (values[1:] - values[0]) / by, made[name].attrs["units"]
        whole, text = np.linalg.norm(np.nan_to_num(slope) * u, axis=0), f"standard uncertainty from {', '.join(given)}"
        made[f"u_{name}"] = variable("impact", padded(whole, n), units, f"{text}: {name}")
        text = f"change per SI unit of input: {name}"
        made[f"slope_{name}"] = variable(("uncertain", "impact"), padded(slope.T, n).T, units, text)
        if name == of_budget and n:
            first = zip(given.items(), np.nan_to_num(slope[:, 0]).tolist(), strict=True)
            sources = [Source.of(of, one, change) for (of, one), change in first if one.u > 0.0]
    return made, budget_rows(sources)


def slopes_of(made: xr.Dataset, name: str, impact: int) -> dict[str, float]:
    """Return the derivatives of measured minus simulated, of a variable of one impact, to the inputs."""
    inputs, changes = made.variables["uncertain"].values, made.variables[f"slope_{name}"].values[:, impact]
    return {str(of): -float(slope) for of, slope in zip(inputs, changes, strict=True) if np.isfinite(slope)}


def padded(values: Floats, count: int) -> Floats:
    """Return values (impact, …) and NaN up to a number of impacts."""
    return np.concatenate([values, np.full((count - len(values), *values.shape[1:]), np.nan)])


def linear_range(
    made: xr.Dataset, sphere: Sphere, height: float, file: Path | None, fitted: xr.Dataset | None
) -> dict[str, Any]:
    """Return pressure and strain of the first impact of a simulated drop, and up to where linearity is known.

    ``strain``; of the rheometer's ``sweeps``, None where their files state none; ``pressure`` [Pa], that of Hertz for
    the largest force and radius. Where the yield stress of the material is known, at the mean strain ``rate`` [1/s] of
    the contact: ``onset``, ``u_onset`` [Pa], ``beyond``, the number of impacts whose pressure exceeds it, and ``fall``
    [m], from which the first one does (the pressure goes with the fifth root of the height).
    """
    if not made.sizes["impact"]:
        return {}
    pressure, duration = float(made["peak_pressure"][0]), float(made["contact_duration"][0])
    strain = _MEAN_STRAIN * float(made["peak_contact_radius"][0]) / sphere.radius.value
    found = {"pressure": pressure, "strain": strain, "sweeps": None if fitted is None else fitted.attrs.get("strain")}
    named = file or material_word(sphere.source)
    stress = None if named is None else materials.describe(named).yield_stress
    if stress is None or not isfinite(duration):
        return found
    rate = 2.0 * strain / duration
    onset, u_onset = (_ONSET * each for each in stress.at(rate)[:2])
    found |= {"material": sphere.source if file else named, "fall": height * (onset / pressure) ** 5}
    beyond = int((made["peak_pressure"].values > onset).sum())
    return found | {"rate": rate, "onset": onset, "u_onset": u_onset, "beyond": beyond}


def described_plate(model: xr.Dataset) -> str:
    """Write modal mass, frequency and damping ratio of the plate under a simulated drop; empty where it stays at rest.

    ``"(30.04 ± 0.35) kg, (180.22 ± 0.20) Hz, damping ratio 0.0203 ± 0.0011"``
    """
    given, parts = inputs_of(model), {"mass": "", "frequency": "", "damping_ratio": "damping ratio "}
    plate = {part: given.get(f"{OF_PLATE}{part}") for part in parts}
    return ", ".join(parts[p] + value_with_uncertainty(*one[:2], one.si) for p, one in plate.items() if one is not None)


def simulated(settings: Any, model: xr.Dataset) -> str:
    """Write for a manuscript how a drop was simulated."""
    plate, sphere = described_plate(model), settings.sphere
    under = f"{described_flat(settings.counter_body)}{plate and f' and a plate of {plate}'}"
    return (
        f"The drop on {under} was simulated with the material “{sphere.source}” by the method of dimensionality "
        f"reduction (Popov and Heß 2015, doi:10.1007/978-3-642-53876-6; profile: {settings.model.profile}, tolerance "
        f"{settings.model.rtol:g}). "
    )


def linear_range_rows(model: xr.Dataset) -> list[tuple[str, str, str]]:
    """Return pressure and strain of the first impact for a page, and whether linear viscoelasticity holds there."""
    known = json.loads(model.attrs.get("linear_range", "{}"))
    if not known:
        return []
    remark = "no yield stress of this material is known"
    if "onset" in known:
        limit, fall = value_with_uncertainty(known["onset"], known["u_onset"], "Pa"), quantity(known["fall"], "m", 2)
        likely = "probably " * (abs(known["pressure"] - known["onset"]) < 2.0 * known["u_onset"])
        which = "the first impact" if known["beyond"] == 1 else f"the first {known['beyond']} impacts"
        ends = f"ends in {which}, and the model leaves out the losses by yield" if known["beyond"] else "holds"
        remark = f"{known['material']} begins to yield at 1.6 Y = {limit} (at a strain rate of {known['rate']:.2g} s⁻¹)"
        remark += f", from a fall of some {fall} on: linear viscoelasticity {likely}{ends}"
    of_sweeps = "the strain of the sweeps is not known"
    if (sweeps := known["sweeps"]) is not None:
        beyond = "; that the moduli are linear beyond is assumed" * (sweeps < known["strain"])
        of_sweeps = f"the sweeps went up to {100.0 * sweeps:.2g} %{beyond}"
    pressure, strain = quantity(known["pressure"], "Pa", 3), f"{100.0 * known['strain']:.2g} %"
    return [("largest pressure", pressure, remark), ("mean strain, 0.2 a/R", strain, of_sweeps)]
