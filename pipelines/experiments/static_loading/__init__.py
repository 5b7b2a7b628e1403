"""Static loading: a sphere under increasing loads, measured by laser."""
