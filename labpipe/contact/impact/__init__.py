"""The dropped sphere (chapter 3): contacts, flights, rest; on rigid ground or a plate."""

from typing import TYPE_CHECKING

from labpipe.installation import lazily

if TYPE_CHECKING:
    from labpipe.contact.impact._drop import drop as drop, impacts as impacts
    from labpipe.contact.impact._rings import Profile as Profile, disc_displacement as disc_displacement
    from labpipe.contact.impact._setting import Plate as Plate, Solver as Solver
else:
    __getattr__ = lazily(__name__)
