"""Relaxation: a periodic punch is pressed into rubber and held."""
