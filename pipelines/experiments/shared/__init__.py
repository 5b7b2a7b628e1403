"""Parts that several kinds of experiment share, one noun each: settings, readings, models, checks, and pages."""
