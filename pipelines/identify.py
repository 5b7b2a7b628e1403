"""Identification of a material from the processed experiments of a session.

Results that are up to date (or are made first) become evidence (:mod:`labpipe.identification`):
bounces of the laser, largest contact radii of the film, forces of relaxations, dynamic stiffness
of harmonic indentations, and moduli of the rheometer as prior. Experiments on one material are
taken together; what they share (sphere, punch, load cell) is one unknown.
"""

import warnings
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from labpipe.errors import InputError, UsageError
from labpipe.identification import (
    Evidence,
    FractionalSpectrum,
    Parameter,
    Posterior,
    Problem,
    Profile,
    Sample,
    SmoothSpectrum,
    fit,
    infer,
    posterior,
    profile,
    relaxation_times,
    sample,
)
from labpipe.workflow.session import Experiment, Session
from pipelines import process
from pipelines.evidence import (
    KINDS,
    Proof,
    dma_prior,
    dma_window,
    material_name,
    references,
    rheometer,
)
from pipelines.figures.inputs import Inputs

Array = NDArray[np.float64]
Say = Callable[[str], None]


@dataclass(frozen=True, eq=False)
class Identified:
    """One identified material.

    Attributes
    ----------
    material : str
        As the session names it.
    known : Posterior
        Its fit is ``known.fit``.
    relaxed : Profile or None
        Profile of the long-time modulus; None when it was not asked for.
    prior : Posterior or None
        What the rheometer alone says, when it was taken as prior.
    remarks : tuple of str
        What was left out and why.
    drawn : Sample or None
        Draws of the posterior, when they were asked for.
    """

    material: str
    known: Posterior
    relaxed: Profile | None
    prior: Posterior | None
    remarks: tuple[str, ...]
    drawn: Sample | None = None


@dataclass(frozen=True, slots=True)
class Wish:
    """What to identify and how.

    Attributes
    ----------
    experiments : tuple of str
        Of the session; all that can tell of a material by default.
    prior : str, optional
        ``"dma"`` for the session's rheometer experiment, or the name of one.
    spectrum : {"smooth", "fractional"}
        Family of spectra.
    impacts : int
        Bounces of a drop that count; later ones are small and say little new.
    with_profile : bool
        Follow the long-time modulus to see whether it is determined.
    sampler : {"laplace", "rto"}
        Whether to draw from the posterior too, by randomise-then-optimise.
    """

    experiments: tuple[str, ...] = ()
    prior: str | None = None
    spectrum: str = "smooth"
    impacts: int = 6
    with_profile: bool = True
    sampler: str = "laplace"


@dataclass(slots=True)
class _Group:
    """Experiments on one material, the rheometer's that is its prior, and what they tell."""

    experiments: list[Experiment] = field(default_factory=list)
    prior: str | None = None
    proofs: list[Proof] = field(default_factory=list)


def identify(folder: str | Path, wish: Wish | None = None, *, say: Say | None = None,
             jobs: int = 1) -> list[Identified]:  # fmt: skip
    """Identify every material on which a session holds experiments.

    Parameters
    ----------
    folder : path-like
        The session folder; what is not processed yet is processed first.
    wish : Wish, optional
    say : callable, optional
        Called with a line of text now and then.
    jobs : int
        Experiments processed side by side; 0 processes in this process.

    Returns
    -------
    list of Identified
        One per material.

    Raises
    ------
    UsageError
        An experiment is unknown, or none of them can tell of a material.
    InputError
        A step before failed.

    Examples
    --------
    >>> (found,) = identify("my-session", Wish(("acrylic_1p5mm",)))  # doctest: +SKIP
    >>> found.relaxed.verdict  # doctest: +SKIP
    'only an upper limit'
    """
    wish, tell = wish or Wish(), say or _silent
    session = process.reopen_session(folder)
    groups: dict[str, _Group] = {}
    for name in _chosen(session, wish.experiments):
        experiment = session.experiments[name]
        group = groups.setdefault(material_name(experiment), _Group())
        group.experiments.append(experiment)
    if wish.prior is not None:
        for group in groups.values():
            group.prior = rheometer(session, wish.prior, group.experiments)
    inputs = _processed(folder, groups.values(), jobs)
    remarks: list[str] = []
    found = []
    for material, group in groups.items():
        own = _gather(inputs, group, wish.impacts)
        remarks += own
        if group.proofs:
            names = ", ".join(e.name for e in group.experiments)
            tell(f"{material}: {names}")
            found.append(_identified(inputs, material, group, wish, own, tell))
    if not found:
        message = "no experiment can tell of a material: " + "; ".join(remarks)
        raise InputError(message)
    return found


