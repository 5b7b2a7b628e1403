"""The physics, the mathematics, the data model, the workflow engine and the report kit.

Sub-packages, from the ground up: :mod:`labpipe.signals`, :mod:`labpipe.materials`,
:mod:`labpipe.contact`, :mod:`labpipe.imaging`; beside them :mod:`labpipe.workflow` and
:mod:`labpipe.report`, which know none of the physics. Nothing here knows an instrument, a
calibration or an experiment; those are the packages ``instruments``, ``calibration`` and
``pipelines``. Importing labpipe imports none of the numerical libraries.
"""

__version__ = "0.1.0"

# All four packages carry this mark; a foreign package of the same name does not (see `doctor`).
BUILD = f"labpipe {__version__}"
