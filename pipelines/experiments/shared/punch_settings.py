"""Settings that the indentations on a Mach-1 tester share: punch, rubber, load cell, model."""

from typing import Annotated, Literal

from labpipe.workflow.fields import POSITIVE, File, Length, Range
from pipelines.experiments.shared.settings import Columns, MaterialChoice, Recorded, Table


class Punch(Table, frozen=True, kw_only=True):
    """The indenter: cylindrical tips of one radius."""

    radius: Annotated[Length, POSITIVE]  #: radius of a tip
    period: Annotated[Length, POSITIVE]  #: distance of the tips
    depth: Annotated[Length, POSITIVE]  #: length of a tip along its axis
    tips: Annotated[int, Range(at_least=1, at_most=1000)] = 3  #: tips that touch


class Substrate(MaterialChoice, frozen=True, kw_only=True):
    """The rubber: its material and, when it is a thin bonded sheet, its thickness."""

    thickness: Annotated[Length, POSITIVE] | None = None  #: of a thin bonded sheet


class LoadCell(Table, frozen=True, kw_only=True):
    """The load cell; without its record the uncertainty of its gain is not known and counts in no result."""

    record: File | None = None  #: its calibration record


class IndentationModel(Table, frozen=True, kw_only=True):
    """Simulation of the indentation: tip profile and strips per period."""

    profile: Literal["parabola", "circle", "cosine"] = "circle"  #: shape of a tip
    elements: Annotated[int, Range(at_least=64, at_most=16384)] = 1024  #: strips per period


class Indentation(Recorded, frozen=True, kw_only=True):
    """Mach-1 files of an indentation.

    ``contact`` is the stage position of first touch; without it the approach in the same file is searched for it.
    ``columns`` names time, position and force of another tester's table, one block.
    """

    punch: Punch | None = None  #: the indenter; without it no modulus is found, and the report says so
    substrate: Substrate | None = None  #: the rubber; without it nothing is simulated, and the report says so
    contact: Length | None = None  #: stage position of first touch
    load_cell: LoadCell = LoadCell()  #: the load cell
    columns: Columns | None = None  #: columns of another tester's table
    model: IndentationModel = IndentationModel()  #: the simulation
