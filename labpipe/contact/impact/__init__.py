"""The dropped sphere (chapter 3): contacts, flights, rest; on rigid ground or a plate."""

from typing import TYPE_CHECKING

from labpipe.installation import lazily

if TYPE_CHECKING:
    from labpipe.contact.impact._batch import impacts as impacts
    from labpipe.contact.impact._drop import drop as drop
    from labpipe.contact.impact._plate import Plate as Plate
    from labpipe.contact.impact._setting import Solver as Solver
    from labpipe.contact.impact._setup import Shortcuts as Shortcuts
    from labpipe.contact.impact._springs import (
        Profile as Profile,
        Springs as Springs,
        disc_displacement as disc_displacement,
        influence as influence,
        line_springs as line_springs,
        ring_springs as ring_springs,
    )
else:
    __getattr__ = lazily(__name__)
