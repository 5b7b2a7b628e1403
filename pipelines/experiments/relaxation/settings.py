"""Settings of a relaxation test: a periodic punch pressed into rubber and held (Mach-1)."""

from typing import Annotated, ClassVar, Literal

import msgspec

from labpipe.workflow.fields import File
from pipelines.experiments.shared.punch_settings import Indentation


class Relaxation(Indentation, frozen=True, kw_only=True):
    """One or more Mach-1 files with a Stress Relaxation block each; one test per ramp.

    The plateau is the mean over the last tenth of a hold.
    """

    function: ClassVar[str] = "Stress Relaxation"  # of the tester, that is evaluated
    kind: Literal["relaxation"]
    mach1: Annotated[list[File], msgspec.Meta(min_length=1)]  #: files of the tester
