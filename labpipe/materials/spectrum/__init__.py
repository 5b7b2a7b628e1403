"""Relaxation spectra from complex moduli: fit, and consistency of storage and loss."""

from labpipe.materials.spectrum._kramers_kronig import (
    LEAST_POINTS as LEAST_POINTS,
    PASS_RATIO as PASS_RATIO,
    WARN_RATIO as WARN_RATIO,
    KramersKronig as KramersKronig,
    kramers_kronig as kramers_kronig,
)
from labpipe.materials.spectrum._spectrum import (
    MARGIN_DECADES as MARGIN_DECADES,
    NNLS_STEPS_PER_COLUMN as NNLS_STEPS_PER_COLUMN,
    TERMS_PER_DECADE as TERMS_PER_DECADE,
    Grid as Grid,
    Solution as Solution,
    compress as compress,
    make_grid as make_grid,
    maxwell_shapes as maxwell_shapes,
    moduli_of_terms as moduli_of_terms,
    second_differences as second_differences,
    solve as solve,
    solve_by_cross_validation as solve_by_cross_validation,
    solve_nearby as solve_nearby,
    solve_normal as solve_normal,
)
