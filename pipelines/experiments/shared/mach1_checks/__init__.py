"""Checks of a Mach-1 file: what its header declares against what its columns hold.

Commands, clock and columns are redundant: the amplitude of a command stands against the position,
its frequency and speed against position and time, the start of the next block against the length
of this one, and the force against the cell's capacity, its sign against the motion. A factor in a
column moves them by different powers, which tells the mistake.
"""

from pipelines.experiments.shared.mach1_checks._causes import causes
from pipelines.experiments.shared.mach1_checks._cell import of_cell
from pipelines.experiments.shared.mach1_checks._contact import of_force, of_punch, touch_stated
from pipelines.experiments.shared.mach1_checks._files import of_files
from pipelines.experiments.shared.mach1_checks._of_file import is_swapped, knows_depth, of_file, placed, weighed
from pipelines.experiments.shared.mach1_checks._parts import hold_parts
from pipelines.experiments.shared.mach1_checks._response import falls, late, phase
from pipelines.experiments.shared.mach1_checks._titles import RATIO, SWAPPED

__all__ = [
    "RATIO",
    "SWAPPED",
    "causes",
    "falls",
    "hold_parts",
    "is_swapped",
    "knows_depth",
    "late",
    "of_cell",
    "of_file",
    "of_files",
    "of_force",
    "of_punch",
    "phase",
    "placed",
    "touch_stated",
    "weighed",
]
