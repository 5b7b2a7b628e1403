"""Static loading: a sphere under growing loads, seen by the laser."""
