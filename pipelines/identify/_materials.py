"""The material of an experiment in a session, and its prior."""

from collections.abc import Sequence
from typing import Any, Literal

from labpipe.errors import LabpipeError, UsageError
from labpipe.materials import Prony
from labpipe.workflow.fields import REFERENCE
from labpipe.workflow.results import Results
from labpipe.workflow.session import Experiment, Session
from pipelines.experiments import KINDS, Derived
from pipelines.experiments.shared.material_choice import resolve


def choice(experiment: Experiment) -> Any:
    """Return the table that names the material."""
    return getattr(experiment.settings, KINDS[experiment.kind].body)


def material_name(experiment: Experiment) -> str:
    """Return how the session names the material; another temperature is another material."""
    chosen = choice(experiment)
    at = "" if chosen.temperature is None else f" at {chosen.temperature.value:g} °C"
    return str(chosen.source) + at


def of_temperature(experiments: Sequence[Experiment]) -> str:
    """Say at which temperature the moduli are, and that how well it is known does not widen them; "" if unstated."""
    stated = {choice(experiment).temperature for experiment in experiments} - {None}
    if not stated:
        return ""
    each = ", ".join(sorted(f"{t.value:g} ± {t.u:g} °C" if t.u else f"{t.value:g} °C" for t in stated))
    return (
        f"moduli are those at the temperature that the specimen had, stated as {each}: how well that is known is in no "
        "uncertainty here, and a rheometer's moduli at exactly this temperature may differ by what it changes"
    )


def stated_solid(results: Results, experiment: Experiment) -> tuple[str, Prony] | None:
    """Return the source of the moduli that an experiment names, and its material; None if its DMA is not processed."""
    chosen = choice(experiment)
    file = None if chosen.material_file is None else results.plan.session.files / chosen.material_file
    dma = (chosen.material_from or "").removeprefix(REFERENCE)
    fitted = results.first(dma, "master_curve") if dma else None
    if dma and fitted is None:
        return None
    try:
        return f"DMA, {dma}" if dma else f"stated: {chosen.source}", resolve(chosen, file, fitted)
    except LabpipeError:  # the temperature is out of reach of its shifts
        return None


def derived_of(experiment: Experiment, use: Literal["evidence", "prior"]) -> Derived:
    """Return the evidence or the prior that an experiment gives.

    Raises
    ------
    UsageError
        It gives none.
    """
    derived: Derived | None = getattr(KINDS[experiment.kind], use)
    if derived is None:
        raise UsageError(f"{experiment.name} cannot {'be a prior' if use == 'prior' else 'identify a material'}")
    return derived


def prior_of(session: Session, wanted: str, experiments: list[Experiment]) -> Experiment:
    """Return the rheometer experiment that is the prior of a material.

    The name of its kind stands for the one that the material is taken from, else for the only
    one, else for the only one whose name begins with that of the material.

    Raises
    ------
    UsageError
        There is no such experiment, or it is not clear which one is meant.
    """
    kinds = [kind.name for kind in KINDS.values() if kind.prior is not None]
    able = [n for n, e in session.experiments.items() if e.kind in kinds]
    if wanted in able:
        return session.experiments[wanted]
    if wanted not in kinds:
        known = ", ".join(able) or "none"
        raise UsageError(f'there is no rheometer experiment "{wanted}"; known are: {known}')
    able = [n for n in able if session.experiments[n].kind == wanted and not session.experiments[n].base]
    choices = [choice(e) for e in experiments]
    named = {c.material_from.removeprefix(REFERENCE) for c in choices if c.material_from}
    alike = [n for n in able for c in choices[:1] if c.material and n.startswith(c.material)]
    for possible in (sorted(named), able, alike):
        if len(possible) == 1:
            return session.experiments[possible[0]]
    raise UsageError(
        f"{experiments[0].name}: which rheometer experiment is the prior? Give --prior NAME; "
        f"there are: {', '.join(able) or 'none'}"
    )
