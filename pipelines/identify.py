"""Identification of a material from the processed experiments of a session.

Results that are up to date (or are made first) become evidence (:mod:`labpipe.identification`):
bounces of the laser, largest contact radii of the film, forces of relaxations, dynamic stiffness
of harmonic indentations, and moduli of the rheometer as prior. Experiments on one material are
taken together; what they share (sphere, punch, load cell) is one unknown.
"""

import warnings
from collections.abc import Callable, Sequence
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
    SmoothSpectrum,
    fit,
    posterior,
    profile,
    relaxation_times,
)
from labpipe.workflow.session import Session
from pipelines import process
from pipelines.identify_evidence import KINDS, Proof, dma_prior

Array = NDArray[np.float64]
Say = Callable[[str], None]

SPECTRA = ("smooth", "fractional")


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
    """

    material: str
    known: Posterior
    relaxed: Profile | None
    prior: Posterior | None
    remarks: tuple[str, ...]


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
    """

    experiments: tuple[str, ...] = ()
    prior: str | None = None
    spectrum: str = "smooth"
    impacts: int = 6
    with_profile: bool = True


@dataclass(slots=True)
class _Gathered:
    names: list[str] = field(default_factory=list)
    proofs: list[Proof] = field(default_factory=list)


def identify(folder: str | Path, wish: Wish | None = None, *, say: Say | None = None
             ) -> list[Identified]:  # fmt: skip
    """Identify every material on which a session holds experiments.

    Parameters
    ----------
    folder : path-like
        The session folder; what is not processed yet is processed first.
    wish : Wish, optional
    say : callable, optional
        Called with a line of text now and then.

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
    session = process.open_session(folder)
    chosen = _chosen(session, wish.experiments)
    _processed(folder, session, chosen)
    by_material: dict[str, _Gathered] = {}
    remarks = []
    for name in chosen:
        experiment = session.experiments[name]
        proof = KINDS[experiment.kind].gather(session, experiment, wish.impacts)
        if isinstance(proof, str):
            remarks.append(f"{name}: {proof}")
            continue
        group = by_material.setdefault(proof.material, _Gathered())
        group.names.append(name)
        group.proofs.append(proof)
    if not by_material:
        message = "no experiment can tell of a material: " + "; ".join(remarks)
        raise InputError(message)
    found = []
    for material, group in by_material.items():
        tell(f"{material}: {', '.join(group.names)}")
        found.append(_identified(session, material, group, wish, remarks, tell))
    return found


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


def _processed(folder: str | Path, session: Session, names: Sequence[str]) -> None:
    targets = [f"{n}/{s}" for n in names for s in KINDS[session.experiments[n].kind].stages]
    run = process.process(folder, targets, names)
    for outcome in run.failures:
        message = f"{outcome.task}: {outcome.message}"
        raise InputError(message)


def _identified(
    session: Session, material: str, group: _Gathered, wish: Wish, remarks: list[str], say: Say
) -> Identified:
    windows = [p.window for p in group.proofs]
    data = min(w[0] for w in windows), max(w[1] for w in windows)
    nu = group.proofs[0].nu
    spectrum = (
        SmoothSpectrum(relaxation_times(*data), nu, data)
        if wish.spectrum == "smooth"
        else FractionalSpectrum.over(*data, nu)
    )
    evidence: list[Evidence] = [p.build(spectrum.rho) for p in group.proofs]
    nuisances: dict[str, Parameter] = {}
    for proof in group.proofs:
        nuisances |= {p.name: p for p in proof.unknowns}
    if wish.prior is not None:
        experiments = [session.experiments[n] for n in group.names]
        sweep, unknown = dma_prior(session, wish.prior, experiments, spectrum.rho)
        evidence.append(sweep)
        nuisances[unknown.name] = unknown
    problem = Problem(spectrum, tuple(evidence), tuple(nuisances.values()))
    found = fit(problem, progress=say)
    if not found.is_settled:
        warnings.warn(f"{material}: the fit did not settle; take its intervals with care",
                      UserWarning, stacklevel=2)  # fmt: skip
    known = posterior(found)
    relaxed = None
    if wish.with_profile:
        say("profile of the long-time modulus")
        relaxed = profile(known, 0)
    before = None
    if wish.prior is not None:
        before = posterior(fit(problem.only(prior=True)))
    return Identified(material, known, relaxed, before, tuple(remarks))


def _silent(text: str) -> None:
    del text
