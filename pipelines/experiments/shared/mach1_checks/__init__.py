"""Checks of a Mach-1 file: what its header declares against what its columns hold.

Commands, clock and columns are redundant: the amplitude of a command stands against the position,
its frequency and speed against position and time, the start of the next block against the length
of this one, and the force against the cell's capacity, its sign against the motion. A factor in a
column moves them by different powers, which tells the mistake.
"""

from pipelines.experiments.shared.mach1_checks._causes import causes as causes
from pipelines.experiments.shared.mach1_checks._cell import of_cell as of_cell
from pipelines.experiments.shared.mach1_checks._contact import of_force as of_force, of_punch as of_punch
from pipelines.experiments.shared.mach1_checks._of_file import (
    is_swapped as is_swapped,
    knows_depth as knows_depth,
    of_file as of_file,
    of_files as of_files,
    placed as placed,
    weighed as weighed,
)
from pipelines.experiments.shared.mach1_checks._response import phase as phase
from pipelines.experiments.shared.mach1_checks._titles import RATIO as RATIO, SWAPPED as SWAPPED, TITLES as TITLES
