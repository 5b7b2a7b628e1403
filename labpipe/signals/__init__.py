"""Signals in time: derivative, events, oscillation, alignment, repeats, metrics."""
