"""The result of an identification as one Dataset, for the store, Python and JSON."""

import json
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import xarray as xr

from labpipe.identification import DETERMINED, LongTimeModulus, Posterior, informative_range, moduli, predictive_bands
from labpipe.materials import Prony
from labpipe.report import SURE
from labpipe.variables import described

UNCHANGED = 0.95
"""Standard deviation over that before, from which on the data are said to tell nothing new."""


@dataclass(frozen=True, eq=False)
class Identified:
    """One identified material.

    ``material`` is its name in the session, ``known`` the posterior (its fit is ``known.fit``), ``relaxed`` the
    limits of the long-time modulus. ``prior`` is the posterior of the rheometer alone, when it was taken as prior;
    ``remarks`` name omitted data and the reasons; ``stated`` is the material that the session names, with the source of
    its moduli, where they are known.
    """

    material: str
    known: Posterior
    relaxed: LongTimeModulus
    prior: Posterior | None
    remarks: tuple[str, ...]
    stated: tuple[str, Prony] | None = None


def dataset(found: Identified, per_decade: int = 6, beyond: float = 100.0) -> xr.Dataset:
    """Return everything that was found; the curves go on beyond the data by a factor.

    Over ``term``: the Prony series ``E`` [Pa], ``rho`` [s] with ``E_relaxed``, ``nu``, of the
    most probable structure. Over ``frequency``, by all structures: storage modulus and loss
    factor with ``u_ln_``, the standard deviations of their logarithms, those of the prior, and ``is_determined``.
    Over ``parameter``: values with 95 % intervals, prior and verdict. Over ``structure``: its
    probability. Over ``observation``: observed,
    predicted, residuals.
    """
    known, fit = found.known, found.known.fit
    solid = fit.problem.material(fit.xi)
    misfits = {
        f"{experiment}: {group}": {"relative": m.relative, "correlation": m.correlation}
        for (experiment, group), m in fit.misfits.items()
    }
    low, high = informative_range(known)
    count = int(np.log10(high / low * beyond**2) * per_decade)
    curve = moduli(known, np.geomspace(low / beyond, high * beyond, count))
    table: dict[str, Any] = {
        "E": ("term", solid.E, described("Pa", "Prony series of the most probable structure")),
        "rho": ("term", solid.rho, described("s", "relaxation times")),
        "E_relaxed": ((), solid.E_relaxed, described("Pa", "long-time modulus")),
        "nu": ((), solid.nu, described("1", "Poisson's ratio, as stated")),
        "lowest_frequency": ((), low, described("Hz", "lowest frequency determined by the data")),
        "highest_frequency": ((), high, described("Hz", "highest frequency determined by the data")),
    }
    table |= {str(name): curve[name].variable for name in curve}
    table |= _parameters(found) | _observations(found)
    chances = structure(found)
    table["structure_name"] = ("structure", list(chances), described("1", "structure of the spectrum"))
    table["structure_probability"] = ("structure", list(chances.values()), described("1", "its posterior probability"))
    return xr.Dataset(
        table,
        coords=curve.coords,
        attrs={
            "material": found.material,
            "experiments": json.dumps([e.name for e in fit.problem.evidence]),
            "cost": fit.cost,
            "costs_from_starts": json.dumps(list(fit.costs_from_starts)),
            "is_settled": int(fit.is_converged),
            "discrepancies": json.dumps(misfits),
            "long_time": json.dumps(asdict(found.relaxed)),
            "remarks": json.dumps(list(found.remarks), ensure_ascii=False),
            "work": json.dumps({"evaluations": fit.evaluations, "differentiations": fit.differentiations}),
        },
    )


def structure(found: Identified) -> dict[str, float]:
    """Return the probabilities of the structures of the spectrum, most probable first."""
    return {one.name: one.weight for one in found.known.structures}


def _parameters(found: Identified) -> dict[str, Any]:
    """Return values, intervals and verdicts of the unknowns.

    The long-time modulus is judged by whether the data show a plateau; any other unknown is
    determined where the data at least halve the standard deviation of its prior, and better known
    where less than :data:`UNCHANGED` of it is left.
    """
    known = found.known
    parameters = known.fit.problem.parameters
    ends = np.array([known.interval(i) for i in range(len(parameters))])
    ends[0, 1:] = found.relaxed.low, found.relaxed.high
    columns = {
        "value": (ends[:, 0], "most probable value"),
        "low": (ends[:, 1], "lower end of the 95 % interval; 0 or less where there is none"),
        "high": (ends[:, 2], "upper end of the 95 % interval; infinite where there is none"),
        "prior_low": ([p.value(-SURE) for p in parameters], "lower end of the prior"),
        "prior_high": ([p.value(SURE) for p in parameters], "upper end of the prior"),
        "contraction": (1.0 - known.sd**2, "reduction of the prior's variance by the data"),
    }
    made: dict[str, Any] = {
        name: ("parameter", np.asarray(values, float), described("1", f"{text}, in the unit named"))
        for name, (values, text) in columns.items()
    }
    made["parameter_name"] = ("parameter", [p.name for p in parameters], described("1", "unknown"))
    made["parameter_unit"] = ("parameter", [p.unit for p in parameters], described("1", "its unit"))
    verdicts = [
        "determined by the data"
        if sd < DETERMINED
        else "better known by the data"
        if sd < UNCHANGED
        else "known from the prior only"
        for sd in known.sd.tolist()
    ]
    verdicts[0] = found.relaxed.verdict
    made["verdict"] = ("parameter", verdicts, described("1", "whether the data determine it"))
    return made


def _observations(found: Identified) -> dict[str, Any]:
    made = predictive_bands(found.known)
    names = [f"{b.evidence}: {b.group.name}" for b in made for _ in range(b.group.values.size)]
    columns = {
        "observed": ([b.group.values for b in made], "observed"),
        "u_observed": ([b.group.u for b in made], "its own standard uncertainty"),
        "predicted": ([b.predicted for b in made], "predicted by the identified material"),
        "u_predicted": ([b.u_predicted for b in made], "standard uncertainty of the prediction"),
        "residual": ([b.residual for b in made], "observed minus predicted over the deviation"),
    }
    table: dict[str, Any] = {
        name: ("observation", np.concatenate(parts), described("1", f"{text}, SI"))
        for name, (parts, text) in columns.items()
    }
    table["observation_name"] = ("observation", names, described("1", "experiment and quantity"))
    return table


def document(found: Identified) -> dict[str, Any]:
    """Return the main results as plain JSON types."""
    made, said = dataset(found), found.relaxed
    rows = []
    for i in range(made.sizes["parameter"]):
        name, unit, verdict = (str(made[n].values[i]) for n in ("parameter_name", "parameter_unit", "verdict"))
        ends = {end: float(made[end][i]) for end in ("low", "high")}
        finite = {end: value if np.isfinite(value) else None for end, value in ends.items()}
        rows.append({"name": name, "unit": unit, "value": float(made["value"][i]), **finite, "verdict": verdict})
    limits = {"end": said.end, "modulus_at_end": said.modulus, "fall_per_decade": said.fall}
    return {
        "material": found.material,
        "experiments": json.loads(made.attrs["experiments"]),
        "E_relaxed": rows[0] | limits,
        "unknowns": rows[1:],
        "structure": structure(found),
        "frequency_range": [float(made["lowest_frequency"]), float(made["highest_frequency"])],
        "is_settled": found.known.fit.is_converged,
        "discrepancies": json.loads(made.attrs["discrepancies"]),
        "remarks": list(found.remarks),
    }
