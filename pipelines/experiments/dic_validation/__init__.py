"""Camera against laser: a film of the holder, and the laser of other drops."""
