"""The session's rheometer as prior of a material."""

import msgspec
import numpy as np
from numpy.typing import NDArray

from labpipe.errors import UsageError
from labpipe.identification import Evidence, Parameter, modulus_evidence
from labpipe.materials import Prony
from labpipe.workflow.session import Experiment, Session
from pipelines.experiments.shared.material_choice import resolve
from pipelines.experiments.shared.material_evidence import choice, nuisance
from pipelines.figures.inputs import Inputs, referred

Array = NDArray[np.float64]

_SPECIMEN = 0.05  # relative: what a rheometer's clamp and the specimen's size leave uncertain
_PER_DECADE = 2  # frequencies of the rheometer's moduli
_LEAST_NOISE = (0.01, 0.03)  # relative, of its storage and loss modulus


def dma_prior(
    inputs: Inputs, name: str, experiments: list[Experiment], rho: Array
) -> tuple[Evidence, Parameter]:
    """Return the moduli of a rheometer experiment, at the temperature of the others, as prior.

    Parameters
    ----------
    inputs : Inputs
    name : str
        Of the rheometer experiment, from :func:`rheometer`.
    experiments : list of Experiment
        On one material at one temperature.
    rho : array (term,) [s]
        Relaxation times of the spectrum.
    """
    solid, (low, high) = _master_curve(inputs, name, experiments)
    places = np.geomspace(low, high, max(int(np.log10(high / low) * _PER_DECADE), 2))
    modulus = solid.complex_modulus(2.0 * np.pi * places)
    u = [noise * part for noise, part in zip(_LEAST_NOISE, (modulus.real, modulus.imag),
                                             strict=True)]  # fmt: skip
    scale = nuisance(f"{name} specimen", 1.0, _SPECIMEN, "1", "size of the rheometer's specimen")
    evidence = modulus_evidence(
        name, places, (modulus.real, u[0]), (modulus.imag, u[1]), rho, factors=(scale.name,)
    )
    return evidence, scale


def dma_window(
    inputs: Inputs, name: str, experiments: list[Experiment]
) -> tuple[float, float]:  # fmt: skip
    """Return the shortest and the longest time of which a rheometer's moduli tell [s].

    The spectrum must reach as far: one that ends before could not explain them.
    """
    _, (low, high) = _master_curve(inputs, name, experiments)
    return 0.5 / np.pi / high, 0.5 / np.pi / low


def _master_curve(
    inputs: Inputs, name: str, experiments: list[Experiment]
) -> tuple[Prony, tuple[float, float]]:
    """Return the rheometer's material at the others' temperature, and its frequencies [Hz]."""
    fitted = inputs.result(name, "master_curve")
    chosen = choice(experiments[0])
    if not chosen.material_from:
        chosen = msgspec.structs.replace(
            chosen, material=None, material_file=None, material_from=name
        )
    solid = resolve(chosen, None, fitted)
    frequency = inputs.result(name, "sweeps")["frequency"].values
    shift = 10.0 ** fitted["log10_aT"].values
    own = float(solid.rho[0] / fitted["rho"].values[0]) if len(solid.rho) else 1.0
    return solid, (
        float(frequency.min() * shift.min() / own), float(frequency.max() * shift.max() / own)
    )  # fmt: skip


def rheometer(session: Session, wanted: str, experiments: list[Experiment]) -> str:
    """Return the name of the rheometer experiment that is the prior of a material.

    ``dma`` stands for the one that the material is taken from, else for the only one, else for
    the only one whose name begins with that of the material.

    Raises
    ------
    UsageError
        There is no such experiment, or it is not clear which one is meant.
    """
    sweeps = [n for n, e in session.experiments.items() if e.kind == "dma"]
    if wanted in sweeps:
        return wanted
    if wanted != "dma":
        known = ", ".join(sweeps) or "none"
        message = f'there is no rheometer experiment "{wanted}"; known are: {known}'
        raise UsageError(message)
    choices = [choice(e) for e in experiments]
    named = {referred(c.material_from) for c in choices if c.material_from}
    alike = [n for n in sweeps for c in choices[:1] if c.material and n.startswith(c.material)]
    for possible in (sorted(named), sweeps, alike):
        if len(possible) == 1:
            return possible[0]
    found = ", ".join(sweeps) or "none"
    message = (
        f"{experiments[0].name}: which rheometer experiment is the prior? Give --prior NAME; "
        f"there are: {found}"
    )
    raise UsageError(message)
