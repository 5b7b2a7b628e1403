"""Settings of a ringing bar."""

from typing import Annotated, Literal

import msgspec

from labpipe.units import Quantity
from labpipe.workflow.fields import POSITIVE, Acceleration, File, Length
from pipelines.experiments.shared.settings import Table


class RingingBar(Table, frozen=True, kw_only=True):
    """Recordings of one bar, and how far its weight presses the spring down."""

    kind: Literal["ringing_bar"]
    recordings: Annotated[list[File], msgspec.Meta(min_length=1)]
    sag: Annotated[Length, POSITIVE]
    gravity: Annotated[Acceleration, POSITIVE] = Quantity(9.81, 0.0, "m/s2")
