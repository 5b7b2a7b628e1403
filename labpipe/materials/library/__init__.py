"""The material library: five materials, each number with its source."""

from labpipe.materials.library._library import (
    Material as Material,
    Solid as Solid,
    Thermal as Thermal,
    describe as describe,
    load as load,
    solid as solid,
    thermal as thermal,
)
