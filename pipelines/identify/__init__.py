"""Identification of a material from the experiments of a session, with its result and its page."""

from pipelines.identify._identify import (
    Identification as Identification,
    identify as identify,
    identify_materials as identify_materials,
)
from pipelines.identify._materials import material_name as material_name
from pipelines.identify._result import Identified as Identified
