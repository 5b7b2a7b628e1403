"""Identification: the Prony series of a material from its experiments, with uncertainty.

A :class:`Problem` is a family of spectra, experiments as :class:`Evidence`, and their
nuisance parameters. :func:`fit` finds the most probable answer, :func:`posterior` its uncertainty,
:func:`infer` both, over the structures that a spectrum may have, :func:`long_time_modulus`
whether the data show a plateau.
"""

from labpipe.identification._drops import Bounces as Bounces, DropModel as DropModel, drop_evidence as drop_evidence
from labpipe.identification._evidence import Evidence as Evidence, Group as Group, LinearModel as LinearModel
from labpipe.identification._fit import Fit as Fit, fit as fit
from labpipe.identification._linear import (
    force_evidence as force_evidence,
    lee_radok_basis as lee_radok_basis,
    modulus_evidence as modulus_evidence,
    stiffness_evidence as stiffness_evidence,
)
from labpipe.identification._long_time import LongTimeModulus as LongTimeModulus, long_time_modulus as long_time_modulus
from labpipe.identification._model_averaging import infer as infer
from labpipe.identification._parameters import Parameter as Parameter
from labpipe.identification._posterior import (
    DETERMINED as DETERMINED,
    Band as Band,
    Posterior as Posterior,
    Structure as Structure,
    informative_range as informative_range,
    moduli as moduli,
    posterior as posterior,
    predictive_bands as predictive_bands,
)
from labpipe.identification._problem import Misfit as Misfit, Problem as Problem
from labpipe.identification._spectra import SmoothSpectrum as SmoothSpectrum, relaxation_times as relaxation_times
