"""Modules that several kinds of experiment share."""
