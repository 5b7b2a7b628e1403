"""Maps of the simulator over its parameters: grids and random draws, on any number of workers."""

from pipelines.sweeps.grid import Axis, Design, axis, design
from pipelines.sweeps.run import Swept, run_design
from pipelines.sweeps.verb import sweep

__all__ = ["Axis", "Design", "Swept", "axis", "design", "run_design", "sweep"]
