"""Identification: the Prony series of a material from its experiments, with uncertainty.

A :class:`Problem` is a family of spectra, experiments as :class:`Evidence`, and what they leave
unknown. :func:`fit` finds the most probable answer, :func:`posterior` what is known of it,
:func:`infer` both, over the structures that a spectrum may have, :func:`long_time_modulus`
whether the data show a plateau.
"""

from labpipe.identification._drops import Bounces, DropModel, drop_evidence
from labpipe.identification._evidence import Evidence, Group, LinearModel
from labpipe.identification._fit import Fit, fit
from labpipe.identification._joined import JoinedModel
from labpipe.identification._linear import force_evidence, lee_radok_basis, modulus_evidence, stiffness_evidence
from labpipe.identification._long_time import LongTimeModulus, long_time_modulus
from labpipe.identification._parameters import Parameter
from labpipe.identification._posterior import (
    DETERMINED,
    Band,
    Moduli,
    Posterior,
    Structure,
    informative_range,
    moduli,
    posterior,
    predictive_bands,
)
from labpipe.identification._problem import Misfit, Problem, split_by_group
from labpipe.identification._sampling import Sample, sample, sampled_moduli
from labpipe.identification._spectra import FractionalSpectrum, SmoothSpectrum, relaxation_times
from labpipe.identification._structure import STRUCTURE_PRIORS, infer

__all__ = [
    "DETERMINED",
    "STRUCTURE_PRIORS",
    "Band",
    "Bounces",
    "DropModel",
    "Evidence",
    "Fit",
    "FractionalSpectrum",
    "Group",
    "JoinedModel",
    "LinearModel",
    "LongTimeModulus",
    "Misfit",
    "Moduli",
    "Parameter",
    "Posterior",
    "Problem",
    "Sample",
    "SmoothSpectrum",
    "Structure",
    "drop_evidence",
    "fit",
    "force_evidence",
    "infer",
    "informative_range",
    "lee_radok_basis",
    "long_time_modulus",
    "moduli",
    "modulus_evidence",
    "posterior",
    "predictive_bands",
    "relaxation_times",
    "sample",
    "sampled_moduli",
    "split_by_group",
    "stiffness_evidence",
]
