"""Settings of a harmonic indentation: a periodic punch oscillating in rubber (Mach-1)."""

from typing import Annotated, ClassVar, Literal

from labpipe.units import Quantity
from labpipe.workflow.fields import POSITIVE, File, Length, Range, Time
from pipelines.experiments.shared.punch_settings import IndentationModel, LoadCell, Punch, Substrate
from pipelines.experiments.shared.settings import Columns, Table


class Cycles(Table, frozen=True, kw_only=True):
    """Which cycles count: the first ``skip`` are the transient."""

    skip: Annotated[int, Range(at_least=0, at_most=100000)] = 3


class Harmonic(Table, frozen=True, kw_only=True):
    """One Mach-1 file with one or more Sinusoid blocks.

    Without ``punch`` and ``substrate`` there is nothing to simulate: the report then holds the
    measurement alone, and says so. ``contact`` is the stage position of first touch; without it
    the approach in the same file is searched for it. ``characteristic_time`` makes frequencies
    dimensionless (eq. 2.38); without it, it is the shortest retardation time of the material.
    ``plateau`` is the window at the end of the hold before the oscillations, at most a tenth of it.
    ``columns`` names time, position and force of another tester's table, one oscillation.
    """

    function: ClassVar[str] = "Sinusoid"  # of the tester, that is evaluated
    kind: Literal["harmonic"]
    mach1: File
    punch: Punch | None = None
    substrate: Substrate | None = None
    contact: Length | None = None
    load_cell: LoadCell = LoadCell()
    columns: Columns | None = None
    cycles: Cycles = Cycles()
    plateau: Annotated[Time, POSITIVE] = Quantity(60.0, 0.0, "s")
    characteristic_time: Annotated[Time, POSITIVE] | None = None
    model: IndentationModel = IndentationModel()
