"""The material library: five materials, each number with its source."""

from labpipe.materials.library._library import (
    Material as Material,
    Solid as Solid,
    describe as describe,
    load as load,
    read_material as read_material,
    solid as solid,
)
from labpipe.materials.library._thermal import Thermal as Thermal, thermal as thermal
