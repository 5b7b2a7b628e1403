"""How the results of each kind of experiment become evidence on its material."""

from collections.abc import Callable
from typing import NamedTuple

from labpipe.workflow.session import Experiment
from pipelines.experiments.dma.evidence import dma_prior, dma_window, rheometer
from pipelines.experiments.harmonic.evidence import harmonic
from pipelines.experiments.relaxation.evidence import relaxation
from pipelines.experiments.shared.drop_evidence import ball_drop, contact_area
from pipelines.experiments.shared.material_evidence import Proof, material_name, references
from pipelines.figures.inputs import Inputs

__all__ = [
    "KINDS",
    "Kind",
    "Proof",
    "dma_prior",
    "dma_window",
    "material_name",
    "references",
    "rheometer",
]


class Kind(NamedTuple):
    """What a kind of experiment needs and how it is gathered; a text says why it cannot be."""

    stages: tuple[str, ...]
    gather: Callable[[Inputs, Experiment, int], Proof | str]


KINDS = {
    "ball_drop": Kind(("bounces", "repeats"), ball_drop),
    "contact_area": Kind(("radius", "impacts"), contact_area),
    "relaxation": Kind(("loads", "ramps", "curves"), relaxation),
    "harmonic": Kind(("loads", "oscillations"), harmonic),
}
"""Kinds that tell of a material."""
