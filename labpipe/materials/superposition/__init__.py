"""Time-temperature superposition: shifts of all isotherms and one spectrum, fitted together."""

from labpipe.materials.superposition._master_curve import master_curve as master_curve
from labpipe.materials.superposition._result import MasterCurve as MasterCurve
from labpipe.materials.superposition._sweeps import (
    gather_sweeps as gather_sweeps,
    isothermal_runs as isothermal_runs,
    loading_of as loading_of,
    modulus_factor as modulus_factor,
    trusted_rows as trusted_rows,
)
from labpipe.materials.superposition._uncertain_spectra import uncertain_spectra as uncertain_spectra
