"""The dropped sphere (chapter 3): contacts, flights, rest; on rigid ground or a plate."""

from typing import TYPE_CHECKING

from labpipe.installation import lazily

if TYPE_CHECKING:
    from labpipe.contact.impact._checks import Solver as Solver
    from labpipe.contact.impact._drop import drop as drop
    from labpipe.contact.impact._line_springs import Profile as Profile, line_springs as line_springs
    from labpipe.contact.impact._many import impacts as impacts
    from labpipe.contact.impact._motion import Springs as Springs
    from labpipe.contact.impact._plate import Plate as Plate
    from labpipe.contact.impact._rings import ring_springs as ring_springs
    from labpipe.contact.impact._setup import Shortcuts as Shortcuts
else:
    __getattr__ = lazily(__name__)
