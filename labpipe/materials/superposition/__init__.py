"""Time-temperature superposition: shifts of all isotherms and one spectrum, fitted together."""

from labpipe.materials.superposition._first_shifts import overlapped_shifts
from labpipe.materials.superposition._master_curve import master_curve
from labpipe.materials.superposition._result import MasterCurve
from labpipe.materials.superposition._spectrum_modes import UncertainSpectrum, uncertain_spectra
from labpipe.materials.superposition._sweep_data import read_sweeps
from labpipe.materials.superposition._sweep_readings import (
    TableRun,
    gather_sweeps,
    isothermal_runs,
    modulus_factor,
    trusted_tables,
)

__all__ = [
    "MasterCurve",
    "TableRun",
    "UncertainSpectrum",
    "gather_sweeps",
    "isothermal_runs",
    "master_curve",
    "modulus_factor",
    "overlapped_shifts",
    "read_sweeps",
    "trusted_tables",
    "uncertain_spectra",
]
