"""The material library: five materials, each number with its source."""

from labpipe.materials.library._library import Material, Solid, describe, load, load_file, read_material, solid
from labpipe.materials.library._thermal import Thermal, thermal

__all__ = ["Material", "Solid", "Thermal", "describe", "load", "load_file", "read_material", "solid", "thermal"]
