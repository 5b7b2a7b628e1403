"""The guide as a site: the texts that come with labpipe, and references made from the code.

``python -m pipelines.guide SITE`` builds it; it needs the extra ``guide`` (Sphinx and its parts).
"""

from pipelines.guide._site import build

__all__ = ["build"]
