"""Films: digital image correlation and the contact radius from interference fringes."""
