"""Signals in time: derivative, events, oscillation, alignment, repeats, metrics."""

from labpipe.signals.align import Lag, at_times, from_event, lag
from labpipe.signals.cycles import Window, active_window, loops
from labpipe.signals.derivative import velocity
from labpipe.signals.events import PHASES, bounces, phases
from labpipe.signals.metrics import (
    Agreement,
    agreement,
    compare,
    determination,
    independent_count,
    nrmse,
)
from labpipe.signals.oscillation import (
    CommonFit,
    Sinusoid,
    common_fit,
    fit_sinusoid,
)
from labpipe.signals.repeats import combine_repeats
from labpipe.signals.ringing import Ringing, ringing
from labpipe.signals.vibration import Damped, damped_oscillation

__all__ = [
    "PHASES",
    "Agreement",
    "CommonFit",
    "Damped",
    "Lag",
    "Ringing",
    "Sinusoid",
    "Window",
    "active_window",
    "agreement",
    "at_times",
    "bounces",
    "combine_repeats",
    "common_fit",
    "compare",
    "damped_oscillation",
    "determination",
    "fit_sinusoid",
    "from_event",
    "independent_count",
    "lag",
    "loops",
    "nrmse",
    "phases",
    "ringing",
    "velocity",
]
