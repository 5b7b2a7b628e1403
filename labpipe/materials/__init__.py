"""Linear viscoelastic materials: Prony series, interconversion, master curves, library."""
