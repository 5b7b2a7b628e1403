"""Sphinx's configuration of the guide's site; ``python -m pipelines.guide SITE`` uses it."""

from labpipe.installation import __version__ as version

project = "labpipe"
copyright = "the labpipe developers, MIT licence"  # noqa: A001 - Sphinx asks for this name
release = version
extensions = ["myst_parser", "numpydoc", "sphinx.ext.autodoc", "sphinx-mathjax-offline"]
html_title = "labpipe"
html_theme = "furo"
html_copy_source = False
myst_heading_anchors = 3
numpydoc_show_class_members = False
autodoc_typehints = "none"
