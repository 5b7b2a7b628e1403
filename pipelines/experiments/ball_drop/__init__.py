"""Ball drop: a sphere falls on sapphire again and again; a laser sees the holder."""
