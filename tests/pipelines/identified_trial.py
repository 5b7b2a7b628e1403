"""One random session of the virtual rig, processed, identified, and compared with its truth."""

import time as clock
import warnings
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from msgspec.structs import replace

from labpipe.arrays import Floats
from labpipe.errors import InputError, LabpipeError
from labpipe.identification import Evidence, Parameter, Posterior, informative_range, moduli, split_by_group
from labpipe.materials import Prony
from labpipe.uncertainty import propagated_u
from labpipe.workflow.results import Results
from pipelines.experiments import KINDS
from pipelines.experiments.shared.punch_model import Geometry, elastic_force
from pipelines.identify import Identified, identify_materials
from pipelines.rig.indentations import Specimen
from pipelines.rig.solids import Element, Viscoelastic
from pipelines.session import derive, opened
from tests.labpipe.identification.random_rubbers import is_symmetric
from tests.pipelines.random_sessions import DEPTH, Truth, recorded, write

_PULSE = "pulse shape"  # no number of the rig: a real pulse is none of the fitted shapes
_REACH = 1.96  # standard deviations to a limit of 95 %
_IMPACTS = 6  # bounces of a drop that are evaluated

PLACES = (0.1, 0.5, 0.9)
"""Of the frequencies of which the data tell, in the logarithm: where moduli are compared."""


class Score(msgspec.Struct, frozen=True):
    """One quantity: error over stated deviation, that deviation, its bound, the prior's.

    Moduli are in natural logarithms, unknowns in deviations of their prior. ``truth`` is the
    truth's own distance from the prior's mean, in the prior's deviations, where there is one.
    """

    error: float
    u: float
    bound: float
    prior: float
    truth: float | None = None


class Relaxed(msgspec.Struct, frozen=True):
    """What was said of the long-time modulus: verdict, and whether its limits hold the truth.

    ``u`` is the standard deviation of its logarithm that the limits stand for, where it is
    identified.
    """

    verdict: str
    is_held: bool
    u: float | None = None


class Trial(msgspec.Struct, frozen=True):
    """One session.

    Attributes
    ----------
    kind, seed : str, int
    group : str
        What the dispersions of the truth are: "symmetric" or "skewed".
    is_on_plate : bool
    seconds : float, optional
        To process and identify what is not processed yet.
    moduli : dict
        By quantity and place; None where the data do not determine it.
    unknowns : dict
        All nuisances, by their role.
    evidence : dict
        By experiment and group: observed minus the true material's own prediction with the true
        nuisances, in stated uncertainties.
    relaxed : Relaxed, optional
    misfits : dict
        Discrepancies that the fit allowed for, relative.
    is_settled : bool
    failure : str, optional
        Why there is no answer; everything else is empty then.
    """

    kind: str
    seed: int
    group: str
    is_on_plate: bool
    seconds: float | None = None
    moduli: dict[str, Score | None] = {}
    unknowns: dict[str, Score] = {}
    evidence: dict[str, list[float]] = {}
    relaxed: Relaxed | None = None
    misfits: dict[str, float] = {}
    is_settled: bool = False
    failure: str | None = None


def session_trial(truth: Truth, folder: Path) -> Trial:
    """Write a session where there is none, identify its material, and compare with the truth.

    Parameters
    ----------
    truth : Truth
        From :func:`tests.pipelines.random_sessions.drawn`.
    folder : Path
        Of the session.
    """
    write(truth, folder)
    group = "symmetric" if is_symmetric(truth.seed) else "skewed"
    blank = Trial(truth.kind, truth.seed, group, truth.is_on_plate)
    started = clock.perf_counter()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # what a reader of one session must know
        try:
            (found,) = identify_materials(folder, impacts=_IMPACTS)
        except LabpipeError as error:
            return replace(blank, failure=f"{type(error).__name__}: {error}")
        seconds = clock.perf_counter() - started
        return replace(blank, seconds=seconds, **_compared(truth, folder, found))


