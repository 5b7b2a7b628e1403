"""Ball drop: a sphere bounces on sapphire; a laser measures the motion of its holder."""
