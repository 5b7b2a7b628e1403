"""Signals in time: derivative, events, oscillation, alignment, repeats, metrics."""

from labpipe.signals.derivative import velocity
from labpipe.signals.events import PHASES, bounces, phases
from labpipe.signals.metrics import agreement, compare, nrmse
from labpipe.signals.repeats import combine_repeats

__all__ = [
    "PHASES",
    "agreement",
    "bounces",
    "combine_repeats",
    "compare",
    "nrmse",
    "phases",
    "velocity",
]