def _compared(truth: Truth, folder: Path, found: Identified) -> dict[str, Any]:
    results = opened(folder)
    known = found.known
    problem = known.fit.problem
    names = [e.name for e in problem.evidence]
    exact = {p.name: true_value(p.name, truth, results, names) for p in problem.nuisances}
    return {
        "moduli": _moduli(known, truth.solid),
        "unknowns": _unknowns(known, exact),
        "evidence": _at_the_truth(results, names, dense_series(truth.solid), exact, _IMPACTS),
        "relaxed": _relaxed(found, truth.solid.relaxed),
        "misfits": {f"{e}: {g}": m.relative for (e, g), m in known.fit.misfits.items()},
        "is_settled": known.fit.is_converged,
    }


def _moduli(known: Posterior, solid: Viscoelastic) -> dict[str, Score | None]:
    """Compare moduli at set places of the data's own frequencies."""
    low, high = informative_range(known)
    curve = moduli(known, low * (high / low) ** np.array(PLACES))
    exact = solid.modulus(curve.frequency)
    # without what is stated for structure that no data resolve: the bound of van Trees
    bound = propagated_u(curve.derivatives, known.covariance)
    made: dict[str, Score | None] = {}
    for part, (text, value, u, prior, true) in enumerate(
        (
            ("storage modulus", curve.storage, curve.u_ln_storage, curve.prior_ln_storage, exact.real),
            (
                "loss factor",
                curve.loss_factor,
                curve.u_ln_loss_factor,
                curve.prior_ln_loss_factor,
                exact.imag / exact.real,
            ),
        )
    ):
        error = np.log(value / true) / u
        for i, place in enumerate(PLACES):
            score = Score(float(error[i]), float(u[i]), float(bound[part * len(PLACES) + i]), float(prior[i]))
            made[f"{text} at {place:.0%}"] = score if curve.is_determined[i] else None
    return made


def _relaxed(found: Identified, true: float) -> Relaxed:
    """Compare the limits of the long-time modulus."""
    said = found.relaxed
    u = None
    if said.verdict == "identified":
        u = float(np.log(said.high / said.low) / 2.0 / _REACH)
    return Relaxed(said.verdict, bool(said.low <= true <= said.high), u)


def _unknowns(known: Posterior, exact: dict[str, float]) -> dict[str, Score]:
    """Compare the nuisances, in deviations of their priors."""
    problem = known.fit.problem
    made = {}
    for i, parameter in enumerate(problem.nuisances, problem.n_material):
        if parameter.name == _PULSE:
            continue
        true = parameter.coordinate(exact[parameter.name])
        sd = float(known.sd[i])
        made[role_of(parameter)] = Score((float(known.fit.xi[i]) - true) / sd, sd, sd, 1.0, true)
    return made


def dense_series(solid: Viscoelastic) -> Prony:
    """Return a series with twelve terms per decade, far beyond all records, of a fractional solid's own spectrum.

    S. Havriliak & S. Negami, Polymer 8 (1967) 161, doi:10.1016/0032-3861(67)90021-3.
    """
    rho = np.logspace(-40.0, 40.0, 961)
    weights = np.sum([_weights(each, rho) for each in solid.elements], axis=0)
    return Prony(solid.relaxed, weights, rho, nu=solid.nu)


def _weights(element: Element, rho: Floats) -> Floats:
    a, b = element.width, element.skew
    x = (rho / element.time) ** a
    angle = np.arctan2(np.sin(np.pi * a), x + np.cos(np.pi * a))
    shape = x**b * np.sin(b * angle) / (x**2 + 2.0 * x * np.cos(np.pi * a) + 1.0) ** (b / 2.0) / np.pi
    return np.asarray(element.strength * shape * np.gradient(np.log(rho)))


def role_of(parameter: Parameter) -> str:
    """Return the name of a nuisance without the values that a session states."""
    for role in ("mass of the plate", "mass", "radius"):
        if parameter.name.startswith(role):
            return role
    return parameter.name


