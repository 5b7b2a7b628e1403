"""The dropped sphere (chapter 3): contacts, flights, rest; on rigid ground or a plate."""

from labpipe.contact.impact._checks import Solver
from labpipe.contact.impact._compiled import compile_drop
from labpipe.contact.impact._drop import drop
from labpipe.contact.impact._line_springs import Profile, line_springs
from labpipe.contact.impact._many import impacts
from labpipe.contact.impact._motion import Springs
from labpipe.contact.impact._plate import Plate
from labpipe.contact.impact._rings import ring_springs
from labpipe.contact.impact._setup import Shortcuts

__all__ = [
    "Plate",
    "Profile",
    "Shortcuts",
    "Solver",
    "Springs",
    "compile_drop",
    "drop",
    "impacts",
    "line_springs",
    "ring_springs",
]
