"""Identification of a material from the experiments of a session, with its result and its page."""

from pipelines.identify._identify import Identified, Wish, identify_materials
from pipelines.identify._materials import material_name
from pipelines.identify._page import relaxed_text, render, statements
from pipelines.identify._result import dataset, document
from pipelines.identify._verb import Identification, identify

__all__ = [
    "Identification",
    "Identified",
    "Wish",
    "dataset",
    "document",
    "identify",
    "identify_materials",
    "material_name",
    "relaxed_text",
    "render",
    "statements",
]