def true_value(name: str, truth: Truth, results: Results, experiments: list[str]) -> float:
    """Return the true value of a nuisance, in its unit.

    Parameters
    ----------
    name : str
        Of the unknown.
    truth : Truth
    results : Results
        Results of the session: what was taken for zero is known from them.
    experiments : list of str
        That were taken as evidence.

    Raises
    ------
    InputError
        Nothing is known of such an unknown.
    """
    owner = next((e for e in experiments if name.startswith(f"{e} ")), "")
    role = name.removeprefix(f"{owner} ") if owner else name
    found = _of_drop(role, truth, results) if truth.kind == "drop" else _of_indentation(role, owner, truth, results)
    if found is None:
        message = f"the truth of the unknown {name} is not known; teach it to this comparison"
        raise InputError(message)
    return found


def _of_drop(role: str, truth: Truth, results: Results) -> float | None:
    rig = truth.rig
    if role == _PULSE:
        return 0.0
    if role == "mass of the plate":
        return float(rig.floor.mass)
    if role.startswith("mass "):
        return rig.mass
    if role.startswith("radius "):
        return rig.radius
    if role == "height":
        return float(np.mean([one["height"] for one in recorded(results.folder)]))
    if role == "trigger":
        drops = recorded(results.folder)
        settings: Any = results.experiments["drop"].settings
        late = [
            float(results.result("drop", "bounces", file)["touch_time"][0]) - one["touch_time"][0]
            for file, one in zip(settings.laser, drops, strict=True)
        ]
        return float(np.mean(late))
    return None


def _of_indentation(role: str, owner: str, truth: Truth, results: Results) -> float | None:
    if role == "load cell":
        return truth.tester.force_gain
    if role == "punch":
        return _effect_of_the_punch(truth, results)
    if role == "filter":
        # a delay stated too long turns loss up, which is a negative coordinate of the phase
        return -truth.delay_error
    if owner not in results.experiments:
        return None
    settings: Any = results.experiments[owner].settings
    if owner == "relaxation":
        (file,) = settings.mach1
        ramps, loads = (results.result(owner, s, file) for s in ("ramps", "loads"))
        if role == "first touch":
            # what the stage's own steps hide of the depth is a part of it
            return float(ramps["depth"][0]) - DEPTH
        if role == "tare":
            level = float(loads["tare"]) * float(loads.attrs["compression_sign"])
            return truth.tester.force_offset - level
    if owner == "harmonic" and role == "first touch":
        from pipelines.experiments.shared import mach1_readings

        touch, _ = mach1_readings.contact_position(results.result(owner, "loads"), settings.contact)
        return truth.specimen.surface - touch.value
    return None


def _effect_of_the_punch(truth: Truth, results: Results) -> float:
    """Return the elastic force of the true punch over that of the stated one."""
    settings: Any = next(iter(results.experiments.values())).settings
    stated = Geometry.of(settings.punch, settings.substrate, settings.model, truth.solid.nu)
    own: Specimen = truth.specimen
    true = {"radius": own.tip_radius, "period": own.period, "depth": own.depth}
    at = np.array([DEPTH])
    return float(elastic_force(at, stated, **true)[0] / elastic_force(at, stated)[0])


def _at_the_truth(
    results: Results, names: list[str], solid: Prony, exact: dict[str, float], impacts: int
) -> dict[str, list[float]]:
    """Return what every observed number differs by from the true material's, over its u."""
    made = {}
    for name in names:
        experiment = results.experiments[name]
        derived = KINDS[experiment.kind].evidence
        if derived is None:
            raise InputError(f"{name} cannot identify a material")
        told = derive(results, experiment, derived, name=name, impacts=impacts)
        if isinstance(told, str):
            raise InputError(f"{name}: {told}")
        evidence: Evidence = told.build(solid.rho)
        numbers = evidence.model.refined(solid, exact)
        if numbers is None:
            numbers = evidence.model.predict(solid, exact)
        for group, part in zip(evidence.groups, split_by_group(evidence, numbers), strict=True):
            made[f"{name}: {group.name}"] = ((group.values - part) / group.u).tolist()
    return made
