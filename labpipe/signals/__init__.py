"""Signals in time: derivative, events, oscillation, alignment, repeats, metrics."""

from labpipe.signals.derivative import velocity
from labpipe.signals.events import PHASES, bounces, phases

__all__ = ["PHASES", "bounces", "phases", "velocity"]
