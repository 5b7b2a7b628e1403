"""The local page of ``labpipe open``: set up a session from its files, run it, read its reports.

One process, bound to 127.0.0.1, answers only under an address with a random token, to a browser
that names this address as host and origin. Nothing is loaded from elsewhere, nothing outside the
folder is reachable, also not by links, and of a session only ``session.toml``, calibration records
and ``labpipe/`` are written.
"""

from typing import TYPE_CHECKING

from labpipe.installation import lazily

if TYPE_CHECKING:
    from pipelines.app._serve import (
        Served,
        open,  # noqa: A004 (the verb of the command of that name)
        open_guide,
    )
else:
    __getattr__ = lazily(__name__)

__all__ = ["Served", "open", "open_guide"]
