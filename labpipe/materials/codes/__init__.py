"""Materials as input of simulation codes: Abaqus, ANSYS, COMSOL, LS-DYNA, and JSON for any other."""

from labpipe.materials.codes._deck import Bulk as Bulk, Deck as Deck, make_deck as make_deck
from labpipe.materials.codes._texts import CODES as CODES, Code as Code, deck_text as deck_text
