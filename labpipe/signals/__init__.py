"""Signals in time: derivative, events, oscillation, alignment, repeats, metrics."""

from labpipe.signals.cycles import Window, active_window, loops
from labpipe.signals.derivative import velocity
from labpipe.signals.events import PHASES, bounces, phases
from labpipe.signals.metrics import agreement, compare, nrmse
from labpipe.signals.oscillation import (
    CommonFit,
    Damped,
    Sinusoid,
    common_fit,
    damped_oscillation,
    fit_sinusoid,
)
from labpipe.signals.repeats import combine_repeats

__all__ = [
    "PHASES",
    "CommonFit",
    "Damped",
    "Sinusoid",
    "Window",
    "active_window",
    "agreement",
    "bounces",
    "combine_repeats",
    "common_fit",
    "compare",
    "damped_oscillation",
    "fit_sinusoid",
    "loops",
    "nrmse",
    "phases",
    "velocity",
]
