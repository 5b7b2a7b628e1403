"""The material library: five materials, each number with its source."""

from labpipe.materials.library._library import Material, describe, load, load_file, read_material
from labpipe.materials.library._thermal import Thermal, thermal

__all__ = ["Material", "Thermal", "describe", "load", "load_file", "read_material", "thermal"]
