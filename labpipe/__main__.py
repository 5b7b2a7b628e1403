"""``python -m labpipe`` is the command ``labpipe``."""

import importlib

# Named, not imported: labpipe stands below pipelines and knows nothing of it.
importlib.import_module("pipelines.cli").main()
