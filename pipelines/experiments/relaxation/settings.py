"""Settings of a relaxation test: a periodic punch pressed into rubber and held (Mach-1)."""

from typing import Annotated, ClassVar, Literal

import msgspec

from labpipe.units import Quantity
from labpipe.workflow.fields import POSITIVE, File, Time
from pipelines.experiments.shared.punch_settings import Indentation
from pipelines.experiments.shared.settings import Table


class Hold(Table, frozen=True, kw_only=True):
    """Which part of a hold counts for what.

    ``early`` ends the early part of a relaxation, in which the model is compared apart; ten
    seconds are a hundred times the thesis's ramps. The plateau is the mean over the last
    ``plateau`` of the hold, at most a tenth of it: long enough to average noise out, short enough
    that the force hardly falls meanwhile.
    """

    early: Annotated[Time, POSITIVE] = Quantity(10.0, 0.0, "s")
    plateau: Annotated[Time, POSITIVE] = Quantity(60.0, 0.0, "s")


class Relaxation(Indentation, frozen=True, kw_only=True):
    """One or more Mach-1 files with a Stress Relaxation block each; one test per ramp."""

    function: ClassVar[str] = "Stress Relaxation"  # of the tester, that is evaluated
    kind: Literal["relaxation"]
    mach1: Annotated[list[File], msgspec.Meta(min_length=1)]
    hold: Hold = Hold()
