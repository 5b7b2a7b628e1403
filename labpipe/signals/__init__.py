"""Signals in time: derivative, events, oscillation, alignment, repeats, metrics."""

from labpipe.signals.derivative import velocity

__all__ = ["velocity"]
