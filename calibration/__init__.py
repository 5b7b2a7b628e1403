"""Readings to SI quantities with uncertainty."""
