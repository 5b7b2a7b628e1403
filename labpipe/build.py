"""Which build this is."""

__version__ = "0.1.0"

# All four packages carry this mark; a foreign package of the same name does not (see `doctor`).
BUILD = f"labpipe {__version__}"
