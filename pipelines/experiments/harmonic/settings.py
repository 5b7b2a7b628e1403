"""Settings of a harmonic indentation: a periodic punch oscillating in rubber (Mach-1)."""

from typing import Annotated, ClassVar, Literal

from labpipe.workflow.fields import POSITIVE, File, Range, Time
from pipelines.experiments.shared.punch_settings import Indentation
from pipelines.experiments.shared.settings import Table


class Cycles(Table, frozen=True, kw_only=True):
    """Which cycles count."""

    skip: Annotated[int, Range(at_least=0, at_most=100000)] = 3  #: the first, which are the transient


class Harmonic(Indentation, frozen=True, kw_only=True):
    """One Mach-1 file with one or more Sinusoid blocks.

    ``characteristic_time`` makes frequencies dimensionless (eq. 2.38); without it, it is the shortest retardation time
    of the material. A hold before the oscillations is evaluated as a relaxation of the same file.
    """

    function: ClassVar[str] = "Sinusoid"  # of the tester, that is evaluated
    kind: Literal["harmonic"]
    mach1: File  #: file of the tester, with Sinusoid blocks
    cycles: Cycles = Cycles()  #: which cycles count
    characteristic_time: Annotated[Time, POSITIVE] | None = None  #: makes frequencies dimensionless
