"""Harmonic indentation: a periodic punch oscillates in rubber."""
