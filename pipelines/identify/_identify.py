"""Identification of a material from the processed experiments of a session.

Results that are up to date (or are made first) become evidence (:mod:`labpipe.identification`):
bounces of the laser, largest contact radii of the film, forces of relaxations, dynamic stiffness
of harmonic indentations, and moduli of the rheometer as prior. Experiments on one material are
taken together; a shared sphere, punch or load cell is one unknown.
"""

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from labpipe import identification
from labpipe.arrays import Floats
from labpipe.errors import InputError, UsageError
from labpipe.workflow.results import Results
from labpipe.workflow.session import Experiment, Session
from pipelines.experiments import KINDS, Derived
from pipelines.experiments.shared.material_evidence import MaterialEvidence
from pipelines.identify._materials import known_before, material_name, of_temperature, prior_of, temperature_of
from pipelines.session import derive, processed_for, reopen_session

Say = Callable[[str], None]


@dataclass(frozen=True, eq=False)
class Identified:
    """One identified material.

    ``material`` is its name in the session, ``known`` the posterior (its fit is ``known.fit``), ``relaxed`` the
    limits of the long-time modulus. ``prior`` is the posterior of the rheometer alone, when it was taken as prior;
    ``remarks`` name omitted data and the reasons.
    """

    material: str
    known: identification.Posterior
    relaxed: identification.LongTimeModulus
    prior: identification.Posterior | None
    remarks: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Wish:
    """Choices of an identification, by the names that :func:`pipelines.identify.identify` explains."""

    experiments: tuple[str, ...] = ()
    prior: str | None = None
    impacts: int = 6


@dataclass(slots=True)
class _Group:
    """Experiments on one material, the rheometer's that is its prior, and their evidence."""

    experiments: list[Experiment] = field(default_factory=list)
    prior: Experiment | None = None
    contributions: list[MaterialEvidence] = field(default_factory=list)


def identify_materials(
    folder: str | Path, wish: Wish | None = None, *, say: Say | None = None, jobs: int = 1
) -> list[Identified]:
    """Identify every material on which a session holds experiments, and write nothing.

    The other arguments, and the errors, are those of :func:`pipelines.identify.identify`.

    Examples
    --------
    >>> (found,) = identify_materials("my-session", Wish(("acrylic_1p5mm",)))  # doctest: +SKIP
    >>> found.relaxed.verdict  # doctest: +SKIP
    'bounded from above'
    """
    wish, tell = wish or Wish(), say or _silent
    session = reopen_session(folder)
    groups: dict[str, _Group] = {}
    for name in _chosen(session, wish.experiments):
        experiment = session.experiments[name]
        group = groups.setdefault(material_name(experiment), _Group())
        group.experiments.append(experiment)
    if wish.prior is not None:
        for group in groups.values():
            group.prior = prior_of(session, wish.prior, group.experiments)
    n = sum(len(group.experiments) for group in groups.values())
    tell(f"{n} experiment{'s' * (n != 1)} to identify from; what is missing is processed first")
    wanted = [(experiment, _evidence(experiment)) for group in groups.values() for experiment in group.experiments]
    wanted += [(group.prior, known_before(group.prior)) for group in groups.values() if group.prior is not None]
    results = processed_for(folder, wanted, jobs=jobs)
    remarks: list[str] = []
    found = []
    for number, (material, group) in enumerate(groups.items(), 1):
        own = _gather(results, group, wish.impacts)
        remarks += own
        if group.contributions:
            names = ", ".join(e.name for e in group.experiments)
            tell(f"material {number} of {len(groups)}, {material}, from {names}")
            found.append(_identified(results, material, group, wish, own, tell))
    if not found:
        raise InputError("no experiment can identify a material: " + "; ".join(remarks))
    return found


def _gather(results: Results, group: _Group, impacts: int) -> list[str]:
    """Collect the data of the experiments; return why some have none."""
    remarks, able = [], []
    for experiment in group.experiments:
        contribution = derive(results, experiment, _evidence(experiment), name=experiment.name, impacts=impacts)
        if isinstance(contribution, str):
            remarks.append(f"{experiment.name}: {contribution}")
            continue
        able.append(experiment)
        group.contributions.append(contribution)
    group.experiments = able or group.experiments
    return remarks


def _evidence(experiment: Experiment) -> Derived:
    derived = KINDS[experiment.kind].evidence
    if derived is None:
        raise UsageError(f"{experiment.name} cannot identify a material")
    return derived


def _chosen(session: Session, wanted: Sequence[str]) -> list[str]:
    telling = [kind.name for kind in KINDS.values() if kind.evidence is not None]
    able = [n for n, e in session.experiments.items() if e.kind in telling]
    if unknown := [n for n in wanted if n not in session.experiments]:
        raise UsageError(f"there is no experiment {', '.join(unknown)}; known are {', '.join(able)}")
    if unable := [n for n in wanted if n not in able]:
        kinds = ", ".join(telling)
        raise UsageError(f"{', '.join(unable)} cannot identify a material; the kinds that can are {kinds}")
    if not able:
        raise UsageError(f"the session holds no experiment of the kinds {', '.join(telling)}")
    return [n for n in able if not wanted or n in wanted]


def _identified(results: Results, material: str, group: _Group, wish: Wish, remarks: list[str], say: Say) -> Identified:
    contributions, before = list(group.contributions), None
    if group.prior is not None:
        keywords = {"name": group.prior.name, "temperature": temperature_of(group.experiments[0])}
        contributions.append(derive(results, group.prior, known_before(group.prior), **keywords))
    data = (min(each.window[0] for each in contributions), max(each.window[1] for each in contributions))
    nu = contributions[0].nu
    spectrum = identification.SmoothSpectrum(identification.relaxation_times(*data), nu)

    def rebuilt(rho: Floats) -> tuple[identification.Evidence, ...]:
        return tuple(each.build(rho) for each in contributions)

    nuisances = {unknown.name: unknown for each in contributions for unknown in each.unknowns}
    problem = identification.Problem(spectrum, rebuilt(spectrum.rho), tuple(nuisances.values()))
    known = identification.infer(problem, rebuilt, progress=say)
    if not known.fit.is_converged:
        warnings.warn(f"{material}: the fit did not converge; use its intervals with care", UserWarning, stacklevel=2)
    if group.prior is not None:
        before = identification.posterior(identification.fit(problem.only(prior=True)))
    said = [*remarks, *filter(None, [of_temperature(group.experiments)])]
    return Identified(material, known, identification.long_time_modulus(known), before, tuple(said))


def _silent(text: str) -> None:
    del text
