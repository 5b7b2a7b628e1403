"""A laboratory's own kind of experiment: a bar on a spring rings, a vibrometer sees it."""
