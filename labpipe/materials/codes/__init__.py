"""Materials as input of simulation codes: Abaqus, ANSYS, COMSOL, LS-DYNA, and JSON for any other."""

from labpipe.materials.codes._deck import BULKS, Bulk, Deck, make_deck
from labpipe.materials.codes._texts import CODES, Code, deck_text

__all__ = ["BULKS", "CODES", "Bulk", "Code", "Deck", "deck_text", "make_deck"]
