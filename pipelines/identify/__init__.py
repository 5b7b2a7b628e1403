"""Identification of a material from the experiments of a session, with its result and its page."""

from pipelines.identify._identify import Identified, Wish, identify
from pipelines.identify._materials import material_name
from pipelines.identify._page import relaxed_text, render, statements
from pipelines.identify._result import dataset, document

__all__ = [
    "Identified",
    "Wish",
    "dataset",
    "document",
    "identify",
    "material_name",
    "relaxed_text",
    "render",
    "statements",
]
