"""The guide: the texts that come with labpipe, and references made from the code.

:func:`pages` are plain pages from the installed package. ``python -m pipelines.guide SITE`` builds the site; it needs
the extra ``guide`` (Sphinx and its parts).
"""

from pipelines.guide.pages import FIRST as FIRST, PICTURES as PICTURES, pages as pages, standalone as standalone
