"""Dynamic mechanical analysis: sweeps of a rheometer to a master curve and its material."""
