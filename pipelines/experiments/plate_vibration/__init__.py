"""Plate vibration: free vibration of the plate after impacts, measured by laser."""
