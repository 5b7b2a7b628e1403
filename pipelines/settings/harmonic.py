"""Settings of a harmonic indentation: a periodic punch oscillating in rubber (Mach-1)."""

from typing import Annotated, Literal

from labpipe.workflow.config import POSITIVE, File, Length, Range
from pipelines.settings.common import MaterialChoice, Table


class Punch(Table, frozen=True, kw_only=True):
    """The indenter: cylindrical tips of one radius, ``period`` apart.

    ``depth`` is the length of one tip along its axis; ``tips`` how many touch.
    """

    radius: Annotated[Length, POSITIVE]
    period: Annotated[Length, POSITIVE]
    depth: Annotated[Length, POSITIVE]
    tips: Annotated[int, Range(at_least=1, at_most=1000)] = 3


class Substrate(MaterialChoice, frozen=True, kw_only=True):
    """The rubber: its material and, when it is a thin bonded sheet, its thickness."""

    thickness: Annotated[Length, POSITIVE] | None = None


class LoadCell(Table, frozen=True, kw_only=True):
    """How force is prepared.

    ``correct_filter_lag`` removes the delay of the low-pass that the header declares.
    ``tare`` subtracts the force of the quiet start; off for a test that starts in contact.
    """

    correct_filter_lag: bool = True
    tare: bool = True


class Cycles(Table, frozen=True, kw_only=True):
    """Which cycles count: the first ``skip`` are the transient."""

    skip: Annotated[int, Range(at_least=0, at_most=100000)] = 3


class IndentationModel(Table, frozen=True, kw_only=True):
    """How the indentation is simulated: tip profile and strips per period."""

    profile: Literal["parabola", "circle", "cosine"] = "circle"
    elements: Annotated[int, Range(at_least=64, at_most=16384)] = 1024


class Harmonic(Table, frozen=True, kw_only=True):
    """One Mach-1 file with one or more Sinusoid blocks.

    Without ``punch`` and ``substrate`` there is nothing to simulate: the report then holds the
    measurement alone, and says so. ``contact`` is the stage position of first touch; without it
    the approach in the same file is searched for it.
    """

    kind: Literal["harmonic"]
    mach1: File
    punch: Punch | None = None
    substrate: Substrate | None = None
    contact: Length | None = None
    load_cell: LoadCell = LoadCell()
    cycles: Cycles = Cycles()
    model: IndentationModel = IndentationModel()
