"""From measurement to material: which Prony series explains the experiments, and how surely.

A :class:`Problem` is a family of spectra, experiments as :class:`Evidence`, and what they leave
unknown. :func:`fit` finds the most probable answer, :func:`posterior` what is known of it,
:func:`infer` both, over the structures that a spectrum may have, :func:`profile` whether an
unknown is determined at all.
"""

from labpipe.identification.drops import Bounces, DropModel, drop_evidence
from labpipe.identification.evidence import Evidence, Group, LinearModel
from labpipe.identification.fit import Fit, fit
from labpipe.identification.linear import (
    force_evidence,
    lee_radok_basis,
    modulus_evidence,
    stiffness_evidence,
)
from labpipe.identification.parameters import Parameter
from labpipe.identification.posterior import (
    Moduli,
    Posterior,
    Structure,
    bands,
    moduli,
    posterior,
)
from labpipe.identification.problem import Misfit, Problem
from labpipe.identification.profiles import Profile, profile
from labpipe.identification.sampling import Sample, drawn_moduli, sample
from labpipe.identification.spectra import (
    FractionalSpectrum,
    RoughSpectrum,
    SmoothSpectrum,
    relaxation_times,
)
from labpipe.identification.structure import infer

__all__ = [
    "Bounces",
    "DropModel",
    "Evidence",
    "Fit",
    "FractionalSpectrum",
    "Group",
    "LinearModel",
    "Misfit",
    "Moduli",
    "Parameter",
    "Posterior",
    "Problem",
    "Profile",
    "RoughSpectrum",
    "Sample",
    "SmoothSpectrum",
    "Structure",
    "bands",
    "drawn_moduli",
    "drop_evidence",
    "fit",
    "force_evidence",
    "infer",
    "lee_radok_basis",
    "moduli",
    "modulus_evidence",
    "posterior",
    "profile",
    "relaxation_times",
    "sample",
    "stiffness_evidence",
]
