"""The guide: the texts that come with labpipe, and references made from the code.

:func:`pages` are plain pages from the installed package. ``python -m pipelines.guide SITE`` builds
the site, with a tutorial that is run and pictures; it needs the extra ``guide`` (Sphinx and its
parts).
"""

from pipelines.guide._offline import FIRST as FIRST, pages as pages
from pipelines.guide._site import build as build
from pipelines.guide._texts import PICTURES as PICTURES
