"""Relaxation spectra from complex moduli: fit, consistency of storage and loss, and reduction."""

from labpipe.materials.spectrum._kramers_kronig import KramersKronig, kramers_kronig
from labpipe.materials.spectrum._reduction import fewest_terms
from labpipe.materials.spectrum._responses import frequencies_of, prony_of_creep, prony_of_relaxation
from labpipe.materials.spectrum._spectrum import (
    MARGIN_DECADES,
    MOST_TERMS_PER_DECADE,
    TERMS_PER_DECADE,
    Grid,
    Solution,
    compress,
    make_grid,
    maxwell_shapes,
    solve,
    solve_by_cross_validation,
    solve_nearby,
    solve_normal,
)

__all__ = [
    "MARGIN_DECADES",
    "MOST_TERMS_PER_DECADE",
    "TERMS_PER_DECADE",
    "Grid",
    "KramersKronig",
    "Solution",
    "compress",
    "fewest_terms",
    "frequencies_of",
    "kramers_kronig",
    "make_grid",
    "maxwell_shapes",
    "prony_of_creep",
    "prony_of_relaxation",
    "solve",
    "solve_by_cross_validation",
    "solve_nearby",
    "solve_normal",
]
