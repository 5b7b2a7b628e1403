"""Identification of a material from the processed experiments of a session.

Results that are up to date (or are made first) become evidence (:mod:`labpipe.identification`):
bounces of the laser, largest contact radii of the film, forces of relaxations, dynamic stiffness
of harmonic indentations, and moduli of the rheometer as prior. Experiments on one material are
taken together; a shared sphere, punch or load cell is one unknown.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from labpipe import files, identification
from labpipe.arrays import Floats
from labpipe.errors import InputError, UsageError
from labpipe.notebook import html_table
from labpipe.workflow.results import Results
from labpipe.workflow.session import Experiment, Session
from pipelines.experiments import KINDS
from pipelines.experiments.shared.material_evidence import MaterialEvidence
from pipelines.identify._materials import choice, derived_of, material_name, of_temperature, prior_of, stated_solid
from pipelines.identify._page import relaxed_text, render, statements
from pipelines.identify._result import Identified, dataset, document
from pipelines.session import derive, opened, processed_for, reopen_session


@dataclass(slots=True)
class _Group:
    """Experiments on one material, the rheometer's that is its prior, and their evidence."""

    experiments: list[Experiment] = field(default_factory=list)
    prior: Experiment | None = None
    contributions: list[MaterialEvidence] = field(default_factory=list)


def identify_materials(
    folder: str | Path,
    experiments: Sequence[str] = (),
    *,
    prior: str | None = None,
    impacts: int = 6,
    jobs: int = 1,
    say: Callable[[str], None] | None = None,
) -> list[Identified]:
    """Identify every material on which a session holds experiments, and write nothing.

    The arguments, and the errors, are those of :func:`pipelines.identify.identify`.

    Examples
    --------
    >>> (found,) = identify_materials("my-session", ["acrylic_1p5mm"])  # doctest: +SKIP
    >>> found.relaxed.verdict  # doctest: +SKIP
    'bounded from above'
    """
    tell = say or (lambda text: None)
    session = reopen_session(folder)
    groups: dict[str, _Group] = {}
    for name in _chosen(session, experiments):
        experiment = session.experiments[name]
        group = groups.setdefault(material_name(experiment), _Group())
        group.experiments.append(experiment)
    if prior is not None:
        for group in groups.values():
            group.prior = prior_of(session, prior, group.experiments)
    n = sum(len(group.experiments) for group in groups.values())
    tell(f"{n} experiment{'s' * (n != 1)} to identify from; what is missing is processed first")
    wanted = [(one, derived_of(one, "evidence")) for group in groups.values() for one in group.experiments]
    wanted += [(group.prior, derived_of(group.prior, "prior")) for group in groups.values() if group.prior is not None]
    results = processed_for(folder, wanted, jobs=jobs)
    remarks: list[str] = []
    found = []
    for number, (material, group) in enumerate(groups.items(), 1):
        own, able = [], []
        for experiment in group.experiments:
            evidence = derived_of(experiment, "evidence")
            given = derive(results, experiment, evidence, name=experiment.name, impacts=impacts)
            if isinstance(given, str):
                own.append(f"{experiment.name}: {given}")
            else:
                able.append(experiment)
                group.contributions.append(given)
        remarks += own
        if able:
            group.experiments = able
            tell(f"material {number} of {len(groups)}, {material}, from {', '.join(e.name for e in able)}")
            found.append(_identified(results, material, group, own, tell))
    if not found:
        raise InputError("no experiment can identify a material: " + "; ".join(remarks))
    return found


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
    return [n for n in able if n in (wanted or session.without_variants().experiments)]


def _identified(
    results: Results, material: str, group: _Group, remarks: list[str], say: Callable[[str], None]
) -> Identified:
    contributions, before = list(group.contributions), None
    if group.prior is not None:
        stated = choice(group.experiments[0]).temperature
        keywords = {"name": group.prior.name, "temperature": None if stated is None else float(stated.value)}
        contributions.append(derive(results, group.prior, derived_of(group.prior, "prior"), **keywords))
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
        alone = replace(problem, evidence=tuple(e for e in problem.evidence if e.is_prior))
        before = identification.posterior(identification.fit(alone))
    said = [*remarks, *filter(None, [of_temperature(group.experiments)])]
    stated = stated_solid(opened(results.plan.session.root), group.experiments[0])
    return Identified(material, known, identification.long_time_modulus(known), before, tuple(said), stated)


@dataclass(frozen=True, eq=False)
class Identification:
    """The identified materials of a session, with the page and the netCDF file of each."""

    materials: tuple[Identified, ...]
    pages: tuple[Path, ...]
    paths: tuple[Path, ...]

    def __iter__(self) -> Iterator[Identified]:
        return iter(self.materials)

    def lines(self) -> list[str]:
        """Say the main results as lines of text."""
        return [
            line
            for found, page in zip(self.materials, self.pages, strict=True)
            for line in (
                f"{found.material}: {relaxed_text(found)}",
                *(f"  {statement}" for statement in statements(found)),
                f"page: {page}",
            )
        ]

    def __repr__(self) -> str:
        return "\n".join(self.lines())

    def _repr_html_(self) -> str:
        rows = [(m.material, relaxed_text(m), " ".join(statements(m))) for m in self.materials]
        caption = f"pages: {', '.join(map(str, self.pages))}"
        return html_table(caption, ("material", "long-time modulus", "what the data say"), rows)

    def documents(self) -> list[dict[str, Any]]:
        """Return plain values of every material, for JSON."""
        return [
            document(found) | {"page": str(page), "result": str(path)}
            for found, page, path in zip(self.materials, self.pages, self.paths, strict=True)
        ]


def identify(
    folder: str | Path,
    experiments: Iterable[str] = (),
    *,
    prior: str | None = None,
    impacts: int = 6,
    jobs: int = 1,
    say: Callable[[str], None] | None = None,
) -> Identification:
    """Identify the viscoelastic materials of a session's experiments, with credible intervals.

    Drops, contact films, relaxations and harmonic indentations of one material are fitted
    together. One page and one netCDF file per material: ``FOLDER/labpipe/identify_MATERIAL``.

    Parameters
    ----------
    folder : path-like
        The session folder; missing results are computed first.
    experiments : str or iterable of str
        Only these; by default all that can identify a material.
    prior : str, optional
        ``"dma"`` for the moduli of the session's rheometer experiment, or the name of one.
    impacts : int
        Bounces of a drop that are evaluated.
    jobs : int
        Experiments processed side by side; 0 processes in this process.
    say : callable, optional
        Called with a line of text now and then.

    Returns
    -------
    Identification

    Raises
    ------
    UsageError
        An experiment is unknown, or none of them can identify a material.
    InputError
        A step before failed.

    Examples
    --------
    >>> identify("my-session", ["acrylic_5mm", "acrylic_10mm"])  # doctest: +SKIP
    """
    names = (experiments,) if isinstance(experiments, str) else tuple(experiments)
    found = identify_materials(folder, names, prior=prior, impacts=impacts, jobs=jobs, say=say)
    session = reopen_session(folder)
    pages, paths = [], []
    for one in found:
        stem = "identify_" + "".join(c if c.isalnum() or c in "-_" else "_" for c in one.material.replace("°", "deg"))
        paths.append(session.folder / f"{stem}.nc")
        pages.append(session.folder / f"{stem}.html")
        files.write_dataset(paths[-1], dataset(one))
        files.write_text(pages[-1], render(session, one))
    return Identification(tuple(found), tuple(pages), tuple(paths))