def _gather(inputs: Inputs, group: _Group, impacts: int) -> list[str]:
    """Take what the experiments tell; return why some cannot."""
    remarks, able = [], []
    for experiment in group.experiments:
        proof = KINDS[experiment.kind].gather(inputs, experiment, impacts)
        if isinstance(proof, str):
            remarks.append(f"{experiment.name}: {proof}")
            continue
        able.append(experiment)
        group.proofs.append(proof)
    group.experiments = able or group.experiments
    return remarks


def _chosen(session: Session, wanted: Sequence[str]) -> list[str]:
    able = [n for n, e in session.experiments.items() if e.kind in KINDS]
    if unknown := [n for n in wanted if n not in session.experiments]:
        message = f"there is no experiment {', '.join(unknown)}; known are {', '.join(able)}"
        raise UsageError(message)
    if unable := [n for n in wanted if n not in able]:
        kinds = ", ".join(KINDS)
        message = f"{', '.join(unable)} cannot tell of a material; the kinds that can are {kinds}"
        raise UsageError(message)
    if not able:
        message = f"the session holds no experiment of the kinds {', '.join(KINDS)}"
        raise UsageError(message)
    return [n for n in able if not wanted or n in wanted]


def _processed(folder: str | Path, groups: Iterable[_Group], jobs: int) -> Inputs:
    """Process what is not yet, and open the results."""
    targets, names = [], []
    for group in groups:
        for experiment in group.experiments:
            needed = [f"{experiment.name}/{s}" for s in KINDS[experiment.kind].stages]
            needed += references(experiment)
            targets += needed
            names += [task.split("/")[0] for task in needed]
        if group.prior is not None:
            targets.append(f"{group.prior}/master_curve")
            names.append(group.prior)
    run = process.process(folder, targets, names, jobs=jobs)
    for outcome in run.failures:
        message = f"{outcome.task}: {outcome.message}"
        raise InputError(message)
    plan = process.plan(folder)
    return Inputs(plan, {n: e.settings for n, e in plan.session.experiments.items()})


def _identified(
    inputs: Inputs, material: str, group: _Group, wish: Wish, remarks: list[str], say: Say
) -> Identified:
    windows = [p.window for p in group.proofs]
    if group.prior is not None:
        windows.append(dma_window(inputs, group.prior, group.experiments))
    data = min(w[0] for w in windows), max(w[1] for w in windows)
    nu = group.proofs[0].nu
    spectrum = (
        SmoothSpectrum(relaxation_times(*data), nu)
        if wish.spectrum == "smooth"
        else FractionalSpectrum.over(*data, nu)
    )

    def rebuilt(rho: Array) -> tuple[Evidence, ...]:
        made = [p.build(rho) for p in group.proofs]
        if group.prior is not None:
            made.append(dma_prior(inputs, group.prior, group.experiments, rho)[0])
        return tuple(made)

    nuisances: dict[str, Parameter] = {}
    for proof in group.proofs:
        nuisances |= {p.name: p for p in proof.unknowns}
    if group.prior is not None:
        _, unknown = dma_prior(inputs, group.prior, group.experiments, spectrum.rho)
        nuisances[unknown.name] = unknown
    problem = Problem(spectrum, rebuilt(spectrum.rho), tuple(nuisances.values()))
    known = infer(problem, rebuilt, progress=say)
    if not known.fit.is_settled:
        warnings.warn(f"{material}: the fit did not settle; take its intervals with care",
                      UserWarning, stacklevel=2)  # fmt: skip
    relaxed = None
    if wish.with_profile:
        say("profile of the long-time modulus")
        relaxed = profile(known, 0)
    before = None
    if group.prior is not None:
        before = posterior(fit(problem.only(prior=True)))
    drawn = None
    if wish.sampler == "rto":
        say("draws of the posterior")
        drawn = sample(known)
    return Identified(material, known, relaxed, before, tuple(remarks), drawn)


def _silent(text: str) -> None:
    del text
