"""Maps of the simulator over its parameters: grids and random draws, on any number of workers."""

from typing import TYPE_CHECKING

from labpipe.installation import lazily

if TYPE_CHECKING:
    from pipelines.sweeps.run import Swept as Swept, sweep as sweep
else:
    __getattr__ = lazily(__name__)
