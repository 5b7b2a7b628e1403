"""Plate vibration: the plate rings under drops, and the laser sees the plate."""
