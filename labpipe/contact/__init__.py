"""Viscoelastic contact: indentation and impact."""
