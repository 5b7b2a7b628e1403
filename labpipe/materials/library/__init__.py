"""The material library: five materials whose every number says where it comes from."""

from labpipe.materials.library._library import Material, describe, load, load_file, read_material
from labpipe.materials.library._thermal import Thermal, thermal

__all__ = ["Material", "Thermal", "describe", "load", "load_file", "read_material", "thermal"]
